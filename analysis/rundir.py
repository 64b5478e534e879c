"""The run directory: `manifest.json`, and one part per (scenario, estimator, range of trials).

Every file is written under a temporary name, flushed to the disk and renamed, so whatever is there is whole. What a
clock measured lies apart in `times/`, so that parts are bit-identical whenever and however often they are computed.
"""

import json
import os
import platform
import re
import subprocess
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd

from cooploc.estimators.bad_input import BadInput

FORMAT = 1
PACKAGES = ("cooploc", "filterpy", "numpy", "scipy", "numba", "pandas", "pyarrow")


class RunDir:
    """A directory of results that can be continued."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def manifest(self) -> dict[str, Any]:
        """What the directory says it holds; empty where there is none yet.

        Raises:
            BadInput: the directory holds something else, or a newer format.

        """
        file = self.path / "manifest.json"
        if not file.exists():
            if self.path.exists() and (not self.path.is_dir() or any(self.path.iterdir())):
                raise BadInput(f"{self.path} exists and is no run directory; name another with --out")
            return {}
        try:
            manifest: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
            newer = manifest["format"] > FORMAT
        except (ValueError, KeyError, TypeError):
            raise BadInput(f"{file} is damaged; name another directory with --out") from None
        if newer:
            raise BadInput(f"{file} has format {manifest['format']}, this version reads up to {FORMAT}: update cooploc")
        return manifest

    def open(self, manifest: dict[str, Any]) -> None:
        """Begin or continue a run.

        Raises:
            BadInput: the directory holds a run of other settings.

        """
        found = self.manifest
        if found:
            for key in ("seed", "data", "versions"):
                if found[key] != manifest[key]:
                    raise BadInput(f"{self.path} holds a run with another {key}; name another directory with --out")
            for label, parameters in manifest["scenarios"].items():
                if found["scenarios"].get(label, parameters) != parameters:
                    raise BadInput(f"{self.path} holds another scenario {label!r}; name another directory with --out")
            manifest = {
                **manifest,
                "scenarios": {**found["scenarios"], **manifest["scenarios"]},
                "streams": found.get("streams", {}),
            }
        for folder in ("parts", "times"):
            (self.path / folder).mkdir(parents=True, exist_ok=True)
        self.write_manifest(manifest)

    def write_manifest(self, manifest: dict[str, Any]) -> None:
        text = json.dumps(manifest, indent=1, sort_keys=True) + "\n"
        _replace(self.path / "manifest.json", lambda file: file.write_text(text, encoding="utf-8"))

    def write(self, name: str, frame: pd.DataFrame, seconds: float) -> None:
        """Keep one part; it counts as done once it is there."""
        _replace(self.path / "times" / f"{name}.json", lambda file: file.write_text(json.dumps({"seconds": seconds})))
        _replace(self.path / "parts" / f"{name}.parquet", lambda file: frame.to_parquet(file, index=False))

    def read(self, name: str) -> pd.DataFrame | None:
        """A part with its seconds, or None where it is absent or cannot be read."""
        part, time = self.path / "parts" / f"{name}.parquet", self.path / "times" / f"{name}.json"
        try:
            frame = pd.read_parquet(part)
        except (OSError, ValueError):
            return None
        try:
            frame["seconds"] = float(json.loads(time.read_text())["seconds"])
        except (OSError, ValueError, KeyError):
            frame["seconds"] = float("nan")
        return frame


def part_name(scenario: str, estimator: str, trials: range) -> str:
    """A part's file name, unique for what it holds and the same on every system."""
    labels = "--".join(re.sub(r"[^A-Za-z0-9.=]+", "-", label).strip("-") for label in (scenario, estimator))
    return f"{labels}--{trials.start:05d}-{trials.stop:05d}"


def provenance() -> dict[str, Any]:
    """Versions, commit and processor: what the bits of a run depend on."""
    try:
        here = Path(__file__).resolve().parent
        ask = ["git", "rev-parse", "HEAD"]
        commit: str | None = subprocess.run(
            ask, cwd=here, capture_output=True, text=True, timeout=5, check=True
        ).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        commit = None
    versions = {name: version(name) for name in PACKAGES}
    return {"versions": {**versions, "python": platform.python_version()}, "commit": commit, "cpu": _cpu()}


def _cpu() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    except OSError:
        found = None
    return found[1] if found else platform.processor() or platform.machine()


def _replace(path: Path, write: Callable[[Path], object]) -> None:
    """Write beside, flush to the disk, rename."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        write(beside)
        with beside.open("rb") as file:
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)

"""The run directory: `manifest.json`, and one part per (scenario, estimator, range of trials).

Every file is written under a temporary name, flushed to the disk and renamed, so whatever is there is whole. A part is
bit-identical whenever it is computed; its receipt has its checksum, and the time that was measured, which is not
bit-identical.
"""

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from filelock import FileLock, Timeout

from cooploc.estimators.plugins.errors import BadInput

FORMAT = 1
MUST_MATCH = ("seed", "data", "versions", "source", "instructions")


class Piece(NamedTuple):
    """Which trials of which scenario and estimator a part holds."""

    scenario: str
    estimator: str
    trials: range

    @property
    def name(self) -> str:
        """Its file's name: readable, the same on every system, and unique by a digest of the labels."""
        labels = "--".join(re.sub(r"[^A-Za-z0-9.=]+", "-", label).strip("-") for label in self[:2])
        return f"{labels[:150]}--{_digest(*self[:2])}--{self.trials.start:05d}-{self.trials.stop:05d}"


class Pieces(NamedTuple):
    """What a directory holds of one scenario and estimator."""

    intact: list[Piece]  # which together hold each trial at most once
    damaged: list[Piece]  # whose parts are not what was written


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
            if self.path.exists() and (not self.path.is_dir() or any(f.name != ".lock" for f in self.path.iterdir())):
                raise BadInput(f"{self.path} exists and is not a run directory; name another with --out")
            return {}
        try:
            manifest: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
            newer = manifest["format"] > FORMAT
        except (ValueError, KeyError, TypeError):
            raise BadInput(f"{file} is damaged; name another directory with --out") from None
        if newer:
            raise BadInput(f"{file} has format {manifest['format']}, this version reads up to {FORMAT}: update cooploc")
        return manifest

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keeps other runs from writing here; the lock ends with its process, however that ends.

        Raises:
            BadInput: another process is writing here.

        """
        _ = self.manifest  # refuses another kind of directory before anything is written there
        self.path.mkdir(parents=True, exist_ok=True)
        lock = FileLock(self.path / ".lock")
        try:
            lock.acquire(timeout=0)
        except Timeout:
            raise BadInput(f"another run is writing to {self.path}: wait for it, or name another with --out") from None
        try:
            yield
        finally:
            lock.release()

    def open(self, manifest: dict[str, Any]) -> None:
        """Begin or continue a run.

        Raises:
            BadInput: the directory holds a run of other settings.

        """
        found = self.manifest
        if found:
            manifest = self._continued(found, manifest)
        for folder in ("parts", "receipts"):
            (self.path / folder).mkdir(parents=True, exist_ok=True)
            for left in (self.path / folder).glob(".*.tmp"):  # of a run that was killed
                left.unlink()
        self.write_manifest(manifest)

    def _continued(self, found: dict[str, Any], asked: dict[str, Any]) -> dict[str, Any]:
        for key in MUST_MATCH:
            if found.get(key) != asked[key]:
                raise BadInput(f"{self.path} holds a run with another {key}; name another directory with --out")
        for path, digest in asked["files"].items():
            if found["files"].get(path, digest) != digest:
                raise BadInput(f"{self.path} holds results of another version of {path}; name another with --out")
        for label, parameters in asked["scenarios"].items():
            if found["scenarios"].get(label, parameters) != parameters:
                raise BadInput(f"{self.path} holds another scenario {label!r}; name another directory with --out")
        return {
            **asked,
            "scenarios": {**found["scenarios"], **asked["scenarios"]},
            "files": {**found["files"], **asked["files"]},
            "cells": _both(found["cells"], asked["cells"]),
            "certificates": found.get("certificates", {}),
            "streams": found["streams"],
        }

    def write_manifest(self, manifest: dict[str, Any]) -> None:
        """Replace the manifest."""
        text = json.dumps(manifest, indent=1) + "\n"
        _replace(self.path / "manifest.json", lambda file: file.write_text(text, encoding="utf-8"))

    def write(self, piece: Piece, frame: pd.DataFrame, seconds: float) -> None:
        """Keep one part; it counts as done once it is there, and its receipt is there before it.

        Raises:
            OSError: it cannot be written: a full disk, no permission; names the file.

        """

        def write(file: Path) -> None:
            frame.to_parquet(file, index=False)
            receipt = json.dumps({"seconds": seconds, "sha256": _checksum(file)})
            _replace(self._receipt_path(piece), lambda temporary: temporary.write_text(receipt))

        _replace(self._part_path(piece), write)

    def pieces(self, scenario: str, estimator: str, count: int) -> Pieces:
        """What there is of the trials below `count`; each part is read once, to compare it with its checksum."""
        found = Pieces([], [])
        reached = 0
        for trials in self.held(scenario, estimator):
            if reached <= trials.start < count:
                piece = Piece(scenario, estimator, trials)
                if self.intact(piece):
                    found.intact.append(piece)
                    reached = trials.stop
                else:
                    found.damaged.append(piece)
        return found

    def intact(self, piece: Piece) -> bool:
        """Whether a part is there and is what was written."""
        try:
            same: bool = _checksum(self._part_path(piece)) == self._receipt_of(piece)["sha256"]
        except (OSError, ValueError, KeyError, TypeError):
            return False
        return same

    def read(self, piece: Piece) -> pd.DataFrame:
        """An intact part, with its seconds."""
        frame = pd.read_parquet(self._part_path(piece)).assign(seconds=float(self._receipt_of(piece)["seconds"]))
        return frame if "centralised" in frame else frame.assign(centralised=frame["bound"])  # of an earlier version

    def _receipt_of(self, piece: Piece) -> dict[str, Any]:
        receipt: dict[str, Any] = json.loads(self._receipt_path(piece).read_text(encoding="utf-8"))
        return receipt

    def held(self, scenario: str, estimator: str) -> list[range]:
        """The trials whose parts are there, whole or not, by their files' names."""
        stem = Piece(scenario, estimator, range(0)).name.removesuffix("00000-00000")
        found = []
        for file in self.path.glob(f"parts/{stem}*.parquet"):
            first, _, last = file.stem.removeprefix(stem).partition("-")
            found.append(range(int(first), int(last)))
        return sorted(found, key=lambda trials: (trials.start, trials.stop))

    def _part_path(self, piece: Piece) -> Path:
        return self.path / "parts" / f"{piece.name}.parquet"

    def _receipt_path(self, piece: Piece) -> Path:
        return self.path / "receipts" / f"{piece.name}.json"


def _both(found: dict[str, Any], asked: dict[str, Any]) -> dict[str, Any]:
    """What was asked of each scenario before, with what is asked now."""
    joined = dict(found)
    for scenario, cell in asked.items():
        before = found.get(scenario, {}).get("estimators", {})
        trials = {name: max(count, before.get(name, 0)) for name, count in cell["estimators"].items()}
        joined[scenario] = {**cell, "estimators": {**before, **trials}}
    return joined


def _checksum(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _digest(*labels: str) -> str:
    return hashlib.sha256("\0".join(labels).encode()).hexdigest()[:8]


def _replace(path: Path, write: Callable[[Path], object]) -> None:
    """Write under a temporary name, flush to the disk, rename.

    Raises:
        OSError: it cannot be done; with the file's name, which not every library gives.

    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        write(temporary)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as e:
        raise OSError(e.errno, e.strerror or str(e), str(path)) from e
    finally:
        temporary.unlink(missing_ok=True)

"""What the bits of a run depend on: versions, source, commit, processor, recordings."""

import hashlib
import platform
import re
import subprocess
from collections.abc import Iterable
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from cooploc import estimators as estimator_names
from cooploc import scenarios as scenario_names
from cooploc.estimators.plugins.build import ConfiguredEstimator
from cooploc.estimators.plugins.python_file import is_file
from cooploc.scenarios.resolved import ResolvedScenario

PACKAGES = ("cooploc", "filterpy", "numpy", "scipy", "numba", "pandas", "pyarrow")
ROOT = Path(__file__).resolve().parents[2]
FLOORS = "estimators", "scenarios"


def provenance() -> dict[str, Any]:
    """Versions, a hash of the source that makes results, commit and processor."""
    versions = {name: version(name) for name in PACKAGES}
    return {
        "versions": {**versions, "python": platform.python_version()},
        "source": source_hash(),
        "commit": _commit(),
        "cpu": _cpu(),
    }


def fingerprint(folder: Path) -> str:
    """One hash over the names and contents of a directory's files."""
    return _hash((file.name, file) for file in sorted(folder.iterdir()) if file.is_file())


def files(estimators: Iterable[ConfiguredEstimator], scenarios: Iterable[ResolvedScenario] = ()) -> dict[str, str]:
    """A hash of the source of all that is not built in: its file, or the Python files of its package.

    What these import from elsewhere is not hashed.
    """
    homes = {one.name: estimator_names.module_of(one.name) for one in estimators}
    homes |= {one.name: scenario_names.module_of(one.name) for one in scenarios}
    found = {}
    for name, module in sorted(homes.items()):
        if is_file(name):
            path = name.rpartition(":")[0]
            found[path] = hashlib.sha256(Path(path).read_bytes()).hexdigest()
        elif module:
            found[name] = _hash(_of_module(module))
    return found


def _of_module(module: str) -> list[tuple[str, Path]]:
    """The files of the package that a module is in, or its own."""
    spec = find_spec(module.partition(".")[0])
    if spec is None or (spec.origin is None and "." in module):  # a namespace, which many share
        spec = find_spec(module)
    if spec and spec.submodule_search_locations:
        folders = map(Path, spec.submodule_search_locations)
        return [named for folder in folders for named in _tree(folder, ".py", ".so", ".pyd")]
    return [(Path(spec.origin).name, Path(spec.origin))] if spec and spec.origin else []


def source_hash(root: Path = ROOT) -> str:
    """One hash over the code below `root` that decides what a trial's errors are."""
    floors = [named for floor in FLOORS for named in _tree(root / floor, ".py")]
    return _hash([*floors, ("errors.py", root / "analysis" / "metrics" / "errors.py")])


def _tree(folder: Path, *suffixes: str) -> list[tuple[str, Path]]:
    """The files of a folder and of those in it, with their paths from there."""
    files = sorted(file for file in folder.rglob("*") if file.suffix in suffixes)
    return [(file.relative_to(folder.parent).as_posix(), file) for file in files]


def _hash(files: Iterable[tuple[str, Path]]) -> str:
    """One hash over names and contents."""
    digest = hashlib.sha256()
    for name, file in files:
        digest.update(name.encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _commit() -> str | None:
    ask = ["git", "rev-parse", "HEAD"]
    try:
        answer = subprocess.run(ask, cwd=ROOT, capture_output=True, text=True, timeout=5, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip()


def _cpu() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    except OSError:
        found = None
    return found[1] if found else platform.processor() or platform.machine()

"""What the bits of a run depend on: versions, source, commit, processor, recordings."""

import hashlib
import platform
import re
import subprocess
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from cooploc.estimators import parse
from cooploc.estimators.files import is_file

PACKAGES = ("cooploc", "filterpy", "numpy", "scipy", "numba", "pandas", "pyarrow")
HERE = Path(__file__).resolve().parent


def provenance() -> dict[str, Any]:
    """Versions, a hash of the source that makes results, commit and processor."""
    versions = {name: version(name) for name in PACKAGES}
    return {
        "versions": {**versions, "python": platform.python_version()},
        "source": _source(),
        "commit": _commit(),
        "cpu": _cpu(),
    }


def fingerprint(folder: Path) -> str:
    """One hash over the names and contents of a directory's files."""
    return _hash(file for file in sorted(folder.iterdir()) if file.is_file())


def files(estimators: Iterable[str]) -> dict[str, str]:
    """A hash of every file that an estimator `path.py:Name` comes from."""
    paths = {parse(label)[0].rpartition(":")[0] for label in estimators if is_file(parse(label)[0])}
    return {path: hashlib.sha256(Path(path).read_bytes()).hexdigest() for path in sorted(paths)}


def _source() -> str:
    """One hash over the code that decides what a trial's errors are."""
    import cooploc.estimators
    import cooploc.scenarios

    folders = (Path(str(module.__file__)).parent for module in (cooploc.estimators, cooploc.scenarios))
    return _hash([file for folder in folders for file in sorted(folder.glob("*.py"))] + [HERE / "errors.py"])


def _hash(files: Any) -> str:
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.name.encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _commit() -> str | None:
    ask = ["git", "rev-parse", "HEAD"]
    try:
        told = subprocess.run(ask, cwd=HERE, capture_output=True, text=True, timeout=5, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return told.stdout.strip()


def _cpu() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    except OSError:
        found = None
    return found[1] if found else platform.processor() or platform.machine()

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

from cooploc.estimators import module_of, parse
from cooploc.estimators.plugins.python_file import is_file
from cooploc.scenarios import source_of

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


def files(estimators: Iterable[str], scenarios: Iterable[str] = ()) -> dict[str, str]:
    """A hash of the source of all that is not built in: its file, or the Python files of its package.

    What these import from elsewhere is not seen.
    """
    homes = {parse(label)[0]: module_of(parse(label)[0]) for label in estimators}
    homes |= dict(map(source_of, scenarios))
    found = {}
    for name, module in sorted(homes.items()):
        if is_file(name):
            path = name.rpartition(":")[0]
            found[path] = hashlib.sha256(Path(path).read_bytes()).hexdigest()
        elif module:
            found[name] = _hash(_modules(module))
    return found


def _modules(module: str) -> list[Path]:
    """The files of the package that a module is in, or its own."""
    spec = find_spec(module.partition(".")[0])
    if spec is None or (spec.origin is None and "." in module):  # a namespace, which many share
        spec = find_spec(module)
    folders = spec.submodule_search_locations if spec else None
    if folders:
        return sorted(f for folder in folders for f in Path(folder).rglob("*") if f.suffix in (".py", ".so", ".pyd"))
    return [Path(spec.origin)] if spec and spec.origin else []


def _source() -> str:
    """One hash over the code that decides what a trial's errors are."""
    import cooploc.estimators
    import cooploc.scenarios

    folders = (Path(str(module.__file__)).parent for module in (cooploc.estimators, cooploc.scenarios))
    return _hash(
        [file for folder in folders for file in sorted(folder.rglob("*.py"))] + [HERE.parent / "metrics" / "errors.py"]
    )


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

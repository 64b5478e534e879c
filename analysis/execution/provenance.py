"""Provenance: what the bits of a run depend on, and the checks of the estimators in it that are not built in.

Each plug-in is checked once for every version of its source. The manifest of a run holds what was found, by the
estimator's label, with the hash of the source and the versions of the distributions that it imports. Tables show it as
one line: "passed: 12 checks", "failed: causality: what was found", "unchecked: why".
"""

import hashlib
import platform
import re
import subprocess
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import cache
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cooploc import estimators as estimator_names
from cooploc import scenarios as scenario_names
from cooploc.analysis.metrics.errors import TRAINED
from cooploc.analysis.metrics.ranking import short_certificate
from cooploc.estimators import configure
from cooploc.estimators.building import ConfiguredEstimator
from cooploc.estimators.errors import BadInput, one_line
from cooploc.estimators.plugin_files import (
    Named,
    artifacts_of,
    distributions,
    files_of_module,
    is_file,
    neighbours_of,
    statements,
    tree,
)
from cooploc.scenarios.conformance import check_estimator
from cooploc.scenarios.scenario import ResolvedScenario

PACKAGES = ("cooploc", "filterpy", "numpy", "scipy", "numba", "pandas", "pyarrow")
ROOT = Path(__file__).resolve().parents[2]
FLOORS = "estimators", "scenarios"


def provenance() -> dict[str, Any]:
    """Return what the bits depend on, with the commit and the processor."""
    return {**bits(), "commit": _commit(), "cpu": _cpu()}


@cache
def bits() -> dict[str, Any]:
    """Return the versions, a hash of the source and the instructions: equal where results are put together."""
    versions = {name: version(name) for name in PACKAGES}
    return {
        "versions": {**versions, "python": platform.python_version()},
        "source": source_hash(),
        "instructions": instructions(),
    }


def version_changes(one: dict[str, Any], other: dict[str, Any]) -> list[tuple[str, Any, Any]]:
    """Return the packages whose versions differ between two manifests, with both versions."""
    a, b = one["versions"], other["versions"]
    return [(name, a.get(name), b.get(name)) for name in sorted({*a, *b}) if a.get(name) != b.get(name)]


def fingerprint(folder: Path) -> str:
    """Return one hash over the names and contents of a directory's files."""
    if not folder.is_dir():
        raise BadInput(f"{folder}: there is no such directory; name the one that holds the recordings, or leave it out")
    return _hash((file.name, file) for file in sorted(folder.iterdir()) if file.is_file())


def plugins(
    estimators: Iterable[ConfiguredEstimator], scenarios: Iterable[ResolvedScenario] = ()
) -> tuple[dict[str, str], dict[str, dict[str, str]]]:
    """Return what plug-ins are made of, by their file or name: a hash of the source, and versions of what it imports.

    The source is a file with its helpers, or a package; with the artifacts that it names.
    """
    hashes, imported = {}, {}
    for name, sources in _sources(estimators, scenarios).items():
        both = [*sources, *artifacts_of(path for _, path in sources if path.suffix == ".py")]
        alone = name.endswith(".py") and len(both) == 1
        hashes[name] = hashlib.sha256(both[0][1].read_bytes()).hexdigest() if alone else _hash(both)
        imported[name] = distributions(file for _, file in sources)
    return hashes, imported


def _sources(
    estimators: Iterable[ConfiguredEstimator], scenarios: Iterable[ResolvedScenario]
) -> dict[str, list[Named]]:
    """Return the files of each plug-in, by the path of a file, or the name of an installed plug-in."""
    homes = {one.name: estimator_names.module_of(one.name) for one in estimators}
    homes |= {one.name: scenario_names.module_of(one.name) for one in scenarios}
    found = {}
    for name, module in sorted(homes.items()):
        if is_file(name):
            path = Path(source_key(name))
            found[source_key(name)] = [(path.name, path), *neighbours_of(path)]
        elif module:
            found[name] = files_of_module(module)
    return found


def source_key(name: str) -> str:
    """Return what `plugins` calls the source of an estimator or a world: the path of its file, or its name."""
    return name.rpartition(":")[0] if is_file(name) else name


def plugin_statements(name: str) -> dict[str, str]:
    """Return what the source of a plug-in estimator states: `licence`, `cites` and `trained_on`."""
    if is_file(name):
        path, _, attribute = name.rpartition(":")
        return statements([Path(path)], attribute)
    module = estimator_names.module_of(name)
    attribute = (estimator_names.REGISTRY.place_of(name) if module else "").partition(":")[2]
    return statements([path for _, path in files_of_module(module) if path.suffix == ".py"], attribute)


def source_hash(root: Path = ROOT) -> str:
    """Return one hash over the code below `root` that decides a trial's errors."""
    floors = [named for floor in FLOORS for named in tree(root / floor, ".py")]
    return _hash([*floors, ("errors.py", root / "analysis" / "metrics" / "errors.py")])


def _hash(files: Iterable[tuple[str, Path]]) -> str:
    """Return one hash over names and contents."""
    digest = hashlib.sha256()
    for name, file in files:
        digest.update(name.encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _commit() -> str | None:
    ask = ["git", "rev-parse", "HEAD"]
    with suppress(OSError, subprocess.SubprocessError):
        return subprocess.run(ask, cwd=ROOT, capture_output=True, text=True, timeout=60, check=True).stdout.strip()
    return None


def instructions() -> dict[str, str]:
    """Return the instructions that the libraries use on this processor: others round otherwise."""
    from llvmlite import binding
    from numpy._core._multiarray_umath import __cpu_features__
    from threadpoolctl import threadpool_info

    import_module("scipy.linalg")  # loads its BLAS
    config: Any = import_module("numba.core.config")  # its values come from the environment
    compiler = config.CPU_NAME or binding.get_host_cpu_name()
    features = config.CPU_FEATURES or binding.get_host_cpu_features().flatten()
    used = hashlib.sha256(features.encode()).hexdigest()[:16]
    loaded = [one for one in threadpool_info() if one["user_api"] == "blas" and _is_ours(Path(one["filepath"]))]
    blas = {f"{one['internal_api']} {one.get('architecture')}" for one in loaded}
    return {
        "machine": platform.machine(),
        "numpy": " ".join(sorted(name for name, there in __cpu_features__.items() if there)),
        "numba": f"{compiler}, optimisation {config.OPT}, features {used}",
        "blas": ", ".join(sorted(blas)),
        "jit": "off" if config.DISABLE_JIT else "on",
    }


def _is_ours(library: Path) -> bool:
    """Whether a BLAS is that of numpy or scipy: a package imported meanwhile, as cvxpy's solvers, may bring another."""
    packages = Path(np.__file__).parents[1]
    brought_by = library.relative_to(packages).parts[0] if library.is_relative_to(packages) else "numpy"
    return brought_by.split(".")[0] in ("numpy", "scipy")


def _cpu() -> str:
    with suppress(OSError):
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        if found := re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE):
            return found[1]
    return platform.processor() or platform.machine()


def check_plugins(
    manifest: dict[str, Any],
    data: Path | None,
    write: Callable[[], None],
    check: bool,
    isolate: bool,
    say: Callable[[str], None],
) -> None:
    """Check the plug-in estimators of a run that were not checked in their present version."""
    held = manifest["certificates"]
    for label in dict.fromkeys(label for cell in manifest["cells"].values() for label in cell["estimators"]):
        name = configure(label).name
        place = source_key(name)
        if place not in manifest["files"] or (is_file(name) and not Path(place).exists()):
            continue
        source = {place: manifest["files"][place], **manifest["imports"][place]}
        if label in held and held[label]["status"] != "unchecked" and held[label]["source"] == source:
            continue
        if check:
            say(f"checking {label}, as it is not built in (--no-check leaves it out)")
        places = [scenario for scenario, cell in manifest["cells"].items() if label in cell["estimators"]]
        found = certify(label, isolate, places, data) if check else _certificate("unchecked", "by request (--no-check)")
        held[label] = {**found, "source": source, **plugin_statements(name)}
        write()
        if check:
            say(f"{label}: {short_certificate(_line(held[label]))}")


def certify(
    label: str, isolate: bool = True, scenarios: Sequence[str] = (), data: Path | None = None
) -> dict[str, Any]:
    """Check an estimator by its name: return `status`, `found` and `checks`; one that cannot be made failed."""
    try:
        report = check_estimator(label, isolate=isolate, scenarios=scenarios, data=data)
    except BadInput as e:
        return _certificate("failed", f"runs: {one_line(e)}")
    checks = [asdict(result) for result in report.results]
    failed = [f"{r['check']}: {r['detail']} (seed {r['seed']})" for r in checks if r["status"] == "failed"]
    if failed or not report.ran:
        more = f", and {len(failed) - 1} more" if len(failed) > 1 else ""
        return _certificate("failed", f"{failed[0]}{more}" if failed else "runs: no check ran", checks)
    skipped: dict[str, list[str]] = {}
    for r in checks:
        if r["status"] == "skipped":
            skipped.setdefault(r["detail"], []).append(r["check"])
    exempt = [f"{names[0] if len(names) == 1 else f'{len(names)} skipped'}: {why}" for why, names in skipped.items()]
    exempt += [r["exempt"] for r in checks if r["exempt"]]
    count = f"{report.ran} of {len(checks)} checks" if report.ran < len(checks) else f"{report.ran} checks"
    return _certificate("passed", "; ".join([count, *exempt]), checks)


def _certificate(status: str, found: str, checks: Iterable[dict[str, Any]] = ()) -> dict[str, Any]:
    return {"status": status, "found": found, "checks": list(checks)}


def line(label: str, certificates: dict[str, Any]) -> str:
    """Return the certificate of an estimator in one line; empty where it is built in."""
    return "" if configure(label).builtin else _line(certificates.get(label))


def _line(certificate: dict[str, Any] | None) -> str:
    if not certificate:
        return "unchecked: the run has no certificate of it"
    learned = certificate.get("trained_on", "")
    return f"{certificate['status']}: {certificate['found']}{TRAINED + learned if learned else ''}"


def add_certificates(rows: pd.DataFrame, certificates: dict[str, Any]) -> pd.DataFrame:
    """Return the rows of a run with a column `certificate`."""
    lines = {label: line(label, certificates) for label in rows["estimator"].unique()}
    return rows.assign(certificate=rows["estimator"].map(lines))

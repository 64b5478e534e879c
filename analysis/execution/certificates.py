"""The checks of estimators that are not built in, each made once for every version of its source.

The manifest of a run holds what they found, by the estimator's label, with the hash of the source that was checked and
the versions of the distributions that it imports. Tables show it as one line: "passed: 12 checks", "failed: causality:
what was found", "unchecked: why". A built-in estimator has none: the tests of this package check it.
"""

from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd

from cooploc.analysis.execution.provenance import stated_of
from cooploc.analysis.metrics.errors import TRAINED
from cooploc.analysis.metrics.ranking import short_certificate
from cooploc.estimators import configure
from cooploc.estimators.errors import BadInput, one_line
from cooploc.estimators.plugin_files import is_file
from cooploc.scenarios.conformance import check_estimator


def check_plugins(
    manifest: dict[str, Any], write: Callable[[], None], check: bool, isolate: bool, say: Callable[[str], None]
) -> None:
    """Check the plug-in estimators of a run that were not checked in their present version."""
    held = manifest["certificates"]
    for label in dict.fromkeys(label for cell in manifest["cells"].values() for label in cell["estimators"]):
        name = configure(label).name
        place = name.rpartition(":")[0] if is_file(name) else name
        if place not in manifest["files"] or (is_file(name) and not Path(place).exists()):
            continue
        source = {place: manifest["files"][place], **manifest["imports"][place]}
        if label in held and held[label]["status"] != "unchecked" and held[label]["source"] == source:
            continue
        if check:
            say(f"checking {label}, as it is not built in (--no-check leaves it out)")
        found = certify(label, isolate) if check else _certificate("unchecked", "by request (--no-check)")
        held[label] = {**found, "source": source, **stated_of(name)}
        write()
        if check:
            say(f"{label}: {short_certificate(_line(held[label]))}")


def certify(label: str, isolate: bool = True) -> dict[str, Any]:
    """Check an estimator by its name: return `status`, `found` and `checks`; one that cannot be made failed."""
    try:
        report = check_estimator(label, isolate=isolate)
    except BadInput as e:
        return _certificate("failed", f"runs: {one_line(e)}")
    checks = [asdict(result) for result in report.results]
    failed = [f"{r['check']}: {r['detail']} (seed {r['seed']})" for r in checks if r["status"] == "failed"]
    if failed or not report.ran:
        more = f", and {len(failed) - 1} more" if len(failed) > 1 else ""
        return _certificate("failed", f"{failed[0]}{more}" if failed else "runs: no check ran", checks)
    exempt = [f"{r['check']}: {r['detail']}" for r in checks if r["status"] == "skipped"]
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

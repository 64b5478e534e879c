"""The checks of estimators that are not built in, each made once for every version of its source.

The manifest of a run holds what they found, by the estimator's label, with the hash of the source that was checked and
the versions of the distributions that it imports. Tables show it as one line: "passed: 12 checks", "failed: causality:
what was found", "unchecked: why". A built-in estimator has none: the tests of this package check it.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from typing import Any

import pandas as pd

from cooploc.analysis.execution.provenance import files, imports, training_of
from cooploc.analysis.metrics.errors import TRAINED
from cooploc.analysis.metrics.ranking import short_certificate
from cooploc.estimators import configure
from cooploc.estimators.building import ConfiguredEstimator
from cooploc.estimators.errors import BadInput, one_line
from cooploc.scenarios.conformance import Report, check_estimator

SKIPPED = "by request (--no-check)"
NOT_YET = "the run has no certificate of it"


def check_plugins(
    estimators: Iterable[ConfiguredEstimator],
    held: dict[str, Any],
    check: bool,
    say: Callable[[str], None],
    isolate: bool = True,
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the label and the certificate of each estimator that was not checked in this version."""
    for estimator in estimators:
        label = estimator.label
        if estimator.builtin:
            continue
        source = {**files([estimator]), **{k: v for one in imports([estimator]).values() for k, v in one.items()}}
        before = held.get(label)
        if before and before["status"] != "unchecked" and before["source"] == source:
            continue
        learned = training_of(estimator.name)
        known = {"source": source, **({"trained_on": learned} if learned else {})}
        if not check:
            yield label, {**_without("unchecked", SKIPPED), **known}
            continue
        say(f"checking {label}, as it is not built in (--no-check leaves it out)")
        found = certify(label, isolate)
        say(f"{label}: {short_certificate(_line({**found, **known}))}")
        yield label, {**found, **known}


def certify(label: str, isolate: bool = True) -> dict[str, Any]:
    """Check an estimator by its name; one that cannot be made has failed."""
    try:
        return of_report(check_estimator(label, isolate=isolate))
    except BadInput as e:
        return _without("failed", f"runs: {one_line(e)}")


def of_report(report: Report) -> dict[str, Any]:
    """Return a report as a certificate, without the source: `status`, `found` and `checks`."""
    checks = [asdict(result) for result in report.results]
    failed = [f"{r['check']}: {r['detail']} (seed {r['seed']})" for r in checks if r["status"] == "failed"]
    if failed or not report.ran:
        more = f", and {len(failed) - 1} more" if len(failed) > 1 else ""
        return {"status": "failed", "found": f"{failed[0]}{more}" if failed else "runs: no check ran", "checks": checks}
    exempt = [f"{r['check']}: {r['detail']}" for r in checks if r["status"] == "skipped"]
    exempt += [r["exempt"] for r in checks if r["exempt"]]
    count = f"{report.ran} of {len(checks)} checks" if exempt else f"{report.ran} checks"
    return {"status": "passed", "found": "; ".join([count, *exempt]), "checks": checks}


def line(estimator: str | ConfiguredEstimator, certificates: dict[str, Any]) -> str:
    """Return the certificate of an estimator in one line; empty where it is built in."""
    asked = configure(estimator) if isinstance(estimator, str) else estimator
    return "" if asked.builtin else _line(certificates.get(asked.label))


def _line(certificate: dict[str, Any] | None) -> str:
    if not certificate:
        return f"unchecked: {NOT_YET}"
    learned = certificate.get("trained_on", "")
    return f"{certificate['status']}: {certificate['found']}{TRAINED + learned if learned else ''}"


def with_certificates(
    rows: pd.DataFrame, certificates: dict[str, Any], estimators: Iterable[ConfiguredEstimator] | None = None
) -> pd.DataFrame:
    """Return the rows of a run with a column `certificate`; labels are read where `estimators` does not give them."""
    known = map(configure, rows["estimator"].unique()) if estimators is None else estimators
    return rows.assign(certificate=rows["estimator"].map({one.label: line(one, certificates) for one in known}))


def _without(status: str, found: str) -> dict[str, Any]:
    return {"status": status, "found": found, "checks": []}

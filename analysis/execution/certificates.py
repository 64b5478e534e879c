"""Certificates: what the checks found of an estimator that is not built in, once per version of its source.

The manifest holds them by the estimator's label with its parameters, each with the hash of the source that was checked.
In tables a certificate is one line: "passed: 16 checks", "failed: causality: what was found", "unchecked: why". A
built-in estimator has none: the tests of this package check it.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor
from dataclasses import asdict
from typing import Any

import pandas as pd

from cooploc.analysis.execution.local_workers import ONE_THREAD, begin_worker
from cooploc.analysis.execution.provenance import files
from cooploc.analysis.metrics.certificate_line import mark
from cooploc.estimators import configure, make
from cooploc.estimators.plugins.build import ConfiguredEstimator
from cooploc.scenarios.conformance.check import Report, check_estimator

LIMIT = 600.0  # [s] for all checks of one estimator
SKIPPED = "by request (--no-check)"
NOT_YET = "the run has no certificate of it"


def renewed(
    estimators: Iterable[ConfiguredEstimator], held: dict[str, Any], check: bool, say: Callable[[str], None]
) -> Iterator[tuple[str, dict[str, Any]]]:
    """The label and a new certificate of each estimator that lacks a valid one; as soon as it is made."""
    for estimator in estimators:
        label = estimator.label
        if estimator.builtin:
            continue
        source = files([estimator])
        if _valid(held.get(label), source):
            continue
        if not check:
            yield label, {**_without("unchecked", SKIPPED), "source": source}
            continue
        say(f"checking {label}, as it is not built in: seconds to minutes (--no-check leaves it out)")
        found = certify(label)
        say(f"{label}: {mark(_line(found))}")
        yield label, {**found, "source": source}


def _valid(certificate: dict[str, Any] | None, source: dict[str, str]) -> bool:
    """Whether there is a certificate with a result, of this source."""
    return certificate is not None and certificate["status"] != "unchecked" and certificate["source"] == source


def certify(label: str, limit: float = LIMIT) -> dict[str, Any]:
    """Check an estimator in a process of its own, where it can crash or hang without harm."""
    from loky import ProcessPoolExecutor

    pool = ProcessPoolExecutor(1, env=ONE_THREAD, initializer=begin_worker, initargs=(os.getpid(),))
    try:
        found: dict[str, Any] = pool.submit(_checked, label).result(timeout=limit)
    except TimeoutError:
        found = _without("unchecked", f"its checks took longer than {limit:g} s")
    except BrokenExecutor:
        found = _without("failed", "runs: the process that checked it died (killed, crashed, or out of memory)")
    finally:
        pool.shutdown(kill_workers=True)
    return found


def line(estimator: str | ConfiguredEstimator, certificates: dict[str, Any]) -> str:
    """What tables say of an estimator: its certificate in one line, empty where it is built in."""
    asked = configure(estimator) if isinstance(estimator, str) else estimator
    return "" if asked.builtin else _line(certificates.get(asked.label))


def _line(certificate: dict[str, Any] | None) -> str:
    return f"{certificate['status']}: {certificate['found']}" if certificate else f"unchecked: {NOT_YET}"


def with_lines(
    rows: pd.DataFrame, certificates: dict[str, Any], estimators: Iterable[ConfiguredEstimator] | None = None
) -> pd.DataFrame:
    """The rows of a run with a column `certificate`; their labels are read where `estimators` does not give them."""
    known = map(configure, rows["estimator"].unique()) if estimators is None else estimators
    return rows.assign(certificate=rows["estimator"].map({one.label: line(one, certificates) for one in known}))


def _checked(label: str) -> dict[str, Any]:
    """What runs in that process."""
    try:
        return of_report(check_estimator(make(label), label))
    except (Exception, SystemExit) as e:
        return _without("failed", f"runs: {type(e).__name__}: {' '.join(str(e).split())}")


def of_report(report: Report) -> dict[str, Any]:
    """A report as a certificate, without the source."""
    status = "passed" if report.passed else "failed"
    bad = [f"{r.check}: {r.detail} (seed {r.seed})" for r in report.results if r.status == "failed"]
    more = f", and {len(bad) - 1} more" if len(bad) > 1 else ""
    found = f"{report.ran} checks" if report.passed else f"{bad[0]}{more}" if bad else "runs: no check ran"
    return {"status": status, "found": found, "checks": [asdict(result) for result in report.results]}


def _without(status: str, found: str) -> dict[str, Any]:
    return {"status": status, "found": found, "checks": []}

"""Whether an estimator from outside may be trusted: every check, once per version of its source, kept with the run.

The manifest holds, by the estimator's label with its parameters, what every check found and the hash of the source that
was checked. In tables a certificate is one line: "passed: 16 checks", "failed: causality: what was found",
"unchecked: why"; a built-in estimator has none, for the tests of this package check it.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor
from dataclasses import asdict
from typing import Any

import pandas as pd

from cooploc.analysis.execution.provenance import files
from cooploc.analysis.execution.workers import ONE_THREAD, begin_worker
from cooploc.analysis.metrics.certificate_line import mark
from cooploc.estimators import BUILTIN, make, parse
from cooploc.scenarios.conformance.check import Report, check_estimator

LIMIT = 600.0  # [s] for all checks of one estimator
SKIPPED = "by request (--no-check)"
NOT_YET = "the run has no certificate of it"


def outside(estimators: Iterable[str]) -> list[str]:
    """The labels of those that are not built in, each once."""
    return [label for label in dict.fromkeys(estimators) if parse(label)[0] not in BUILTIN]


def renewed(
    asked: Iterable[str], held: dict[str, Any], check: bool, say: Callable[[str], None]
) -> Iterator[tuple[str, dict[str, Any]]]:
    """A certificate, for the manifest, of each that lacks a valid one; as soon as it is made."""
    for label in outside(asked):
        source = files([label])
        if _valid(held.get(label), source):
            continue
        if not check:
            yield label, {**_without("unchecked", SKIPPED), "source": source}
            continue
        say(f"checking {label}, as it is not built in: seconds to minutes (--no-check leaves it out)")
        found = certify(label)
        say(f"{label}: {mark(line(label, {label: found}))}")
        yield label, {**found, "source": source}


def _valid(certificate: dict[str, Any] | None, source: dict[str, str]) -> bool:
    """Whether a certificate is there, says something, and is of this source."""
    return certificate is not None and certificate["status"] != "unchecked" and certificate["source"] == source


def certify(label: str, limit: float = LIMIT) -> dict[str, Any]:
    """Check an estimator in a process of its own, which it may crash or hang."""
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


def line(label: str, certificates: dict[str, Any]) -> str:
    """What the tables say of an estimator: its certificate in one line, empty where it is built in."""
    if not outside([label]):
        return ""
    found = certificates.get(label)
    return f"{found['status']}: {found['found']}" if found else f"unchecked: {NOT_YET}"


def with_lines(rows: pd.DataFrame, certificates: dict[str, Any]) -> pd.DataFrame:
    """The rows of a run with a column `certificate`."""
    lines = {label: line(label, certificates) for label in rows["estimator"].unique()}
    return rows.assign(certificate=rows["estimator"].map(lines))


def _checked(label: str) -> dict[str, Any]:
    """What runs in the process of its own."""
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

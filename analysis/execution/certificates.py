"""Certificates: what the checks found of an estimator that is not built in, once per version of its source.

The manifest holds them by the estimator's label with its parameters, each with the hash of the source that was checked
and the versions of the distributions that it imports; other runs of the same worlds share them (`shared_certificates`).
In tables a certificate is one line: "passed: 16 checks", "passed: 15 of 16 checks; axes: why", "failed: causality: what
was found", "unchecked: why". A built-in estimator has none: the tests of this package check it.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from functools import partial
from typing import Any, NamedTuple

import pandas as pd

from cooploc.analysis.execution import shared_certificates
from cooploc.analysis.execution.elsewhere import absolute, hash_of
from cooploc.analysis.execution.own_world_certificate import World, certified
from cooploc.analysis.execution.provenance import files, imports, training_of
from cooploc.analysis.metrics.errors import TRAINED
from cooploc.analysis.metrics.ranking import short_certificate
from cooploc.estimators import configure
from cooploc.estimators.plugins.build import ConfiguredEstimator
from cooploc.estimators.plugins.errors import one_line
from cooploc.estimators.plugins.guard import forbid
from cooploc.scenarios.conformance.check import checked_here, checked_there
from cooploc.scenarios.conformance.report import Report
from cooploc.scenarios.processes.outcome import ProcessHung, WorkerError
from cooploc.scenarios.processes.workers import end, used


class StudyWorlds(NamedTuple):
    """The worlds in which a study runs an estimator."""

    among: tuple[World, ...]
    seed: int


Worlds = StudyWorlds | None
LIMIT = 600.0  # [s] of processor time for all checks of one estimator
SKIPPED = "by request (--no-check)"
NOT_YET = "the run has no certificate of it"


def renewed(
    estimators: Iterable[ConfiguredEstimator],
    held: dict[str, Any],
    check: bool,
    say: Callable[[str], None],
    isolate: bool = True,
    worlds: Callable[[str], Worlds] = lambda label: None,
) -> Iterator[tuple[str, dict[str, Any]]]:
    """The label and a new certificate of each estimator that lacks a valid one; as soon as it is made."""
    for estimator in estimators:
        label = estimator.label
        if estimator.builtin:
            continue
        source = {**files([estimator]), **{k: v for one in imports([estimator]).values() for k, v in one.items()}}
        if valid(held.get(label), source):
            continue
        learned = training_of(estimator.name)
        known = {"source": source, **({"trained_on": learned} if learned else {})}
        if not check:
            yield label, {**_without("unchecked", SKIPPED), **known}
            continue
        yield label, _shared(label, known, worlds(label), say) if isolate else _made(label, known, None, False, say)


def _shared(label: str, known: dict[str, Any], worlds: Worlds, say: Callable[[str], None]) -> dict[str, Any]:
    """The certificate that another run left, or a new one, which is left for others."""
    among, seed = worlds or StudyWorlds((), 0)
    where = [[one.scenario.label, one.scenario.settings, one.trials] for one in among], seed
    key = shared_certificates.key(absolute(label), known["source"], where)
    forbid(*filter(None, [shared_certificates.folder()]))  # no estimator writes its own
    there = shared_certificates.found(key, say)
    if there is not None and valid(there, known["source"]):
        say(
            f"{label}: {short_certificate(_line(there))}, as in another run; "
            "its file and this study's worlds are the same"
        )
        return there
    made = _made(label, known, worlds, True, say)
    shared_certificates.keep(key, label, made, say)
    return made


def _made(
    label: str, known: dict[str, Any], worlds: Worlds, isolate: bool, say: Callable[[str], None]
) -> dict[str, Any]:
    say(f"checking {label}, as it is not built in: seconds to minutes (--no-check leaves it out)")
    found = certify(label, worlds=worlds) if isolate else _checked(label, checked_here)
    say(f"{label}: {short_certificate(_line(found))}")
    return {**found, **known}


def valid(certificate: dict[str, Any] | None, source: dict[str, str]) -> bool:
    """Whether there is a certificate with a result, of this source and of the input files as they are now."""
    if certificate is None or certificate["status"] == "unchecked" or certificate["source"] != source:
        return False
    return all(hash_of(path) == found for path, found in certificate.get("inputs", {}).items())


def certify(label: str, limit: float = LIMIT, worlds: Worlds = None) -> dict[str, Any]:
    """Check an estimator in processes of its own, where it can crash or hang without harm; then in these worlds."""
    owner = f"check {label}"
    try:
        found = _checked(label, partial(checked_there, owner, seconds=limit))
        if worlds is None or not worlds.among or found["status"] == "failed":
            return found
        more = certified(label, list(worlds.among), worlds.seed, max(1.0, limit - used(owner)))
        return {**found, **more, **summary([*found["checks"], *more["checks"]])}
    except ProcessHung as e:
        return _without("unchecked", f"its checks were ended: {e}")
    except WorkerError as e:
        return _without("failed", f"runs: {e}")
    finally:
        end(owner)


def with_check(certificate: dict[str, Any], result: dict[str, Any]) -> dict[str, Any]:
    """A certificate with one more check, in place of an earlier result of the same one."""
    others = [one for one in certificate["checks"] if one["check"] != result["check"]]
    return {**certificate, **summary([*others, result])}


def summary(checks: list[dict[str, Any]]) -> dict[str, Any]:
    """`status`, `found` and `checks` of a certificate: exemptions are said, with their reasons."""
    bad = [f"{r['check']}: {r['detail']} (seed {r['seed']})" for r in checks if r["status"] == "failed"]
    ran = sum(r["status"] != "skipped" for r in checks)
    if bad or not ran:
        more = f", and {len(bad) - 1} more" if len(bad) > 1 else ""
        return {"status": "failed", "found": f"{bad[0]}{more}" if bad else "runs: no check ran", "checks": checks}
    skipped = [f"{r['check']}: {r['detail']}" for r in checks if r["status"] == "skipped"]
    exempt = [*skipped, *(r["exempt"] for r in checks if r.get("exempt"))]
    count = "; ".join([f"{ran} of {len(checks)} checks" if exempt else f"{ran} checks", *exempt])
    return {"status": "passed", "found": count, "checks": checks}


def line(estimator: str | ConfiguredEstimator, certificates: dict[str, Any]) -> str:
    """What tables say of an estimator: its certificate in one line, empty where it is built in."""
    asked = configure(estimator) if isinstance(estimator, str) else estimator
    return "" if asked.builtin else _line(certificates.get(asked.label))


def _line(certificate: dict[str, Any] | None) -> str:
    if not certificate:
        return f"unchecked: {NOT_YET}"
    learned = certificate.get("trained_on", "")
    return f"{certificate['status']}: {certificate['found']}{TRAINED + learned if learned else ''}"


def with_lines(
    rows: pd.DataFrame, certificates: dict[str, Any], estimators: Iterable[ConfiguredEstimator] | None = None
) -> pd.DataFrame:
    """The rows of a run with a column `certificate`; their labels are read where `estimators` does not give them."""
    known = map(configure, rows["estimator"].unique()) if estimators is None else estimators
    return rows.assign(certificate=rows["estimator"].map({one.label: line(one, certificates) for one in known}))


def _checked(label: str, check: Callable[[str, str, int], Report]) -> dict[str, Any]:
    """The certificate that a check gives; an estimator that cannot be checked has failed."""
    try:
        return of_report(check(label, label, 0))
    except ProcessHung:
        raise
    except WorkerError as e:
        return _without("failed", f"runs: {e}")
    except (Exception, SystemExit) as e:
        return _without("failed", f"runs: {one_line(e)}")


def of_report(report: Report) -> dict[str, Any]:
    """A report as a certificate, without the source."""
    return summary([asdict(result) for result in report.results])


def _without(status: str, found: str) -> dict[str, Any]:
    return {"status": status, "found": found, "checks": []}

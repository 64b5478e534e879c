"""Ways to run an estimator by its name for the checks on worlds of full length, in its process or in this one."""

from collections.abc import Callable
from functools import partial
from typing import Any

from cooploc.analysis.execution.played import Given, play_all
from cooploc.analysis.execution.walled import given
from cooploc.estimators import make
from cooploc.estimators.interface import Mail
from cooploc.estimators.plugins.traits import traits
from cooploc.scenarios.conformance.check import run_check
from cooploc.scenarios.conformance.checks import Check
from cooploc.scenarios.conformance.compare import CheckFailed
from cooploc.scenarios.conformance.harness import Harness
from cooploc.scenarios.conformance.mail_replay import recorded, replayed
from cooploc.scenarios.conformance.own_worlds import Mails, Players
from cooploc.scenarios.runner.trace import Trace, trace
from cooploc.scenarios.stream import Stream

Away = Callable[..., Any]  # calls a function of plain arguments somewhere


def here(function: Callable[..., Any], *arguments: Any) -> Any:
    """In this process."""
    return function(*arguments)


def players(label: str, seconds: float, away: Away = here, watched: Away = here) -> Players:
    """How to run an estimator with `away`; runs with a check among the callers have a process of their own.

    Each raises CheckFailed where the run fails.
    """

    def played(stream: Stream) -> Trace:
        (found,) = away(play_all, [given(label, stream, seconds)])
        failed = next((one.line for one in found if one.trace is None), None)
        if failed is not None or len(found) > 1:
            raise CheckFailed(failed or "it failed where trials ran together, and not alone")
        result: Trace = found[0].trace
        return result

    def elsewhere(where: Away, function: Callable[..., Any], stream: Stream, *more: Any) -> Any:
        return where(function, given(label, stream, seconds), *more)

    watching, recording = partial(elsewhere, watched, watch), partial(elsewhere, away, record_mail)
    return Players(played, watching, recording, partial(elsewhere, away, replay_mail))


def watch(one: Given) -> Trace:
    """Run it as a check does."""
    found: list[Trace] = []

    def check_estimator(harness: Harness) -> str:
        found.append(trace(one.label, harness.estimator, one.stream, rows=one.rows))
        return ""

    result = run_check(Check("same-unwatched", check_estimator, ""), Harness(one.label, make(one.label), seed=0))
    if not found:
        raise CheckFailed(result.detail)
    return found[0]


def record_mail(one: Given) -> tuple[Trace, Mails]:
    """Run it, and keep the mail of each tick; none where it holds the whole team."""
    estimator, mails = make(one.label), dict[int, Mail]()
    if traits(estimator).team:
        return trace(one.label, estimator, one.stream, rows=one.rows), mails
    return trace(one.label, estimator, one.stream, recorded(mails, _plain), rows=one.rows), mails


def replay_mail(one: Given, mails: Mails) -> Trace:
    """Run it with the mail of before."""
    return trace(one.label, make(one.label), one.stream, replayed(mails, _plain), rows=one.rows)


def _plain(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
    return call(*arguments)

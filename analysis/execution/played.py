"""What a plug-in does in a process of its own: it gets streams, and says what it believed.

Nothing of the analysis is imported here, neither to be found by a plug-in nor to make its process start late.
"""

from collections.abc import Iterator
from contextlib import chdir, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cooploc.analysis.execution.failures import THERE, full_text, line_of
from cooploc.estimators import make
from cooploc.estimators.interface import Rows
from cooploc.scenarios.processes.time_limit import Limit, within
from cooploc.scenarios.runner.run import Seedless
from cooploc.scenarios.runner.trace import Trace, require_fit, trace
from cooploc.scenarios.stream import Stream


class Given(NamedTuple):
    """All that a plug-in's process is told."""

    label: str
    stream: Stream  # without its seed
    rows: Rows  # of its trials, as the seed makes them
    seconds: float  # for each trial


class Played(NamedTuple):
    """What a plug-in believed in some trials, or why there is nothing."""

    trials: slice
    trace: Trace | None
    line: str = ""
    full: str = ""


def begin(one: Given) -> None:
    """Refuse an estimator that cannot run on such a stream at all.

    Raises:
        BadInput: it cannot be made, or `require_fit` refuses it.

    """
    with within(Limit(one.seconds, end_process=True)), chdir(Path.cwd()):
        require_fit(one.label, make(one.label), one.stream)


def made(label: str, seconds: float) -> None:
    """Import and make an estimator, to see whether its process lives through it."""
    with within(Limit(seconds, end_process=True)):
        make(label)


def play(one: Given) -> list[Played]:
    """Run an estimator on a stream, in a process that may be ended; trials that fail together run again, each alone."""
    short = one._replace(stream=one.stream.first_ticks(2))
    with suppress(*THERE):  # imports and compiles before the clock runs; an error occurs again below
        _traced(short, slice(0, 1))
    return list(_played(one, slice(0, len(one.stream.trial))))


def play_all(several: list[Given]) -> list[list[Played]]:
    """What each estimator of a task believed."""
    return [play(one) for one in several]


def _played(one: Given, trials: slice) -> Iterator[Played]:
    try:
        yield Played(trials, _plain(_traced(one, trials)))
    except THERE as e:
        if trials.stop - trials.start == 1:
            yield Played(trials, None, line_of(e), full_text(e))
            return
        for i in range(trials.start, trials.stop):
            yield from _played(one, slice(i, i + 1))


def _traced(one: Given, trials: slice) -> Trace:
    stream, rows = Seedless(one.stream, one.rows).select(trials)
    limit = Limit(one.seconds, end_process=True)
    with within(limit, *stream.senses.dt.shape[:2]) as watch, chdir(Path.cwd()):
        return trace(one.label, make(one.label), stream, watch, rows=rows)


def _plain(found: Trace) -> Trace:
    """Plain arrays and values alone: nothing whose reading would import the plug-in where errors are computed."""
    x, P, messages, sent = (np.array(a, float) for a in (found.x, found.P, found.messages, found.bytes))
    notes = {str(name): np.array(values, float) for name, values in found.notes.items()}
    said: dict[str, Any] = {name: bool(getattr(found, name)) for name in ("bound", "centralised", "offline")}
    said |= {name: str(getattr(found, name)) for name in ("senses", "trained_on")}
    return Trace(x, P, messages, sent, float(found.seconds), notes=notes, **said)

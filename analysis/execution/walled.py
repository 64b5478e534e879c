"""A plug-in plays without the truth: its process gets streams, and this one, which never imports it, measures.

Neither the seed that made the truth nor a result of another estimator is sent there.
"""

from collections.abc import Iterator
from contextlib import chdir, suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.execution.task import FAILURE, THERE, failed_rows, full_text, line_of
from cooploc.analysis.metrics.errors import errors
from cooploc.estimators import make
from cooploc.estimators.interface import Rows
from cooploc.scenarios import seeds
from cooploc.scenarios.processes.time_limit import Limit, within
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.runner.trace import Trace, trace
from cooploc.scenarios.stream import Stream, Truth


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


def given(label: str, stream: Stream, seconds: float) -> Given:
    """What a plug-in's process is told of a stream."""
    rows = seeds.rows(stream.seed, stream.trial, stream.robots)
    return Given(label, replace(stream, seed=0, notes={}), rows, seconds)


def play(one: Given) -> list[Played]:
    """Run an estimator on a stream, in a process that may be ended; trials that fail together run again, each alone."""
    short = one._replace(stream=one.stream.truncated(2))
    with suppress(*THERE):  # imports and compiles before the clock runs; an error occurs again below
        _traced(short, slice(0, 1))
    return list(_played(one, slice(0, len(one.stream.trial))))


def play_all(several: list[Given]) -> list[list[Played]]:
    """What each estimator of a task believed."""
    return [play(one) for one in several]


def measured_here(label: str, truth: Truth, stream: Stream, played: list[Played]) -> pd.DataFrame:
    """The rows, as `measure` has them, of what an estimator did elsewhere."""
    return pd.concat([_frame(label, truth, stream, one) for one in played], ignore_index=True)


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
    stream, n = one.stream.select(trials), one.stream.robots
    mine = slice(trials.start * n, trials.stop * n)
    rows = Rows(one.rows.trial[mine], one.rows.robot[mine], one.rows.key[mine])
    limit = Limit(one.seconds, end_process=True)
    with within(limit, *stream.senses.dt.shape[:2]) as watch, chdir(Path.cwd()):
        return trace(one.label, make(one.label), stream, watch, rows=rows)


def _plain(found: Trace) -> Trace:
    """Plain arrays and values alone: nothing whose reading would import the plug-in where errors are computed."""
    x, P, messages, sent = (np.array(a, float) for a in (found.x, found.P, found.messages, found.bytes))
    notes = {str(name): np.array(values, float) for name, values in found.notes.items()}
    return Trace(x, P, messages, sent, float(found.seconds), bool(found.bound), notes, bool(found.centralised))


def _frame(label: str, truth: Truth, stream: Stream, one: Played) -> pd.DataFrame:
    truth, stream = truth.select(one.trials), stream.select(one.trials)
    line, full = one.line, one.full
    if one.trace is not None:
        run = Run(stream.scenario, stream.seed, stream.trial, stream.hashes, {label: one.trace})
        try:
            frame = errors(truth, run)
            return frame.assign(**{column: pd.Series([None] * len(frame), dtype="str") for column in FAILURE})
        except Exception as e:  # what came back does not fit this stream
            line, full = line_of(e), full_text(e)
    trials = zip(stream.trial, stream.hashes, strict=True)
    frames = [failed_rows(label, stream.scenario, stream.robots, int(k), h, line, full) for k, h in trials]
    return pd.concat(frames, ignore_index=True)

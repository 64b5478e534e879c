"""A plug-in plays without the truth: its process gets streams, and this one, which never imports it, measures.

Neither the seed that made the truth nor a result of another estimator is sent there.
"""

import pandas as pd

from cooploc.analysis.execution.failures import full_text, line_of
from cooploc.analysis.execution.played import Given, Played
from cooploc.analysis.execution.task import FAILURE, failed_rows
from cooploc.analysis.metrics.errors import errors
from cooploc.scenarios.runner.run import Run, Seedless
from cooploc.scenarios.stream import Stream, Truth


def given(label: str, stream: Stream, seconds: float) -> Given:
    """What a plug-in's process is told of a stream."""
    return Given(label, *Seedless.of(stream), seconds)


def measured_here(label: str, truth: Truth, stream: Stream, played: list[Played]) -> pd.DataFrame:
    """The rows, as `measure` has them, of what an estimator did elsewhere."""
    return pd.concat([_frame(label, truth, stream, one) for one in played], ignore_index=True)


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

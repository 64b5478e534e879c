"""Estimators in processes of their own: what `cl.run` does with those that are not built in, and with several jobs."""

import time
from collections.abc import Callable
from concurrent.futures import as_completed
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from cooploc.estimators.plugins.guard import forbid, forbidden
from cooploc.scenarios.display.progress_bar import Advance
from cooploc.scenarios.processes.outcome import ProcessDied, WorkerError
from cooploc.scenarios.processes.time_limit import Limit, TimeLimit, within
from cooploc.scenarios.processes.workers import SESSION, call, end, received, submit
from cooploc.scenarios.runner.named import estimator
from cooploc.scenarios.runner.seedless import Seedless
from cooploc.scenarios.runner.tick import EstimatorError
from cooploc.scenarios.runner.trace import Trace, demand_fit, trace
from cooploc.scenarios.stream import Stream

T = TypeVar("T")


class Foreign(NamedTuple):
    """An estimator on its way to another process."""

    name: str
    given: Any  # an instance, a class or a name
    seconds: float  # for each trial; beyond it, it is ended
    owner: str = SESSION


def demand_fit_there(one: Foreign, stream: Stream) -> None:
    """As `demand_fit`, in its process.

    Raises:
        BadInput: it is not an estimator, or cannot run on such a stream.
        EstimatorError: it cannot even begin.

    """
    _named(one, lambda: call(one.owner, _fit, one, Seedless.of(stream).stream, forbidden()))


def traced_there(one: Foreign, chunks: list[Stream], advance: Advance | None) -> Trace:
    """As `trace`, of all chunks, a process for each.

    Raises:
        EstimatorError: it broke the interface, took too long, or ended its process.

    """

    def collected() -> Trace:
        futures = [submit(one.owner, len(chunks), _traced, one, Seedless.of(chunk), forbidden()) for chunk in chunks]
        try:
            for future in as_completed(futures):
                future.exception()
                if advance:
                    advance(one.name, chunks[0].senses.dt.shape[1])
            return _joined([received(one.owner, future) for future in futures])
        except KeyboardInterrupt:
            end(one.owner)
            raise

    return _named(one, collected)


def _named(one: Foreign, work: Callable[[], T]) -> T:
    """What a call returns; an error says whose it is."""
    began = time.monotonic()
    try:
        return work()
    except ProcessDied as e:
        late = "exit code 1)" in str(e) and time.monotonic() - began > one.seconds  # as its own timer ends it
        why = f"longer than the time limit of {one.seconds:g} s a trial; its process was ended" if late else str(e)
        raise EstimatorError(f"{one.name}: {why}") from e
    except WorkerError as e:
        raise EstimatorError(f"{one.name}: {e}") from e.__cause__


def _fit(one: Foreign, stream: Stream, folders: tuple[str, ...]) -> None:
    forbid(*folders)
    with within(Limit(one.seconds, end_process=True)):
        demand_fit(one.name, estimator(one.given, one.name), stream)


def _traced(one: Foreign, given: Seedless, folders: tuple[str, ...]) -> Trace:
    forbid(*folders)
    limit = Limit(one.seconds, end_process=True)
    with within(limit):
        made = estimator(one.given, one.name)
    return _limited(one.name, made, given, limit)


def _limited(name: str, made: Any, given: Seedless, limit: Limit) -> Trace:
    """A trace; trials that are late in company run again, each alone."""
    trials, ticks = given.stream.senses.dt.shape[:2]
    try:
        with within(limit, trials, ticks) as watch:
            return trace(name, made, given.stream, watch, rows=given.rows)
    except TimeLimit:
        if trials == 1:
            raise
        return _joined([_limited(name, made, given.select(slice(i, i + 1)), limit) for i in range(trials)])


def _joined(traces: list[Trace]) -> Trace:
    if len(traces) == 1:
        return traces[0]
    parts: dict[str, Any] = {
        f: np.concatenate([getattr(t, f) for t in traces]) for f in ("x", "P", "messages", "bytes")
    }
    notes = {name: np.concatenate([t.notes[name] for t in traces]) for name in traces[0].notes}
    seconds = sum(t.seconds for t in traces)
    return replace(traces[0], **parts, seconds=seconds, notes=notes)

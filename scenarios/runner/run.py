"""The runner: feeds one stream to any number of estimators, carries their mail, and hides what they did not declare.

Every estimator gets the same arrays, read-only, and loses the same packets. The truth does not enter.
"""

from collections.abc import Mapping
from concurrent.futures import Future, as_completed
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cooploc.estimators.interface import Indices
from cooploc.scenarios.display import progress_bar
from cooploc.scenarios.display.html import listed
from cooploc.scenarios.display.progress_bar import Advance
from cooploc.scenarios.runner.named import demand_stream, named
from cooploc.scenarios.runner.trace import Trace, demand_fit, trace
from cooploc.scenarios.stream import Stream

if TYPE_CHECKING:
    from xarray import Dataset


@dataclass(frozen=True, eq=False)
class Run:
    """The traces of several estimators on one stream."""

    scenario: str
    seed: int
    trial: Indices  # (t,)
    hashes: tuple[str, ...]  # of the stream's trials
    traces: Mapping[str, Trace] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"Run({self.scenario!r}, {len(self.trial)} trials, {', '.join(self.traces)})"

    def _repr_html_(self) -> str:
        header = ("estimator", "messages per robot and tick", "bytes", "µs", "standing")
        title = f"run of {self.scenario}, seed {self.seed}, {len(self.trial)} trials"
        return listed(header, title, [(name, *_cost(trace)) for name, trace in self.traces.items()])

    def to_xarray(self) -> "Dataset":
        """Every trace in one xarray.Dataset; `cooploc.scenarios.runner.to_xarray` says what it holds.

        Raises:
            BadInput: the run has no estimators.

        """
        from cooploc.scenarios.runner.to_xarray import dataset  # xarray takes long to import

        attributes = {"scenario": self.scenario, "seed": self.seed, "hashes": list(self.hashes)}
        return dataset(self.traces, self.trial, attributes)


def _cost(trace: Trace) -> tuple[str, ...]:
    """Messages, bytes and microseconds per robot and tick, and whether it is centralised or a bound."""
    t, T, n, _ = trace.x.shape
    sent, size = trace.messages.sum() / (t * T * n), trace.bytes.sum() / (t * T * n)
    standing = "bound" if trace.bound else "centralised" * trace.centralised
    return f"{sent:.2g}", f"{size:.3g}", f"{1e6 * trace.seconds / (t * T * n):.3g}", standing


def run(estimators: Any, stream: Stream, jobs: int = 1) -> Run:
    """Run estimators on a stream.

    Args:
        estimators: a name, a class, an instance, a list of these, or a mapping of your own names to these.
        stream: what they get.
        jobs: processes to spread the trials over; the result is bit-identical for any number.

    Raises:
        IncompatibleEstimator: an estimator needs a channel that the stream lacks.
        EstimatorError: an estimator returned something of the wrong shape, or not finite.

    """
    instances = named(estimators)
    demand_stream(stream)
    for name, estimator in instances.items():
        demand_fit(name, estimator, stream.select(slice(0, 1)).truncated(1))
    parts = np.array_split(np.arange(len(stream.trial)), min(jobs, len(stream.trial)))
    chunks = [stream.select(slice(int(part[0]), int(part[-1]) + 1)) for part in parts] if len(parts) > 1 else [stream]
    ticks = stream.senses.dt.shape[1]
    with progress_bar.bar(ticks * len(chunks) * len(instances)) as advance:
        compute = _spread if len(chunks) > 1 else _here
        traces = compute(instances, chunks, advance)
    return Run(stream.scenario, stream.seed, stream.trial, stream.hashes, traces)


def _here(instances: Mapping[str, Any], chunks: list[Stream], advance: Advance | None) -> dict[str, Trace]:
    return {name: trace(name, estimator, chunks[0], advance=advance) for name, estimator in instances.items()}


def _spread(instances: Mapping[str, Any], chunks: list[Stream], advance: Advance | None) -> dict[str, Trace]:
    """In processes, one for each chunk of the trials."""
    from loky import get_reusable_executor

    pool = get_reusable_executor(max_workers=len(chunks))
    futures: dict[Future[Trace], str] = {
        pool.submit(trace, name, estimator, chunk): name for name, estimator in instances.items() for chunk in chunks
    }
    for future in as_completed(futures):
        future.result()  # the first failure ends the run
        if advance:
            advance(futures[future], chunks[0].senses.dt.shape[1])
    return {name: _joined([f.result() for f, of in futures.items() if of == name]) for name in instances}


def _joined(traces: list[Trace]) -> Trace:
    parts: dict[str, Any] = {
        f: np.concatenate([getattr(t, f) for t in traces]) for f in ("x", "P", "messages", "bytes")
    }
    notes = {name: np.concatenate([t.notes[name] for t in traces]) for name in traces[0].notes}
    seconds = sum(t.seconds for t in traces)
    return replace(traces[0], **parts, seconds=seconds, notes=notes)

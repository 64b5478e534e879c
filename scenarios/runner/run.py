"""The runner: feeds one stream to any number of estimators, carries their mail, and hides what they did not declare.

Every estimator gets the same arrays, read-only, and loses the same packets. The truth does not enter.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from cooploc.estimators import is_builtin
from cooploc.estimators.interface import Array, Indices
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.display import progress_bar
from cooploc.scenarios.display.html import listed
from cooploc.scenarios.processes.workers import BUILTIN
from cooploc.scenarios.runner.in_process import Foreign, demand_fit_there, traced_there
from cooploc.scenarios.runner.named import demand_stream, named
from cooploc.scenarios.runner.trace import Trace, demand_fit, trace, warm_up
from cooploc.scenarios.stream import Stream, Truth

if TYPE_CHECKING:
    from xarray import Dataset

TIME_LIMIT = 600.0  # [s] for one estimator on one trial


@dataclass(frozen=True, eq=False)
class Run:
    """The traces of several estimators on one stream."""

    scenario: str
    seed: int
    trial: Indices  # (t,)
    hashes: tuple[str, ...]  # of the stream's trials
    traces: Mapping[str, Trace] = field(default_factory=dict)
    isolated: bool = True  # what is not built in ran in a process of its own
    unchecked: frozenset[str] = frozenset()  # names of what is not built in, and so was not checked
    time: Array | None = None  # (T,) end of each tick [s]

    def __repr__(self) -> str:
        return f"Run({self.scenario!r}, {len(self.trial)} trials, {', '.join(self.traces)}{self._where()})"

    def _repr_html_(self) -> str:
        header = ("estimator", "messages per robot and tick", "bytes", "µs", "standing")
        title = f"run of {self.scenario}, seed {self.seed}, {len(self.trial)} trials{self._where()}"
        rows = [(name, *_cost(trace, name in self.unchecked)) for name, trace in self.traces.items()]
        return listed(header, title, rows)

    def _where(self) -> str:
        return "" if self.isolated else ", all in one process"

    def to_xarray(self, truth: Truth | None = None) -> "Dataset":
        """Every trace in one xarray.Dataset, with units, which `to_netcdf` writes to a file.

        Variables: the estimates `x` and their covariances `P`, `messages`, `bytes` and `seconds` of computing; with the
        truth also `truth` and `error`, the distance [m] of every estimate from it, nan where it is not known. The
        coordinate `time` is in seconds.

        Args:
            truth: of the same stream as the run.

        Raises:
            BadInput: the run has no estimators, or the truth is that of another stream.

        """
        from cooploc.scenarios.runner.to_xarray import Played, dataset  # xarray takes long to import

        return dataset(Played(self.scenario, self.seed, self.trial, self.hashes, self.time, self.traces), truth)


def _cost(trace: Trace, unchecked: bool) -> tuple[str, ...]:
    """Messages, bytes and microseconds per robot and tick; whether it is centralised, a bound, unchecked, trained."""
    t, T, n, _ = trace.x.shape
    sent, size = trace.messages.sum() / (t * T * n), trace.bytes.sum() / (t * T * n)
    kind = "offline" if trace.offline else "bound" if trace.bound else "centralised" * trace.centralised
    learned = f"trained on {trace.trained_on}" if trace.trained_on else ""
    standing = [kind, "unchecked" * unchecked, learned]
    return f"{sent:.2g}", f"{size:.3g}", f"{1e6 * trace.seconds / (t * T * n):.3g}", ", ".join(filter(None, standing))


def run(estimators: Any, stream: Stream, jobs: int = 1, isolate: bool = True, time_limit: float = TIME_LIMIT) -> Run:
    """Run estimators on a stream.

    What is not built in runs in a process of its own, which the next call uses again: an estimator that crashes or
    hangs is an error here, and nothing else is lost. What it prints appears when it has ended; what it changes of
    itself or of the program stays there. No checks are made of it, so it is marked "unchecked" wherever it is compared;
    `cl.check_estimator` and `cooploc run` make them.

    Args:
        estimators: a name, a class, an instance, a list of these, or a mapping of your own names to these.
        stream: what they get.
        jobs: processes to spread the trials over; the result is bit-identical for any number.
        isolate: False keeps everything in this process, for a debugger; there is no time limit then.
        time_limit: [s] for each trial of an estimator that is not built in; math.inf for none.

    Raises:
        BadInput: arguments that cannot be.
        IncompatibleEstimator: an estimator needs a channel that the stream lacks.
        EstimatorError: an estimator returned something of the wrong shape, or not finite; or it took too long, or
            ended its process.

    """
    _demand_possible(jobs, isolate, time_limit)
    given = named(estimators, isolate)
    demand_stream(stream)
    first = stream.select(slice(0, 1)).truncated(1)
    unchecked = frozenset(name for name, one in given.items() if not is_builtin(one))
    foreign = unchecked if isolate else frozenset()
    for name, one in given.items():
        demand_fit_there(Foreign(name, one, time_limit), first) if name in foreign else demand_fit(name, one, first)
    parts = np.array_split(np.arange(len(stream.trial)), min(jobs, len(stream.trial)))
    chunks = [stream.select(slice(int(part[0]), int(part[-1]) + 1)) for part in parts] if len(parts) > 1 else [stream]
    with progress_bar.bar(stream.senses.dt.shape[1] * len(chunks) * len(given)) as advance:
        traces = {}
        for name, one in given.items():
            if name in foreign:
                traces[name] = traced_there(Foreign(name, one, time_limit), chunks, advance)
            elif len(chunks) > 1:
                traces[name] = traced_there(Foreign(name, one, math.inf, BUILTIN), chunks, advance)
            else:
                if name not in unchecked:
                    warm_up(name, one, stream)
                traces[name] = trace(name, one, stream, advance=advance)
    return Run(stream.scenario, stream.seed, stream.trial, stream.hashes, traces, isolate, unchecked, stream.time)


def _demand_possible(jobs: int, isolate: bool, time_limit: float) -> None:
    if jobs < 1:
        raise BadInput(f"jobs is {jobs}; it must be at least 1")
    if jobs > 1 and not isolate:
        raise BadInput(f"isolate=False keeps everything in one process, and jobs is {jobs}: leave one of them out")
    if not time_limit > 0:
        raise BadInput(f"time_limit is {time_limit}; it must be more than 0 s, or math.inf")

"""The runner: feeds one stream to any number of estimators, carries their mail, and hides what they did not declare.

Every estimator gets the same arrays, read-only, and loses the same packets. The truth does not enter.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cooploc.estimators import configure, is_builtin, make, split_labels
from cooploc.estimators.adapters import Adapter
from cooploc.estimators.building import ConfiguredEstimator, build
from cooploc.estimators.errors import BadInput, one_line
from cooploc.estimators.interface import Array, Indices, Rows
from cooploc.estimators.label_syntax import expand
from cooploc.scenarios import BUILTIN, process, resolve, seeds
from cooploc.scenarios.process import (
    PATIENCE,
    PLUGINS,
    SESSION,
    WorkerError,
    call,
    limit_time,
    place_of,
    submit,
    wait_for,
)
from cooploc.scenarios.runner.tick import EstimatorError, IncompatibleEstimator
from cooploc.scenarios.runner.trace import Trace, require_fit, trace, warm_up
from cooploc.scenarios.scenario import ResolvedScenario
from cooploc.scenarios.stream import Stream, Truth

if TYPE_CHECKING:
    from xarray import Dataset

ROBOT = ("init", "predict", "correct", "send", "fuse", "estimate")
TEAM = ("init", "predict", "correct", "exchange", "estimate")
OFFLINE = ("smooth",)
WRAP = "a filter written for one robot is wrapped by cl.PerRobot, one for a whole team by cl.PerTeam"
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
        return f"Run({self.scenario!r}, {len(self.trial)} trials, {', '.join(self.traces)}{self._remark})"

    @property
    def _remark(self) -> str:
        return "" if self.isolated else ", all in one process"

    def _repr_html_(self) -> str:
        header, rows = ("estimator", "messages per robot and tick", "bytes", "µs", "standing"), []
        for name, one in self.traces.items():
            ticks = np.prod(one.x.shape[:3])  # of all trials and robots
            kind = "offline" if one.offline else "bound" if one.bound else "centralised" * one.centralised
            learned = f"trained on {one.trained_on}" if one.trained_on else ""
            standing = ", ".join(filter(None, (kind, "unchecked" * (name in self.unchecked), learned)))
            sent, size, cost = one.messages.sum() / ticks, one.bytes.sum() / ticks, 1e6 * one.seconds / ticks
            rows.append((name, f"{sent:.2g}", f"{size:.3g}", f"{cost:.3g}", standing))
        title = f"run of {self.scenario}, seed {self.seed}, {len(self.trial)} trials{self._remark}"
        return list_table(header, title, rows)

    def to_xarray(self, truth: Truth | None = None) -> "Dataset":
        """Return every trace in one xarray.Dataset, with units as CF writes them, which `to_netcdf` writes to a file.

        Variables: the estimates `x` and their covariances `P`, whose columns have the axis `other_axis`; `messages`,
        `bytes` and `seconds` of computing; what an estimator counted as "note: NAME"; with the truth also `truth` and
        `error`, the distance [m] of every estimate from it, nan where it is not known. The coordinate `time` is in
        seconds; where axes differ in their units, `unit` has that of each axis. What netCDF 3 cannot keep is written
        otherwise: a large seed as text, a flag as 0 or 1.

        Args:
            truth: of the same stream as the run.

        Raises:
            BadInput: the run has no estimators, or the truth is that of another stream.
        """
        return _dataset(self, truth)


def list_table(header: Iterable[str], title: str, rows: Iterable[Iterable[object]], strong: int | None = None) -> str:
    """Return a table for notebooks in HTML: a caption, and lines under a header, one of them `strong`; all escaped.

    A column of numbers is at the right.
    """
    lines = [list(header), *(list(map(str, row)) for row in rows)]
    sides = ["right" if re.match(r"[-+]?\d", "".join(column[1:])) else "left" for column in zip(*lines, strict=True)]
    text = ""
    for number, line in enumerate(lines):
        cell, weight = ("td", "bold" if number - 1 == strong else "normal") if number else ("th", "bold")
        style = [f"text-align:{side};font-weight:{weight}" for side in sides]
        cells = (f'<{cell} style="{how}">{escape(one)}</{cell}>' for how, one in zip(style, line, strict=True))
        text += f"<tr>{''.join(cells)}</tr>"
    return f'<table><caption style="text-align:left;white-space:nowrap">{escape(title)}</caption>{text}</table>'


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
    if not isinstance(jobs, int) or jobs < 1:
        raise BadInput(f"jobs is {jobs!r}; it must be a whole number, at least 1")
    if jobs > 1 and not isolate:
        raise BadInput(f"isolate=False keeps everything in one process, and jobs is {jobs}: leave one of them out")
    if not isinstance(stream, Stream):
        raise BadInput(
            f"the second argument is a {type(stream).__name__}, not a Stream: write truth, stream = cl.simulate(...), "
            f"then cl.run(estimators, stream)"
        )
    given = estimators_by_name(estimators, isolate)
    if not given:
        raise BadInput("there is no estimator to run: name some")
    first = stream.select(slice(0, 1)).first_ticks(1)
    unchecked = frozenset(name for name, one in given.items() if not is_builtin(one))
    plugins = {name: PluginJob(name, given[name], time_limit) for name in given if isolate and name in unchecked}
    for name, one in given.items():
        if name in plugins:
            require_fit_in_process(plugins[name], first)
        else:
            require_fit(name, one, first)
    count = min(jobs, len(stream.trial))
    parts = np.array_split(np.arange(len(stream.trial)), count)
    chunks = [stream.select(slice(int(part[0]), int(part[-1]) + 1)) for part in parts] if count > 1 else [stream]
    traces = {}
    for name, one in given.items():
        if name in plugins or count > 1:
            traces[name] = trace_in_process(plugins.get(name, PluginJob(name, one, math.inf, process.BUILTIN)), chunks)
            continue
        if name not in unchecked:
            warm_up(name, one, stream)
        traces[name] = trace(name, one, stream)
    return Run(stream.scenario, stream.seed, stream.trial, stream.hashes, traces, isolate, unchecked, stream.time)


# What may be given as estimators.


def estimators_by_name(estimators: Any, isolate: bool = False) -> dict[str, Any]:
    """Return instances by name; with `isolate`, a name or class not built in stays one, for a process of its own."""
    if isinstance(estimators, Mapping):
        return {str(name): make_estimator(one, f"{name!r}", isolate) for name, one in estimators.items()}
    single = isinstance(estimators, type) or any(hasattr(estimators, method) for method in ("init", "smooth"))
    several = [estimators] if single or not isinstance(estimators, Iterable) else estimators
    found: dict[str, Any] = {}
    listed = split_labels(estimators) if isinstance(estimators, str) else several
    for one in (each for given in listed for each in (expand(given) if isinstance(given, str) else [given])):
        name = label_of(one)
        if name in found:
            raise BadInput(f"two estimators are called {name!r}: give them names, {{{name!r}: ..., 'other': ...}}")
        found[name] = make_estimator(one, "one of the estimators", isolate)
    return found


def label_of(estimator: Any) -> str:
    """Return the name of an estimator that was given without one."""
    if isinstance(estimator, str):
        return estimator
    if isinstance(estimator, Adapter):
        return str(estimator.label)
    return estimator.__name__ if isinstance(estimator, type) else type(estimator).__name__


def make_instance(estimator: Any) -> Any:
    """Make an estimator of a name or of a class; return an instance as it is."""
    if isinstance(estimator, str):
        return make(estimator)
    return build(estimator.__name__, estimator, {}) if isinstance(estimator, type) else estimator


def make_estimator(given: Any, where: str, isolate: bool = False) -> Any:
    """Make an instance that has an estimator's methods; with `isolate`, a name or class not built in stays one."""
    if isolate and isinstance(given, str | type) and not is_builtin(given):
        return given
    made = make_instance(given)
    missing = missing_methods(made)
    if missing == list(ROBOT):
        kind = type(made)
        if kind.__module__ == "builtins":
            raise BadInput(f"{where} is of type {kind.__name__}, not an estimator: give a name, a class or an instance")
        has = "a filter of one robot has predict(z) and correct(z), any other those of help(cl.Estimator)"
        raise BadInput(f"{kind.__name__} has no method of an estimator: {has}")
    if missing:
        lacking = ", ".join(f"{method}()" for method in missing)
        raise BadInput(f"estimator {type(made).__name__} lacks {lacking}: help(cl.Estimator) says what to do; {WRAP}")
    return made


def missing_methods(estimator: Any) -> list[str]:
    """Return the methods of the interface that an estimator, by its kind, lacks."""
    whole = OFFLINE if getattr(estimator, "offline", False) else TEAM if hasattr(estimator, "exchange") else ROBOT
    return [method for method in whole if not callable(getattr(estimator, method, None))]


# Estimators in processes of their own.


def remove_seed(stream: Stream) -> tuple[Stream, Rows]:
    """Return a stream that does not say its seed, and the rows that the seed makes."""
    return replace(stream, seed=0, notes={}), seeds.rows(stream.seed, stream.trial, stream.robots)


class PluginJob(NamedTuple):
    """An estimator on its way to another process."""

    name: str
    given: Any  # an instance, a class or a name
    seconds: float  # for each trial; beyond it, it is ended
    owner: str = SESSION


def require_fit_in_process(one: PluginJob, stream: Stream) -> None:
    """Do in its process what `require_fit` does."""
    with _name_in_errors(one):
        call(one.owner, _require_fit, one, remove_seed(stream)[0], limit=one.seconds)


def trace_in_process(one: PluginJob, chunks: list[Stream]) -> Trace:
    """Return the trace of all chunks, each run in a process of its own."""
    with _name_in_errors(one):
        futures = [submit(one.owner, len(chunks), _trace_chunk, one, *remove_seed(chunk)) for chunk in chunks]
        return _concatenate([wait_for(one.owner, future, limit=one.seconds) for future in futures])


@contextmanager
def _name_in_errors(one: PluginJob) -> Iterator[None]:
    """Name the estimator in errors of its process."""
    try:
        yield
    except WorkerError as e:
        named = EstimatorError(f"{one.name}: {e}")
        named.__dict__ |= e.__dict__  # what a notebook shows
        raise named from e.__cause__ or e


def find_misfits(
    scenario: ResolvedScenario, estimators: Sequence[ConfiguredEstimator], seed: int, time_limit: float, isolate: bool
) -> dict[str, IncompatibleEstimator]:
    """Start every estimator on the first tick of a scenario; return why some cannot run on it, by label.

    With `isolate`, what is not built in is tried in a process of its own: a crash there is a failure of its trials.
    """
    if isolate and scenario.name not in BUILTIN:
        asked = scenario.label, scenario.data, [one.label for one in estimators], seed
        with suppress(WorkerError):
            return dict(call(PLUGINS, _find_misfits_of_labels, *asked, seconds=time_limit + PATIENCE))
        return {}
    scenario.require_memory(trials=1)
    stream, misfits = replace(_first_stream(scenario, seed), scenario=scenario.label), {}
    for one in estimators:
        try:
            if isolate and not one.builtin:
                with suppress(EstimatorError):
                    require_fit_in_process(PluginJob(one.label, one.label, time_limit, PLUGINS), stream)
            else:
                require_fit(one.label, make(one), stream)
        except IncompatibleEstimator as e:
            misfits[one.label] = e
    return misfits


def _first_stream(scenario: ResolvedScenario, seed: int) -> Stream:
    """Return the stream of a scenario's first tick; of one that is not built in, only if trials come again alone."""
    first = scenario.of_length(1)
    if scenario.name in BUILTIN:
        return first.simulate(1, seed)[1]
    try:
        if first.is_recording:
            return first.simulate(1, seed)[1]
        both, second = (first.simulate(trials, seed)[1] for trials in ([0, 1], [1]))
    except BadInput:
        raise
    except Exception as e:  # a plug-in may fail in any way
        raise BadInput(f"scenario {scenario.label!r} cannot be simulated: {one_line(e)}{place_of(e)}") from e
    if both.hashes[1:] != second.hashes:
        remedy = "draw every random number from cooploc.scenarios.seeds.generator(seed, trial, purpose)"
        raise BadInput(
            f"scenario {scenario.label!r} gives other readings for the same seed and trial, alone and beside another: "
            f"{remedy}"
        )
    return both.select([0])


def _find_misfits_of_labels(
    scenario: str, data: Path | None, estimators: list[str], seed: int
) -> dict[str, IncompatibleEstimator]:
    return find_misfits(resolve(scenario, data), [configure(label) for label in estimators], seed, math.inf, False)


def _require_fit(one: PluginJob, stream: Stream) -> None:
    with limit_time(one.seconds + PATIENCE):
        require_fit(one.name, make_estimator(one.given, one.name), stream)


def _trace_chunk(one: PluginJob, stream: Stream, rows: Rows) -> Trace:
    with limit_time(one.seconds + PATIENCE):
        made = make_estimator(one.given, one.name)
        warm_up(one.name, made, stream)
    with limit_time(one.seconds, *stream.senses.dt.shape[:2]) as watch:
        return trace(one.name, made, stream, watch, rows=rows)


def _concatenate(traces: list[Trace]) -> Trace:
    if len(traces) == 1:
        return traces[0]
    names, notes = ("x", "P", "messages", "bytes"), traces[0].notes
    parts: dict[str, Any] = {name: np.concatenate([getattr(t, name) for t in traces]) for name in names}
    parts["notes"] = {name: np.concatenate([t.notes[name] for t in traces]) for name in notes}
    return replace(traces[0], **parts, seconds=sum(t.seconds for t in traces))


# A run with labelled axes, for `Run.to_xarray`.

AXES, UNITS = ("x", "y", "heading"), ("m", "m", "rad")
BELIEF = ("estimator", "trial", "tick", "robot", "axis")
COUNT = ("estimator", "trial", "robot")
LARGEST = 2**31  # above which netCDF 3 has no whole numbers


def _dataset(run: Run, truth: Truth | None) -> "Dataset":
    from xarray import Dataset  # late, as it takes long to import

    traces = list(run.traces.values())
    if not traces:
        raise BadInput("this run has no estimators, so there is nothing to put into a dataset: run some")
    _, ticks, robots, d = traces[0].x.shape
    metres, absent = "m" * (d == 2), np.full_like(traces[0].messages, np.nan)
    variables: dict[str, Any] = {} if truth is None else _errors(run, truth)
    for name, axes, about, units in (
        ("x", BELIEF, "estimate", metres),
        ("P", (*BELIEF, "other_axis"), "its covariance", metres and "m2"),
        ("messages", COUNT, "messages sent", "1"),
        ("bytes", COUNT, "bytes sent", "byte"),
        ("seconds", COUNT[:1], "computing time", "s"),
        ("centralised", COUNT[:1], "all readings reach one computer", ""),
        ("bound", COUNT[:1], "bounds all other estimators", ""),
    ):
        variables[name] = axes, np.stack([getattr(t, name) for t in traces]), _about(about, units)
    for name in dict.fromkeys(name for t in traces for name in t.notes):
        variables[f"note: {name}"] = COUNT, np.stack([t.notes.get(name, absent) for t in traces])
    coordinates = {
        "estimator": list(run.traces),
        "trial": run.trial,
        "tick": np.arange(ticks),
        "robot": np.arange(robots),
        "axis": list(AXES[:d]),
        "other_axis": list(AXES[:d]),
        "unit": ("axis", list(UNITS[:d]), _about("unit of an axis")),
        "stream": ("trial", list(run.hashes), _about("hash of the trial's stream")),
        **({} if run.time is None else {"time": ("tick", run.time, _about("end of the tick", "s"))}),
    }
    seed = run.seed if run.seed < LARGEST else str(run.seed)
    return Dataset(variables, coordinates, {"scenario": run.scenario, "seed": seed})


def _errors(run: Run, truth: Truth) -> dict[str, Any]:
    """The truth, and how far each estimate is from it."""
    if truth.origin != run.hashes:
        raise BadInput(f"this truth ({truth.scenario}) is not the run's ({run.scenario}): simulate it again")
    d = next(iter(run.traces.values())).x.shape[-1]
    known = np.where(truth.valid[..., None], truth.x, np.nan)
    known = np.concatenate([known, np.full((*known.shape[:-1], max(0, d - known.shape[-1])), np.nan)], -1)[..., :d]
    far = [np.hypot(*np.moveaxis(trace.x[..., :2] - known[..., :2], -1, 0)) for trace in run.traces.values()]
    return {
        "truth": (BELIEF[1:], known, _about("true pose", "m" if d == 2 else "")),
        "error": (BELIEF[:-1], np.stack(far), _about("distance of the estimate from the true position", "m")),
    }


def _about(name: str, units: str = "") -> dict[str, str]:
    return {"long_name": name, "units": units} if units else {"long_name": name}

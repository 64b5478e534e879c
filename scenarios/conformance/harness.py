"""Runs an estimator on variations of small streams, records what it believed and sent, and compares two such runs."""

import inspect
import pickle
import re
import traceback
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from functools import cached_property
from inspect import isroutine
from typing import Any, NamedTuple, NoReturn

import cloudpickle
import numpy as np

from cooploc.estimators import errors
from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.registry import Traits, traits
from cooploc.scenarios import simulate
from cooploc.scenarios.conformance.variations import deep_copy, drop_readings
from cooploc.scenarios.runner.tick import (
    SENSED,
    EstimatorError,
    IncompatibleEstimator,
    Watcher,
    select_channels,
    visible,
)
from cooploc.scenarios.runner.trace import Trace, trace
from cooploc.scenarios.stream import Stream, Truth

_RADIO: dict[str, Any] = {"ticks": 12, "drop": 0.3}
_CAMERA: dict[str, Any] = {**_RADIO, "sight": 8.0, "view": 1.5}  # wide view: even a short stream has sightings
# One robot and one trial are a single row: the shape on which mistakes in broadcasting show.
SCENARIOS = {"robots-1-3/n=3": _RADIO, "robots-1-3/n=1": _RADIO, "camera/n=3": _CAMERA, "camera/n=1": _CAMERA}
TRIALS = 3
ROUNDING = 1e-9  # a largest difference below this is called rounding: it fails too, but has another cause
INPUTS = {"init": ("prior", "world", "rows"), "smooth": ("prior", "world", "rows", "senses", "mail")}
STATE_INPUTS = ("state", "senses", "mail")  # of all other methods


class CheckFailed(Exception):
    """What was tried and seen, in one sentence with its place; and a remedy where the check's own does not fit."""

    def __init__(self, found: str, remedy: str = "") -> None:
        super().__init__(found)
        self.remedy = remedy


class CheckSkipped(Exception):
    """The check does not apply to this estimator; the message says why."""


class RunRecord(NamedTuple):
    """What an estimator believed and sent in one run."""

    trace: Trace
    packets: tuple[Array, ...]  # (t, n, ...) per tick, what send() returned; empty for a team estimator
    stream: Stream  # the copy that it ran on

    def select(self, trials: list[int]) -> "RunRecord":
        """Return the record of these trials, in this order."""
        t = self.trace
        found = replace(t, x=t.x[trials], P=t.P[trials], messages=t.messages[trials], bytes=t.bytes[trials])
        return RunRecord(found, tuple(sent[trials] for sent in self.packets), self.stream.select(trials))


class Harness:
    """An estimator, the small streams that it can run on, and how it ran on them.

    Args:
        name: what to call the estimator.
        estimator: an instance.
        seed: seeds the streams, and what is done to them.
        ticks: length of each stream; None: that of `SCENARIOS`.

    """

    def __init__(self, name: str, estimator: Any, seed: int, ticks: int | None = None) -> None:
        self.name, self.estimator, self.seed, self.ticks = name, estimator, seed, ticks
        self.runs = 0

    @cached_property
    def traits(self) -> Traits:
        """Its optional members."""
        return traits(self.estimator)

    @property
    def centralised(self) -> bool:
        """Whether it declares that all readings reach one computer; only a team estimator can."""
        return self.traits.team and self.traits.centralised

    @property
    def rng(self) -> np.random.Generator:
        """The same generator every time, so that a check's outcome does not depend on those before it."""
        return np.random.default_rng(self.seed)

    @cached_property
    def deterministic(self) -> bool:
        """Whether its keys, the only randomness that is allowed, make no difference."""
        others = (self.run(replace(s, seed=s.seed + 1), "rows.key was different").trace for s, _ in self.cases)
        bases = (base.trace for _, base in self.cases)
        return all(np.array_equal(a.x, b.x) and np.array_equal(a.P, b.P) for a, b in zip(bases, others, strict=True))

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The small streams that have what the estimator declares.

        Raises:
            CheckFailed: there is none.

        """
        return tuple(stream for _, stream in self._labelled)

    @cached_property
    def cases(self) -> list[tuple[Stream, RunRecord]]:
        """The streams, and how it runs on each where nothing is changed."""
        return [(stream, self.run(stream, "nothing was changed")) for stream in self.streams]

    @property
    def team_cases(self) -> list[tuple[Stream, RunRecord]]:
        """The cases of more than one robot."""
        return [(stream, base) for stream, base in self.cases if stream.robots > 1]

    def channels(self, stream: Stream) -> set[str]:
        """Return the channels of a stream that its declaration selects."""
        return select_channels(self.name, tuple(self.estimator.uses), stream)

    def array(self, channel: str) -> str:
        """Return the name that a channel's readings have in `Stream.arrays`."""
        if channel.startswith("radio_"):
            return channel.replace("radio_", "air.")
        return f"senses.{channel}" if channel in SENSED else f"extra.{channel}"

    def truth(self, stream: Stream) -> Truth:
        """Simulate the truth of one of the small streams again: the harness itself keeps none."""
        label = next(label for label, one in self._labelled if one is stream)
        return self._simulate(label)[0]

    def run(
        self, stream: Stream, when: str, estimator: Any = None, watch: Callable[[Watcher], Watcher] | None = None
    ) -> RunRecord:
        """Run the estimator on a copy of a stream.

        Args:
            stream: what it is given.
            when: the variation, for messages: "no packet arrived".
            estimator: runs in its place.
            watch: wraps the watcher that sees every call.

        Raises:
            CheckFailed: it raised, or broke the interface; says in which method, tick and variation.

        """
        recorder, given = _CallRecorder(), deep_copy(stream)
        self.runs += 1
        try:
            ran = self.estimator if estimator is None else estimator
            found = trace(self.name, ran, given, watch(recorder) if watch else recorder, any_covariance=True)
        except CheckFailed:
            raise
        except (EstimatorError, IncompatibleEstimator) as e:
            raise CheckFailed(f"{e} ({when})") from e
        except (Exception, SystemExit, GeneratorExit) as e:
            where = f"{recorder.method}() raised at tick {recorder.tick} of {stream.scenario!r} ({when})"
            raise CheckFailed(f"{where}: {one_line(e)}", _remedy(e)) from e
        t, _, n = stream.senses.dt.shape
        return RunRecord(found, tuple(sent.reshape(t, n, -1) for sent in recorder.packets), given)

    def require_same(
        self, base: RunRecord, stream: Stream, when: str, robots: Mask | None = None, ticks: int | None = None
    ) -> None:
        """Run on a variation of the stream; require the bits of `base`, for these robots (n,) and in the first ticks.

        Raises:
            CheckFailed: an estimate or a packet differs, or the run failed.

        """
        require_equal(base, self.run(stream, when), when, robots, ticks)

    @cached_property
    def _labelled(self) -> list[tuple[str, Stream]]:
        fitting, reasons = [], []
        for label in SCENARIOS:
            _, stream = self._simulate(label)
            try:
                visible(self.name, self.estimator, stream)
                sparse = drop_readings(stream, self.rng)
                fitting.append((label, replace(sparse, scenario=f"{stream.scenario}, some readings absent")))
            except IncompatibleEstimator as e:
                reasons.append(str(e))
        if not fitting:
            raise CheckFailed("; ".join(reasons[::2]))  # the scenarios come in pairs
        return fitting

    def _simulate(self, label: str) -> tuple[Truth, Stream]:
        overrides = SCENARIOS[label] if self.ticks is None else {**SCENARIOS[label], "ticks": self.ticks}
        return simulate(label, trials=TRIALS, seed=self.seed, **overrides)


class _CallRecorder:
    """A runner's watcher that knows which method is running, and keeps what was sent."""

    def __init__(self) -> None:
        self.method, self.tick = "init", -1
        self.packets: list[Array] = []

    def __call__(self, method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
        self.method, self.tick = method, tick
        result = call(*arguments)
        if method == "send":
            sent = np.array(result, float)
            self.packets.append(np.where(np.isnan(sent), np.nan, sent))  # one nan, whatever its bits
        return result


def pickled(estimator: Any) -> Any:
    """Return the estimator after a round trip through cloudpickle, by which it reaches other processes.

    Raises:
        CheckFailed: it cannot be pickled or read back.

    """
    try:
        return pickle.loads(cloudpickle.dumps(estimator))
    except Exception as e:
        remedy = "make it a frozen dataclass, its parameters plain values"
        raise CheckFailed(f"it cannot be pickled, so it cannot run in parallel: {one_line(e)}", remedy) from e


def one_line(e: BaseException) -> str:
    """Return an exception in one line, without memory addresses."""
    return re.sub(r" at 0x[0-9a-f]+", "", errors.one_line(e))


def _remedy(e: BaseException) -> str:
    if "read-only" in one_line(e):
        return "an input is read-only: copy the array before you write to it"
    return "make the method work on such input too: nan is an absent reading, width 0 an absent channel"


def raised_by(e: BaseException, estimator: Any) -> bool:
    """Return whether an exception came out of an estimator's own code, or of what that called."""
    members = [member for cls in type(estimator).__mro__ for member in vars(cls).values()]
    functions = [getattr(member, "fget", None) or getattr(member, "__func__", member) for member in members]
    files = {one.__code__.co_filename for one in functions if inspect.isfunction(one)}
    return any(frame.filename in files for frame in traceback.extract_tb(e.__traceback__))


# Two runs, compared bit by bit


def require_equal(a: RunRecord, b: RunRecord, when: str, robots: Mask | None = None, ticks: int | None = None) -> None:
    """Require that two runs are bitwise equal, for these robots (n,) and in the first ticks that both have.

    Raises:
        CheckFailed: they differ; says whose estimate or packet, `when` (what was tried), and where first.

    """
    t, _, n = a.stream.senses.dt.shape
    T = min(a.trace.x.shape[1], b.trace.x.shape[1], ticks or len(a.stream.time))
    ones = np.ones(n, bool) if robots is None else robots
    believed = [np.concatenate([r.trace.x[:, :T], r.trace.P[:, :T].reshape(t, T, n, -1)], -1) for r in (a, b)]
    pairs: dict[str, list[Any]] = {
        "estimate": [believed],
        "packet": [(p[:, None], q[:, None]) for p, q in zip(a.packets[:T], b.packets[:T], strict=False)],
    }
    for what, compared in pairs.items():
        if not compared:
            continue
        differs, size = _difference(compared)
        chosen = differs & ones
        if chosen.any():
            fail_at(earliest(chosen), a.stream, f"'s {what} changed {_by(float(size[chosen].max()))} when {when}")


def _difference(pairs: list[Any]) -> tuple[Mask, Array]:
    """Return whether bits differ along the last axis (t, T, n), and the largest difference there."""
    masks, sizes = [], []
    for p, q in pairs:
        if p.shape != q.shape:
            masks.append(np.ones(p.shape[:3], bool))
            sizes.append(np.full(p.shape[:3], np.inf))
            continue
        differs = np.ascontiguousarray(p).view(np.uint64) != np.ascontiguousarray(q).view(np.uint64)
        with np.errstate(invalid="ignore"):
            size = np.where(differs, np.abs(p - q), 0.0)
        masks.append(differs.any(-1))
        sizes.append(np.where(np.isfinite(size), size, np.inf).max(-1, initial=0.0))
    return np.concatenate(masks, 1), np.concatenate(sizes, 1)


def require_none(bad: Mask, stream: Stream, fault: str) -> None:
    """Require that `bad` (t, T, n) holds nowhere.

    Raises:
        CheckFailed: it does; says which robot, its `fault`, and where first.

    """
    if bad.any():
        fail_at(earliest(bad), stream, fault)


def earliest(bad: Mask) -> tuple[int, int, int]:
    """Return the trial's index, tick and robot where `bad` (t, T, n) holds first in time."""
    tick, trial, robot = map(int, np.argwhere(bad.swapaxes(0, 1))[0])
    return trial, tick, robot


def fail_at(where: tuple[int, int, int], stream: Stream, fault: str, remedy: str = "") -> NoReturn:
    """Fail with the robot, its `fault`, and the place."""
    trial, tick, robot = where
    raise CheckFailed(f"robot {robot}{fault}: {stream.scenario!r}, trial {stream.trial[trial]}, tick {tick}", remedy)


def _by(largest: float) -> str:
    if not np.isfinite(largest):
        return "between a number and none"
    return f"by {largest:.1e}, which is rounding," if largest < ROUNDING else f"by up to {largest:.2g}"


# What is inside an object, before and after


def snapshot(thing: Any, path: str, above: tuple[int, ...] = ()) -> dict[str, Any]:
    """Return everything inside an object, by path, as values that `==` compares bitwise.

    Args:
        thing: any object: arrays, containers, dataclasses, generators.
        path: its name, where every path begins.
        above: ids of what it is inside of, so that a cycle ends.

    """
    if id(thing) in above:
        return {}
    if isinstance(thing, np.ndarray) and not thing.dtype.hasobject:
        return {path: (thing.dtype.str, thing.shape, thing.tobytes())}
    if isinstance(thing, int | float | complex | str | bytes | np.generic | None):
        return {path: repr(thing)}
    inside: dict[str, Any] = {path: type(thing)}
    for name, member in _members(thing):
        inside |= snapshot(member, f"{path}{name}", (*above, id(thing)))
    return inside


def _members(thing: Any) -> list[tuple[str, Any]]:
    if isinstance(thing, np.random.Generator):
        return [(".state", thing.bit_generator.state)]
    if isinstance(thing, tuple) and hasattr(thing, "_fields"):  # a NamedTuple
        return [(f".{name}", getattr(thing, name)) for name in thing._fields]
    if isinstance(thing, Mapping):
        return [(f"[{key!r}]", member) for key, member in thing.items()]
    if isinstance(thing, list | tuple | set | frozenset | np.ndarray):
        members = sorted(thing, key=repr) if isinstance(thing, set | frozenset) else list(thing)
        return [(f"[{i}]", member) for i, member in enumerate(members)]
    if is_dataclass(thing) and not isinstance(thing, type):
        return [(f".{f.name}", getattr(thing, f.name)) for f in fields(thing)]
    if isinstance(thing, type) or isroutine(thing):
        return [(" is", str(id(thing)))]
    return [(f".{name}", member) for name, member in sorted(getattr(thing, "__dict__", {}).items())]


def require_unchanged(before: dict[str, Any], after: dict[str, Any], when: str) -> None:
    """Require two equal snapshots.

    Raises:
        CheckFailed: they differ; names the first path, and `when`: "by predict() at tick 3".

    """
    for path in [*before, *after]:
        if before.get(path) != after.get(path):
            raise CheckFailed(f"{path} was changed {when}")


def watch_inputs(scenario: str, mutable: bool, watch: Watcher) -> Watcher:
    """Return a watcher that compares everything that a method is given before and after the call."""

    def compare(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
        names = INPUTS.get(method, STATE_INPUTS)
        seen = [i for i in range(len(arguments)) if not (mutable and names[i] == "state")]
        before = [snapshot(arguments[i], names[i]) for i in seen]
        result = watch(method, tick, arguments, call)
        for i, old in zip(seen, before, strict=True):
            require_unchanged(old, snapshot(arguments[i], names[i]), f"by {method}() at tick {tick} of {scenario!r}")
        return result

    return compare

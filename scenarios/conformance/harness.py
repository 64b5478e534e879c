"""Runs an estimator on variations of small streams, notes what it believed and sent, and says where two runs differ."""

import pickle
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cooploc.estimators.interface import Array, Mask
from cooploc.scenarios import simulate
from cooploc.scenarios.conformance.perturb import own, thinned
from cooploc.scenarios.runner.channels import SENSED, IncompatibleEstimator, selected, visible
from cooploc.scenarios.runner.tick import EstimatorError, Watcher
from cooploc.scenarios.runner.trace import Trace, trace
from cooploc.scenarios.stream import Stream, Truth

_RADIO: dict[str, Any] = {"ticks": 12, "drop": 0.3}
_CAMERA: dict[str, Any] = {**_RADIO, "sight": 8.0, "view": 1.5}  # sees much: a short stream must say something
# One robot and one trial are a single row: the shape on which broadcasting goes its own ways.
SCENARIOS = {"robots-1-3/n=3": _RADIO, "robots-1-3/n=1": _RADIO, "camera/n=3": _CAMERA, "camera/n=1": _CAMERA}
TRIALS = 3


class Failed(Exception):
    """A check's verdict: one sentence with the fact and its place."""


class Skipped(Exception):
    """A check that does not apply, with the reason."""


class Recording(NamedTuple):
    """What an estimator believed and put on the air."""

    trace: Trace
    said: tuple[Array, ...]  # per tick what send returned, (t, n, ...); empty for a team
    given: Stream  # the copy that it ran on


class Bench:
    """An estimator, the small streams that fit it, and how it ran on them."""

    def __init__(self, name: str, estimator: Any, seed: int, trials: int = TRIALS, ticks: int | None = None) -> None:
        self.name, self.estimator, self.seed = name, estimator, seed
        self.trials, self.ticks = trials, ticks  # fewer than usual: a small counterexample
        self.runs = 0

    @property
    def team(self) -> bool:
        return hasattr(self.estimator, "exchange")

    @property
    def bound(self) -> bool:
        return bool(self.team and self.estimator.bound)

    @property
    def rng(self) -> np.random.Generator:
        """The same generator every time, so that a check's outcome does not depend on those before it."""
        return np.random.default_rng(self.seed)

    @cached_property
    def deterministic(self) -> bool:
        """Whether its keys, the only randomness it may have, make no difference."""
        return all(
            np.array_equal(base.trace.x, self.run(replace(stream, seed=stream.seed + 1), "other keys").trace.x)
            for stream, base in zip(self.streams, self.base, strict=True)
        )

    def channels(self, stream: Stream) -> set[str]:
        """What its declaration selects of a stream."""
        return selected(self.name, tuple(self.estimator.uses), stream)

    def array(self, channel: str) -> str:
        """The name that a channel's readings have in `Stream.arrays`."""
        if channel.startswith("radio_"):
            return channel.replace("radio_", "air.")
        return f"senses.{channel}" if channel in SENSED else f"extra.{channel}"

    def truth(self, stream: Stream) -> Truth:
        """What was true behind one of the small streams, simulated again: the bench itself keeps none."""
        label = next(label for label, one in self._fitting if one is stream)
        return self._simulated(label)[0]

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The small streams that have what the estimator declares.

        Raises:
            Failed: there is none.

        """
        return tuple(stream for _, stream in self._fitting)

    @cached_property
    def _fitting(self) -> list[tuple[str, Stream]]:
        fitting, reasons = [], []
        for label in SCENARIOS:
            _, stream = self._simulated(label)
            try:
                visible(self.name, self.estimator, stream)
                thin = thinned(stream, self.rng)
                fitting.append((label, replace(thin, scenario=f"{stream.scenario}, some readings absent")))
            except IncompatibleEstimator as e:
                reasons.append(str(e))
        if not fitting:
            raise Failed("; ".join(reasons[::2]))  # the scenarios come in pairs
        return fitting

    def _simulated(self, label: str) -> tuple[Truth, Stream]:
        overrides = SCENARIOS[label] if self.ticks is None else {**SCENARIOS[label], "ticks": self.ticks}
        return simulate(label, trials=self.trials, seed=self.seed, **overrides)

    @cached_property
    def base(self) -> tuple[Recording, ...]:
        """How it runs on each stream as it is."""
        return tuple(self.run(stream, "as it is") for stream in self.streams)

    @property
    def teams(self) -> list[tuple[Stream, Recording]]:
        """The streams of more than one robot, and how it runs on them."""
        return [(s, base) for s, base in zip(self.streams, self.base, strict=True) if s.robots > 1]

    def run(
        self, stream: Stream, what: str, estimator: Any = None, audit: Callable[[Watcher], Watcher] | None = None
    ) -> Recording:
        """Run the estimator, or another in its place, on a copy of the stream; `what` says which variation it is.

        Raises:
            Failed: it raised, or broke the interface; says in which method, tick and variation.

        """
        recorder, given = Recorder(), own(stream)
        ran = self.estimator if estimator is None else estimator
        self.runs += 1
        try:
            done = trace(self.name, ran, given, audit(recorder) if audit else recorder)
        except Failed:
            raise
        except (EstimatorError, IncompatibleEstimator) as e:
            raise Failed(f"{e} ({what})") from e
        except (Exception, SystemExit) as e:
            where = f"{recorder.method}() raised at tick {recorder.tick} of {stream.scenario!r} ({what})"
            raise Failed(f"{where}: {explained(e)}") from e
        t, _, n = stream.senses.dt.shape
        return Recording(done, tuple(said.reshape(t, n, -1) for said in recorder.said), given)


class Recorder:
    """A runner's watcher that knows which method is running, and keeps what was sent."""

    def __init__(self) -> None:
        self.method, self.tick = "init", -1
        self.said: list[Array] = []

    def __call__(self, method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
        self.method, self.tick = method, tick
        result = call(*arguments)
        if method == "send":
            sent = np.array(result, float)
            self.said.append(np.where(np.isnan(sent), np.nan, sent))  # one nan, whatever its bits
        return result


def demand_same(
    a: Recording, b: Recording, stream: Stream, when: str, robots: Mask | None = None, ticks: int | None = None
) -> None:
    """Hold two runs bitwise equal, at these robots (n,) and in the first ticks.

    Raises:
        Failed: they differ; says what, where, and `when`.

    """
    for what, differs in (("estimate", _estimates_differ(a, b)), ("packet", _packets_differ(a, b))):
        differs = differs[:, :ticks] & (np.ones(stream.robots, bool) if robots is None else robots)
        if differs.any():
            tick, trial, robot = np.argwhere(differs.swapaxes(0, 1))[0]
            raise Failed(
                f"robot {robot}'s {what} changed when {when}: {stream.scenario!r}, trial {stream.trial[trial]}, "
                f"tick {tick}"
            )


def pickled(estimator: Any) -> Any:
    """The estimator after a round trip through pickle.

    Raises:
        Failed: it cannot be pickled or read back.

    """
    try:
        return pickle.loads(pickle.dumps(estimator))
    except Exception as e:
        raise Failed(f"it cannot be pickled, and so not be run in parallel: {explained(e)}") from e


def explained(e: BaseException) -> str:
    """An exception in one line."""
    said = " ".join(re.sub(r" at 0x[0-9a-f]+", "", f"{type(e).__name__}: {e}").split())
    return f"{said}; an input is never written to: copy it first" if "read-only" in said else said


def _estimates_differ(a: Recording, b: Recording) -> Mask:
    """(t, T, n), over the ticks that both have."""
    T = min(a.trace.x.shape[1], b.trace.x.shape[1])
    x: Mask = (_bits(a.trace.x[:, :T]) != _bits(b.trace.x[:, :T])).any(-1)
    P: Mask = (_bits(a.trace.P[:, :T]) != _bits(b.trace.P[:, :T])).any((-2, -1))
    return x | P


def _packets_differ(a: Recording, b: Recording) -> Mask:
    """(t, T, n), over the ticks that both have."""
    t, _, n = a.given.senses.dt.shape
    ticks = [
        (_bits(p) != _bits(q)).any(-1) if p.shape == q.shape else np.ones((t, n), bool)
        for p, q in zip(a.said, b.said, strict=False)
    ]
    return np.stack(ticks, 1) if ticks else np.zeros((t, 0, n), bool)


def _bits(a: Array) -> NDArray[np.uint64]:
    return np.ascontiguousarray(a).view(np.uint64)

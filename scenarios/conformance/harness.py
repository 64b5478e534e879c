"""Runs an estimator on variations of small streams, and records what it believed and transmitted."""

import inspect
import pickle
import re
import traceback
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import cloudpickle
import numpy as np

from cooploc.estimators import errors
from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.registry import Traits, traits
from cooploc.scenarios import simulate
from cooploc.scenarios.conformance.compare import CheckFailed, RunRecord, require_equal
from cooploc.scenarios.conformance.perturb import deep_copy, drop_readings
from cooploc.scenarios.runner.tick import (
    SENSED,
    EstimatorError,
    IncompatibleEstimator,
    Watcher,
    select_channels,
    visible,
)
from cooploc.scenarios.runner.trace import trace
from cooploc.scenarios.stream import Stream, Truth

_RADIO: dict[str, Any] = {"ticks": 12, "drop": 0.3}
_CAMERA: dict[str, Any] = {**_RADIO, "sight": 8.0, "view": 1.5}  # wide view: even a short stream has sightings
# One robot and one trial are a single row: the shape on which mistakes in broadcasting show.
SCENARIOS = {"robots-1-3/n=3": _RADIO, "robots-1-3/n=1": _RADIO, "camera/n=3": _CAMERA, "camera/n=1": _CAMERA}
TRIALS = 3


class Harness:
    """An estimator, the small streams that it can run on, and how it ran on them.

    Args:
        name: what to call the estimator.
        estimator: an instance.
        seed: seeds the streams, and what is done to them.
        trials: trials of each stream.
        ticks: length of each stream; None: that of `SCENARIOS`.

    """

    def __init__(self, name: str, estimator: Any, seed: int, trials: int = TRIALS, ticks: int | None = None) -> None:
        self.name, self.estimator, self.seed = name, estimator, seed
        self.trials, self.ticks = trials, ticks
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
        for stream, base in self.cases:
            other = self.run(replace(stream, seed=stream.seed + 1), "rows.key was different").trace
            if not (np.array_equal(base.trace.x, other.x) and np.array_equal(base.trace.P, other.P)):
                return False
        return True

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
        """The channels of a stream that its declaration selects."""
        return select_channels(self.name, tuple(self.estimator.uses), stream)

    def array(self, channel: str) -> str:
        """The name that a channel's readings have in `Stream.arrays`."""
        if channel.startswith("radio_"):
            return channel.replace("radio_", "air.")
        return f"senses.{channel}" if channel in SENSED else f"extra.{channel}"

    def truth(self, stream: Stream) -> Truth:
        """The truth of one of the small streams, simulated again: the harness itself keeps none."""
        label = next(label for label, one in self._labelled if one is stream)
        return self._simulated(label)[0]

    def run(
        self, stream: Stream, when: str, estimator: Any = None, audit: Callable[[Watcher], Watcher] | None = None
    ) -> RunRecord:
        """Run the estimator on a copy of a stream.

        Args:
            stream: what it is given.
            when: the variation, for messages: "no packet arrived".
            estimator: runs in its place.
            audit: wraps the watcher that sees every call.

        Raises:
            CheckFailed: it raised, or broke the interface; says in which method, tick and variation.

        """
        recorder, given = _CallRecorder(), deep_copy(stream)
        self.runs += 1
        try:
            ran = self.estimator if estimator is None else estimator
            found = trace(self.name, ran, given, audit(recorder) if audit else recorder, any_covariance=True)
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
            _, stream = self._simulated(label)
            try:
                visible(self.name, self.estimator, stream)
                sparse = drop_readings(stream, self.rng)
                fitting.append((label, replace(sparse, scenario=f"{stream.scenario}, some readings absent")))
            except IncompatibleEstimator as e:
                reasons.append(str(e))
        if not fitting:
            raise CheckFailed("; ".join(reasons[::2]))  # the scenarios come in pairs
        return fitting

    def _simulated(self, label: str) -> tuple[Truth, Stream]:
        overrides = SCENARIOS[label] if self.ticks is None else {**SCENARIOS[label], "ticks": self.ticks}
        return simulate(label, trials=self.trials, seed=self.seed, **overrides)


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
    """The estimator after a round trip through pickle; where a class of it came here by value, through cloudpickle.

    Raises:
        CheckFailed: it cannot be pickled or read back.

    """
    try:
        return pickle.loads(_pickle(estimator))
    except Exception as e:
        raise CheckFailed(f"it cannot be pickled, so it cannot run in parallel: {one_line(e)}") from e


def _pickle(estimator: Any) -> bytes:
    try:
        return pickle.dumps(estimator)
    except pickle.PicklingError as e:
        # The class of a file or of a notebook: only the process that sent it has that module.
        if "import of module" not in str(e):
            raise
        return bytes(cloudpickle.dumps(estimator))


def one_line(e: BaseException) -> str:
    """An exception in one line, without memory addresses."""
    return re.sub(r" at 0x[0-9a-f]+", "", errors.one_line(e))


def _remedy(e: BaseException) -> str:
    if "read-only" in one_line(e):
        return "an input is read-only: copy the array before you write to it"
    return "make the method work on such input too: nan is an absent reading, width 0 an absent channel"


def raised_by(e: BaseException, estimator: Any) -> bool:
    """Whether an exception came out of an estimator's own code, or of what that called."""
    members = [member for cls in type(estimator).__mro__ for member in vars(cls).values()]
    functions = [getattr(member, "fget", None) or getattr(member, "__func__", member) for member in members]
    files = {one.__code__.co_filename for one in functions if inspect.isfunction(one)}
    return any(frame.filename in files for frame in traceback.extract_tb(e.__traceback__))

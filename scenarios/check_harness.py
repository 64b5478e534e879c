"""An estimator that is checked, run on small simulated streams, and what is compared of two runs, bit by bit."""

import math
import time
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.errors import one_line
from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.registry import traits
from cooploc.scenarios import resolve, simulate, variations
from cooploc.scenarios.process import limit_time, place_of
from cooploc.scenarios.runner.tick import EstimatorError, IncompatibleEstimator, Watcher, select_channels
from cooploc.scenarios.runner.trace import ROUNDING, Trace, require_fit, trace
from cooploc.scenarios.stream import Stream

TRIALS, TICKS = 3, 12
WITH_GAPS = ", some readings absent"  # behind the label
RUN_SHARE = 0.1  # of the time limit, for each run
TIME_OVER = "of all checks were over"  # words of a check that was skipped for that
_RADIO: dict[str, Any] = {"ticks": TICKS, "drop": 0.3}
_CAMERA: dict[str, Any] = {**_RADIO, "sight": 8.0, "view": 1.5}  # wide view: even a short stream has sightings
# One robot and one trial are a single row: the shape on which mistakes in broadcasting show.
SCENARIOS = {"robots-1-3/n=3": _RADIO, "robots-1-3/n=1": _RADIO, "camera/n=3": _CAMERA, "camera/n=1": _CAMERA}
MOST_OTHERS = 2  # scenarios of the caller, which are asked where an estimator reads what none of these has
RECORDED = 5  # times as long is a recording, which has readings in few ticks


class CheckFailed(Exception):
    """A fault: one sentence with its place, and a remedy where the check's own does not fit."""

    def __init__(self, found: str, remedy: str = "") -> None:
        super().__init__(found)
        self.remedy = remedy


class CheckSkipped(Exception):
    """The reason why a check does not apply to an estimator, or is not made."""


class RunRecord(NamedTuple):
    """The beliefs and packets of one run."""

    trace: Trace
    packets: tuple[Array, ...]  # (t, n, ...) per tick, what send() returned; empty for a team estimator
    stream: Stream

    def select(self, trials: list[int]) -> "RunRecord":
        """Return the record of these trials, in this order."""
        t = self.trace
        found = replace(t, x=t.x[trials], P=t.P[trials], messages=t.messages[trials], bytes=t.bytes[trials])
        return RunRecord(found, tuple(sent[trials] for sent in self.packets), self.stream.select(trials))


class Harness:
    """An estimator, the small streams that it can run on, and how it ran on them."""

    def __init__(
        self,
        name: str,
        estimator: Any,
        seed: int,
        time_limit: float = math.inf,
        scenarios: Sequence[str] = (),
        data: Path | None = None,
        ticks: int = TICKS,
    ) -> None:
        """`time_limit` is of all its runs [s], of which one may take a tenth."""
        self.name, self.estimator, self.seed, self.time_limit = name, estimator, seed, time_limit
        self.scenarios, self.data, self.ticks, self.began = scenarios, data, ticks, time.monotonic()
        self.traits = traits(estimator) if not isinstance(estimator, type) else traits(None)
        self.centralised = self.traits.team and self.traits.centralised  # only a team estimator can be
        self.runs = 0

    @property
    def rng(self) -> np.random.Generator:
        """A generator that is the same every time, whichever checks came before."""
        return np.random.default_rng(self.seed)

    @cached_property
    def deterministic(self) -> bool:
        """Whether its keys, the only randomness that is allowed, make no difference."""
        return not any(self.differs(base, replace(stream, seed=stream.seed + 1)) for stream, base in self.cases)

    def of_length(self, ticks: int) -> "Harness":
        """Return the same with streams of so many ticks."""
        asked = self.scenarios, self.data, ticks
        return Harness(self.name, self.estimator, self.seed, self.time_limit, *asked)

    @cached_property
    def streams(self) -> list[Stream]:
        """The small streams on which the estimator does not refuse to start, some of their readings absent."""
        reasons: list[str] = []
        found = list(self._fitting(self._simulated(), reasons))
        known = {channel for stream in found for channel in self._channels(stream)}
        declared = {channel for wish in self.estimator.uses for channel in wish.rstrip("?").split("|")}
        if not found or declared - known:
            others = self._fitting(self._beginnings(), reasons)
            found += islice((s for s in others if self._channels(s) - known or not known), MOST_OTHERS)
        if not found:
            pairs = len(SCENARIOS)
            reason = "; ".join(dict.fromkeys([*reasons[:pairs:2], *reasons[pairs:]]))
            raise CheckFailed(reason, remedy_of(reason) or f"check it in a world that it is made for: {ELSEWHERE}")
        return found

    def _simulated(self) -> Iterator[Stream]:
        for label, overrides in SCENARIOS.items():
            yield simulate(label, trials=TRIALS, seed=self.seed, **{**overrides, "ticks": self.ticks})[1]

    def _beginnings(self) -> Iterator[Stream]:
        """Yield the first ticks of the other scenarios."""
        for label in self.scenarios:
            scenario = resolve(label, self.data)
            trials, ticks = (1, RECORDED * self.ticks) if scenario.is_recording else (TRIALS, self.ticks)
            yield scenario.of_length(ticks).simulate(trials, self.seed)[1].first_ticks(ticks)

    def _fitting(self, streams: Iterator[Stream], reasons: list[str]) -> Iterator[Stream]:
        """Yield the streams that the estimator can run on, with gaps, and note of the others why it cannot."""
        for stream in streams:
            try:
                require_fit(self.name, self.estimator, stream)
            except IncompatibleEstimator as e:
                reasons.append(str(e))
                continue
            sparse = variations.drop_readings(stream, self.rng)
            yield replace(sparse, scenario=stream.scenario + WITH_GAPS)

    @cached_property
    def cases(self) -> list[tuple[Stream, RunRecord]]:
        """The streams, and how it runs on each where nothing is changed."""
        return [(stream, self.run(stream, "")) for stream in self.streams]

    @property
    def team_cases(self) -> list[tuple[Stream, RunRecord]]:
        """The cases of more than one robot."""
        return [case for case in self.cases if case[0].robots > 1]

    def arrays(self, stream: Stream) -> dict[str, str]:
        """Return the channels that the estimator reads, with their names in `Stream.arrays`, if they have a reading."""
        named = {channel: variations.name_of_array(channel) for channel in sorted(self._channels(stream))}
        held = stream.arrays()
        return {c: name for c, name in named.items() if held[name].dtype.kind == "f" and np.isfinite(held[name]).any()}

    def _channels(self, stream: Stream) -> set[str]:
        return select_channels(self.name, self.estimator.uses, stream)

    def run(
        self,
        stream: Stream,
        when: str,
        estimator: Any = None,
        watch: Watcher | None = None,
        ticks: int | None = None,
    ) -> RunRecord:
        """Run the estimator, or another in its place, for all `ticks` or the first; `when` says what was changed."""
        sent: list[Any] = []
        at: tuple[str, int] = "init", -1
        t, _, n = stream.senses.dt.shape

        def record(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
            nonlocal at
            at = method, tick
            result = watch(method, tick, arguments, call) if watch else call(*arguments)
            if method == "send":
                sent.append(copy(result))  # the runner says what is wrong with it
            return result

        if self.runs >= len(SCENARIOS) and time.monotonic() > self.began + self.time_limit:
            slow = f"after {self.runs} runs the {self.time_limit:g} s {TIME_OVER}"
            raise CheckSkipped(f"{slow} (cooploc check --time-limit gives more)")
        self.runs += 1
        varied = f" ({when})" if when else ""
        try:
            with limit_time(RUN_SHARE * self.time_limit):
                found = trace(
                    self.name, self.estimator if estimator is None else estimator, stream, record, ticks=ticks
                )
        except CheckFailed:
            raise
        except (EstimatorError, IncompatibleEstimator) as e:
            raise CheckFailed(f"{e}{varied}", remedy_of(str(e))) from e
        except (Exception, SystemExit, GeneratorExit) as e:
            tick = f"at tick {at[1]} of" if at[1] >= 0 else "before the first tick of"
            where = f"{at[0]}() raised {tick} {stream.scenario!r}{varied}"
            raise CheckFailed(f"{where}: {one_line(e)}{place_of(e)}", remedy_of(one_line(e))) from e
        return RunRecord(found, tuple(np.asarray(one, float).reshape(t, n, -1) for one in sent), stream)

    def require_same(
        self, base: RunRecord, stream: Stream, when: str, robots: Mask | bool = True, ticks: int | None = None
    ) -> None:
        """Run on a variation of the stream; require the bits of `base`, of these robots and first ticks."""
        require_equal(base, self.run(stream, when, ticks=ticks), when, robots)

    def differs(self, base: RunRecord, stream: Stream) -> bool:
        """Return whether a variation of the stream changes any bit, or what runs."""
        try:
            self.require_same(base, stream, "it was changed")
        except CheckFailed:
            return True
        return False


def remedy_of(error: str) -> str:
    """Return what to change after an error with words of `CAUSES`; empty for another."""
    return next((remedy for words, remedy in CAUSES.items() if words in error), "")


def require_equal(a: RunRecord, b: RunRecord, when: str, robots: Mask | bool = True) -> None:
    """Require that two runs are bitwise equal, for these robots (n,) and in the first ticks that both have."""
    (t, T, n), other = a.stream.senses.dt.shape, b.trace.x.shape[1]
    for k in range(min(T, other)):
        pairs = [("estimate", getattr(a.trace, what)[:, k], getattr(b.trace, what)[:, k]) for what in ("x", "P")]
        if a.packets and b.packets:
            pairs.append(("packet", a.packets[k], b.packets[k]))
        for thing, p, q in pairs:
            bad = np.zeros((t, T, n), bool)
            bad[:, k] = p.shape != q.shape or (_bits(p) != _bits(q)).reshape(t, n, -1).any(-1)
            bad[:, k] &= robots
            if bad.any():
                by = np.abs(p - q).reshape(t, n, -1)[bad[:, k]].max() if p.shape == q.shape else np.nan
                rounding = ", which is rounding" * bool(by < ROUNDING)
                require_none(bad, a.stream, f"'s {thing} changed by up to {by:.2g}{rounding}, when {when}")


def _bits(a: Array) -> Any:
    return np.where(np.isnan(a), np.nan, a).view(np.uint64)  # one nan, whatever its bits


def require_none(bad: Mask, stream: Stream, fault: str) -> None:
    """Require that `bad` (t, T, n) holds nowhere; else name the robot, its fault, and the first place in time."""
    if bad.any():
        tick, trial, robot = map(int, np.argwhere(bad.swapaxes(0, 1))[0])
        raise CheckFailed(f"robot {robot}{fault}: {stream.scenario!r}, trial {stream.trial[trial]}, tick {tick}")


# What to change after an error, by its words.

ELSEWHERE = "cooploc check --scenario LABEL, in Python scenarios="
ABSENT_READINGS = "treat nan as an absent reading: leave that row as it is in that update"
COVARIANCES = "return (P + P.mT) / 2, and use an update that keeps P positive semidefinite, such as the Joseph form"
CAUSES = {  # words of an error -> what to change
    "covariance": COVARIANCES,
    "P is not finite": "treat nan as an absent reading; a method without covariances returns one of its own choice",
    "not finite": ABSENT_READINGS,
    "NaNs": ABSENT_READINGS,
    "KeyError": "world.sensors and z.extra hold the channels that `uses` names, and no others",
    "read-only": "inputs are read-only: copy an array before you write to it",
    "a trial, not": "return one entry for each robot: x (n, d), P (n, d, d)",
    "a pose there is x, y, heading": "return these of your state; a filter without a heading refuses the world: "
    "raise cl.BadInput('it has no heading') where prior.x.shape[-1] is 3",
    "a pose there is x, y": "return these of a longer state: x[:2], P[:2, :2]",
    "No module named": "install it beside cooploc",
    "shape": "cooploc.estimators.interface has the shape of every array",
    "attribute 'radio_": "the readings of teammates come with what was heard, in fuse(): mail.range, mail.rssi",
    "needs channel": "name in `uses` what these worlds have: 'a|b' is the first that there is, 'a?' one that may lack; "
    f"or check it where there is such a channel: {ELSEWHERE}",
}

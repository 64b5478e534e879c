"""The checks of `check_estimator`: each returns what it found in order, or raises `Failed` or `Skipped`.

To add one: write a function like these, and put it into `CHECKS`. Here are those of what reaches whom and when;
`secrecy`, `soundness` and `symmetry` have the others. Everything is compared bitwise but for what `symmetry` turns.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from cooploc.estimators.interface import API
from cooploc.scenarios.conformance import perturb
from cooploc.scenarios.conformance.equivariance import equivariance
from cooploc.scenarios.conformance.harness import Bench, Failed, Recording, Skipped, demand_same, pickled
from cooploc.scenarios.conformance.isolation import (
    declaration,
    no_global_randomness,
    no_memory,
    order_independence,
    truth_blindness,
)
from cooploc.scenarios.conformance.numerics import covariance, nan_safety, silence
from cooploc.scenarios.conformance.perturb import HOW
from cooploc.scenarios.conformance.snapshot import contents
from cooploc.scenarios.runner.tick import Watcher
from cooploc.scenarios.stream import Stream

Check = Callable[[Bench], str]

ROW_METHODS = ("init", "predict", "correct", "send", "fuse", "estimate")
TEAM_METHODS = ("init", "predict", "correct", "exchange", "estimate")


def runs(bench: Bench) -> str:
    """It speaks this version of the interface, has its methods, and its estimates are finite and of the right shape."""
    estimator = bench.estimator
    if isinstance(estimator, type):
        raise Failed(f"it is the class {estimator.__name__}, not an instance: make one")
    if getattr(estimator, "api", None) != API:
        raise Failed(f"it is written for interface {getattr(estimator, 'api', None)!r}; set api = {API}")
    for method in TEAM_METHODS if bench.team else ROW_METHODS:
        if not callable(getattr(estimator, method, None)):
            raise Failed(f"it has no method {method}()")
    if bench.team and not isinstance(getattr(estimator, "bound", None), bool):
        raise Failed("it does not say whether it is a bound: set bound = True or False")
    uses = getattr(estimator, "uses", None)
    if not isinstance(uses, tuple) or not all(isinstance(wish, str) for wish in uses):
        raise Failed(f"uses is {uses!r}; it must be a tuple of channel names, such as ('odometry', 'anchor_rssi')")
    labels = [stream.scenario.partition("[")[0] for stream in bench.streams]
    t, T, _, _ = bench.base[0].trace.x.shape
    return f"{t} trials of {T} ticks of {', '.join(labels)}"


def non_interference(bench: Bench) -> str:
    """No link holds: whatever one robot senses, nobody else's estimate or packet changes."""
    if bench.bound:
        raise Skipped("it is a bound and sees the whole team by definition")
    for stream, _ in bench.teams:
        alone = perturb.silent(stream)
        base = bench.run(alone, "no packet arrives")
        for robot in range(stream.robots):
            for how in HOW:
                when = f"robot {robot}'s readings were {how} while no packet arrived"
                other = bench.run(perturb.disturbed(alone, how, bench.rng, robot), when)
                demand_same(base, other, stream, when, np.arange(stream.robots) != robot)
    return f"nobody noticed any robot's readings being {' or '.join(HOW)} while no packet arrived"


def link_honesty(bench: Bench) -> str:
    """A packet that was dropped changes nothing, and neither does a radio reading of it."""
    measured = [(s, base) for s, base in bench.teams if s.channels() & {"radio_rssi", "radio_range"}]
    if bench.bound and not measured:
        raise Skipped("it is a bound, needs no packets, and no scenario that fits it measures them")
    for stream, base in measured:
        for how in HOW:
            when = f"radio readings of packets that were dropped were {how}"
            demand_same(base, bench.run(perturb.deaf_radio(stream, how, bench.rng), when), stream, when)
    if bench.bound:
        return "radio readings of dropped packets changed nothing; as a bound it needs no packets"
    for stream, _ in bench.teams:
        for robot in range(stream.robots):
            _dropped_packets_say_nothing(bench, stream, robot)
    return "neither radio readings of dropped packets nor what they would have said changed anything"


def causality(bench: Bench) -> str:
    """Nothing up to tick k depends on what comes after it: all trials together, and one alone."""
    for stream, base in zip(bench.streams, bench.base, strict=True):
        last = len(stream.time)
        for k in (last // 4, 2 * last // 3):
            _future_changes_nothing(bench, stream, base, k)
        # A single trial may be handed out as a view of the whole stream.
        one = stream.select([0])
        _future_changes_nothing(bench, one, bench.run(one, "one trial"), last // 2)
    return f"readings and links of the future were {', '.join(HOW)} and cut off, and changed nothing before them"


def chunk_invariance(bench: Bench) -> str:
    """Every trial alone, in another order and in parts: the same estimates, packets and traffic."""
    for stream, base in zip(bench.streams, bench.base, strict=True):
        everyone = list(range(len(stream.trial)))
        parts = [[i] for i in everyone] + [everyone[::-1], everyone[1:]]
        for order in parts:
            when = f"trials {stream.trial[order].tolist()} ran instead of all {len(everyone)} in order"
            part = stream.select(order)
            got = bench.run(part, when)
            demand_same(_chosen(base, order), got, part, when)
            for what in ("messages", "bytes"):
                before, now = getattr(base.trace, what)[order], getattr(got.trace, what)
                if not np.array_equal(before, now):
                    trial, robot = np.argwhere(before != now)[0]
                    raise Failed(
                        f"robot {robot} sent other {what} when {when}: {stream.scenario!r}, trial {part.trial[trial]}"
                    )
    return "every trial alone, in reverse order and in parts gives the same bits"


def immutability(bench: Bench) -> str:
    """Methods write to nothing they are given, parameters stay, and a second run gives what the first gave."""
    before = contents(bench.estimator, "its parameters")
    for stream, base in zip(bench.streams, bench.base, strict=True):
        again = bench.run(stream, "run again", audit=partial(_audited, stream.scenario, _exempt(bench)))
        _demand_unchanged(_told(stream), _told(again.given), f"during the run of {stream.scenario!r}")
        demand_same(base, again, stream, "it ran a second time")
    _demand_unchanged(before, contents(bench.estimator, "its parameters"), "by running")
    state = "its state is exempt: it declares itself mutable" if _exempt(bench) else "no state is changed in place"
    return f"no input is written to, {state}, a second run gives the same bits"


def pickling(bench: Bench) -> str:
    """The estimator that comes back from pickle gives the same bits."""
    copy = pickled(bench.estimator)
    for stream, base in zip(bench.streams, bench.base, strict=True):
        what = "after a round trip through pickle"
        demand_same(base, bench.run(stream, what, estimator=copy), stream, f"it ran {what}")
    return "the same bits after a round trip through pickle"


CHECKS: tuple[Check, ...] = (
    runs,
    non_interference,
    link_honesty,
    causality,
    chunk_invariance,
    immutability,
    no_memory,
    no_global_randomness,
    order_independence,
    truth_blindness,
    nan_safety,
    covariance,
    silence,
    declaration,
    equivariance,
    pickling,
)


def _dropped_packets_say_nothing(bench: Bench, stream: Stream, robot: int) -> None:
    since = len(stream.time) // 3
    cut = perturb.silent(stream, robot, since)
    base = bench.run(cut, f"no packet of robot {robot} arrives from tick {since} on")
    for how in HOW:
        when = f"robot {robot}'s readings were {how} from tick {since} on while all its packets were dropped"
        other = bench.run(perturb.disturbed(cut, how, bench.rng, robot, since), when)
        demand_same(base, other, stream, when, np.arange(stream.robots) != robot)


def _future_changes_nothing(bench: Bench, stream: Stream, base: Recording, k: int) -> None:
    for how in HOW:
        when = f"readings and links after tick {k} were {how}"
        other = perturb.disturbed(stream, how, bench.rng, since=k + 1)
        demand_same(base, bench.run(perturb.relinked(other, how, bench.rng, k + 1), when), stream, when, ticks=k + 1)
    when = f"the stream ended after tick {k}"
    demand_same(base, bench.run(stream.truncated(k + 1), when), stream, when)


def _chosen(recording: Recording, order: list[int]) -> Recording:
    t = recording.trace
    trace = replace(t, x=t.x[order], P=t.P[order], messages=t.messages[order], bytes=t.bytes[order])
    return Recording(trace, tuple(said[order] for said in recording.said), recording.given.select(order))


def _exempt(bench: Bench) -> bool:
    """Objects lifted by PerRobot change in place, and say so."""
    return bool(getattr(bench.estimator, "mutable", False))


def _audited(scenario: str, mutable: bool, watch: Watcher) -> Watcher:
    """Compares everything a method is given before and after the call."""

    def audit(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
        names = ("prior", "world", "rows") if method == "init" else ("state", "senses", "mail")
        kept = [i for i in range(len(arguments)) if not (mutable and names[i] == "state")]
        before = [contents(arguments[i], names[i]) for i in kept]
        result = watch(method, tick, arguments, call)
        for i, old in zip(kept, before, strict=True):
            _demand_unchanged(old, contents(arguments[i], names[i]), f"by {method}() at tick {tick} of {scenario!r}")
        return result

    return audit


def _told(stream: Stream) -> dict[str, Any]:
    return contents(
        {**stream.arrays(), "time": stream.time, "trial": stream.trial, "world": stream.world}, "the stream"
    )


def _demand_unchanged(before: dict[str, Any], after: dict[str, Any], when: str) -> None:
    for path in [*before, *after]:
        if before.get(path) != after.get(path):
            raise Failed(f"{path} was changed {when}")

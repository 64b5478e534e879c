"""The twelve checks of `check_estimator`, in the order in which they run.

To add one: write a function that takes a `Harness`, returns what it tried and saw, and raises `CheckFailed` or
`CheckSkipped`; give it a line with its remedy in `CHECKS`. All but equivariance compare bitwise.
"""

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators import make
from cooploc.estimators.interface import API, Array, Belief, Mail, Mask
from cooploc.estimators.models import Displacement, Unicycle, wrap_heading
from cooploc.scenarios.conformance import variations as vary
from cooploc.scenarios.conformance.harness import (
    CheckFailed,
    CheckSkipped,
    Harness,
    RunRecord,
    earliest,
    fail_at,
    pickled,
    require_equal,
    require_none,
    require_unchanged,
    snapshot,
    watch_inputs,
)
from cooploc.scenarios.conformance.variations import MODES
from cooploc.scenarios.runner.tick import Watcher
from cooploc.scenarios.runner.trace import NOTHING, ROUNDING, trace
from cooploc.scenarios.stream import Stream

METHODS = {
    "row": ("init", "predict", "correct", "send", "fuse", "estimate"),
    "team": ("init", "predict", "correct", "exchange", "estimate"),
    "offline": ("smooth",),
}
LONG = 120  # ticks of the longer streams, on which a channel that is seldom used is looked for again
# Allowed distance from dead reckoning, in its standard deviations: an unscented filter's mean differs to second order.
OFF_TRACK = 0.02
TOLERANCE = 0.05  # of the stated standard deviation by which an estimate may miss a turned world
ROUNDED = 1e-6  # [m], [rad] and their squares
QUIET = "nothing was sensed but odometry and no packet arrived"


def runs(harness: Harness) -> str:
    """It has the methods of the interface, and its estimates are finite and of the right shape."""
    estimator, uses, traits = harness.estimator, getattr(harness.estimator, "uses", None), harness.traits
    if isinstance(estimator, type):
        raise CheckFailed(f"it is the class {estimator.__name__}, not an instance", f"pass {estimator.__name__}()")
    if getattr(estimator, "api", None) != API:
        raise CheckFailed(f"it is written for interface {getattr(estimator, 'api', None)!r}", f"set api = {API}")
    for method in METHODS["offline" if traits.offline else "team" if traits.team else "row"]:
        if not callable(getattr(estimator, method, None)):
            raise CheckFailed(f"it has no method {method}()", "add it; cooploc.estimators.interface describes it")
    if traits.team and not traits.offline and not isinstance(getattr(estimator, "bound", None), bool):
        raise CheckFailed("it does not say whether it is a bound", "set bound = True or bound = False")
    if not isinstance(uses, tuple) or not all(isinstance(wish, str) for wish in uses):
        remedy = 'set it to a tuple of channel names, such as ("odometry", "anchor_rssi")'
        raise CheckFailed(f"uses is {uses!r}, not a tuple of channel names", remedy)
    labels = [stream.scenario.partition("[")[0] for stream in harness.streams]
    t, T, _, _ = harness.cases[0][1].trace.x.shape
    return f"ran on {t} trials of {T} ticks of {', '.join(labels)}: every estimate is finite and of the right shape"


def determinism(harness: Harness) -> str:
    """Runs with everything the same give the same bits: other runs between, global generators seeded, after pickle."""
    for stream, base in harness.cases:
        when = "it ran a second time, with everything the same"
        with _seed_globally(1) as changed:
            again, name = harness.run(stream, when), changed()
        try:
            require_equal(base, again, when)
        except CheckFailed as e:
            drawn = f"it draws from {name}" if name else "it draws from neither random nor numpy.random"
            raise CheckFailed(f"{drawn}, and does not repeat itself: {e}", "" if name else UNLIKE) from None
        if name:
            raise CheckFailed(f"it drew from or seeded {name}, on {stream.scenario!r}")
        harness.run(stream.select([0]).first_ticks(3), "another, shorter stream came before")
        harness.require_same(base, stream, "another run came before")
        copy, when = pickled(harness.estimator), "it ran after a round trip through pickle"
        require_equal(base, harness.run(stream, when, estimator=copy), when)
    return (
        "it ran again, after other runs, with other global seeds and after a round trip through pickle: the same bits"
    )


def truth_blindness(harness: Harness) -> str:
    """The same stream with its truth and with another truth in memory, and under another label: the same bits."""
    for stream, base in harness.cases:
        for shift, when in ((0.0, "its truth was in memory"), (1.0, "another truth was in memory")):
            truth = harness.truth(stream)
            truth = replace(truth, x=truth.x + shift)
            found = harness.run(stream, when)
            del truth
            require_equal(base, found, when)
        harness.require_same(base, replace(stream, scenario="another label"), "the stream had another label")
    return "it ran with its truth and another truth in memory, and under another label: the same bits"


def causality(harness: Harness) -> str:
    """Nothing up to tick k depends on what comes after it: with all trials together, and with one alone."""
    if harness.traits.offline:
        raise CheckSkipped("it is offline: it sees later readings by definition")
    for stream, base in harness.cases:
        last = len(stream.time)
        for k in (last // 4, 2 * last // 3):
            _require_future_ignored(harness, stream, base, k)
        one = stream.select([0])  # a single trial may be a view of the whole stream
        _require_future_ignored(harness, one, harness.run(one, "one trial ran alone"), last // 2)
    return "future readings and links were perturbed, hidden and cut off: nothing before them changed"


def _require_future_ignored(harness: Harness, stream: Stream, base: RunRecord, k: int) -> None:
    for mode in MODES:
        other = vary.perturb_readings(stream, mode, harness.rng, since=k + 1)
        other = vary.perturb_links(other, mode, harness.rng, k + 1)
        harness.require_same(base, other, f"readings and links after tick {k} were {mode}", ticks=k + 1)
    harness.require_same(base, stream.first_ticks(k + 1), f"the stream ended after tick {k}")


def link_honesty(harness: Harness) -> str:
    """A dropped packet changes nothing, nor does a radio reading of it; and nothing but mail reaches another robot."""
    measured = [(s, base) for s, base in harness.team_cases if s.channels() & {"radio_rssi", "radio_range"}]
    if harness.centralised and not measured:
        raise CheckSkipped("it is centralised and needs no packets, and no scenario that it can run on measures them")
    for stream, base in measured:
        for mode in MODES:
            when = f"radio readings of dropped packets were {mode}"
            harness.require_same(base, vary.perturb_dropped_radio(stream, mode, harness.rng), when)
    if harness.centralised:
        return "radio readings of dropped packets were perturbed and hidden: nothing changed; it needs no packets"
    for stream, _ in harness.team_cases:
        for robot in range(stream.robots):
            _require_drops_ignored(harness, stream, robot)
        if not harness.traits.team:  # for a team the runner carries no packets
            _require_mail_alone(harness, stream)
    return "readings and contents of dropped packets, and readings behind unchanged mail, made no difference"


def _require_drops_ignored(harness: Harness, stream: Stream, robot: int) -> None:
    since = len(stream.time) // 3
    cut = vary.drop_packets(stream, robot, since)
    base = harness.run(cut, f"no packet of robot {robot} arrived from tick {since} on")
    for mode in MODES:
        when = f"robot {robot}'s readings were {mode} from tick {since} on while all its packets were dropped"
        other = vary.perturb_readings(cut, mode, harness.rng, robot, since)
        harness.require_same(base, other, when, np.arange(stream.robots) != robot)


def _require_mail_alone(harness: Harness, stream: Stream) -> None:
    """One robot's readings change while all robots get the mail of before: no other robot's result changes.

    It finds an estimator that reads a neighbour's row only where it has heard that neighbour.
    """
    mails: dict[int, Mail] = {}

    def record(watch: Watcher) -> Watcher:
        def recording(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
            if method == "fuse":
                mails[tick] = arguments[2]
            return watch(method, tick, arguments, call)

        return recording

    def replay(watch: Watcher) -> Watcher:
        def replaying(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
            given = (*arguments[:2], mails[tick]) if method == "fuse" else arguments
            return watch(method, tick, given, call)

        return replaying

    base = harness.run(stream, "nothing was changed", watch=record)
    for robot in range(stream.robots):
        for mode in MODES:
            when = f"robot {robot}'s readings were {mode} while the mail stayed as it was"
            other = vary.perturb_readings(stream, mode, harness.rng, robot)
            require_equal(base, harness.run(other, when, watch=replay), when, np.arange(stream.robots) != robot)


def non_interference(harness: Harness) -> str:
    """Rows are independent: of other trials, and while no packet arrives of other robots."""
    for stream, _ in [] if harness.centralised else harness.team_cases:
        alone = vary.drop_packets(stream)
        base = harness.run(alone, "no packet arrived")
        for robot in range(stream.robots):
            for mode in MODES:
                when = f"robot {robot}'s readings were {mode} while no packet arrived"
                other = vary.perturb_readings(alone, mode, harness.rng, robot)
                harness.require_same(base, other, when, np.arange(stream.robots) != robot)
    for stream, base in harness.cases:
        everything = list(range(len(stream.trial)))
        for order in (*([i] for i in everything), everything[::-1]):
            when = f"trials {stream.trial[order].tolist()} ran instead of all {len(everything)} in order"
            expected, found = base.select(order), harness.run(stream.select(order), when)
            require_equal(expected, found, when)
            for what in ("messages", "bytes"):
                differs = getattr(expected.trace, what) != getattr(found.trace, what)
                require_none(differs[:, None], found.stream, f" sent other {what} when {when}")
    if harness.centralised:
        return "trials alone and in reverse order: the same bits; of other robots it knows all, as it is centralised"
    return "trials alone and in reverse order, other robots' readings changed without a packet: the same bits"


def immutability(harness: Harness) -> str:
    """Methods write to nothing that they are given, and parameters stay."""
    before = snapshot(harness.estimator, "its parameters")
    for stream, base in harness.cases:
        watch = partial(watch_inputs, stream.scenario, harness.traits.mutable)
        again = harness.run(stream, "it ran a second time", watch=watch)
        whole, after = (snapshot(_inputs(one), "the stream") for one in (stream, again.stream))
        require_unchanged(whole, after, f"during the run of {stream.scenario!r}")
        require_equal(base, again, "it ran a second time")
    require_unchanged(before, snapshot(harness.estimator, "its parameters"), "by running")
    exempt = "; its state is exempt, as it declares mutable = True" if harness.traits.mutable else ""
    return f"inputs, states and parameters were compared before and after each call: no change{exempt}"


def _inputs(stream: Stream) -> dict[str, Any]:
    return {**stream.arrays(), "time": stream.time, "trial": stream.trial, "world": stream.world}


def nan_safety(harness: Harness) -> str:
    """Single readings absent, one channel absent, odometry absent: every estimate stays finite."""
    ways = 0
    for stream in harness.streams:
        for channel in sorted(harness.channels(stream)):
            name = harness.array(channel)
            array = stream.arrays()[name]
            single = np.where(harness.rng.uniform(size=array.shape) < 0.3, np.nan, array)
            for other, which in ((single, "single readings"), (np.full_like(array, np.nan), "all readings")):
                when = f"{which} of {channel} were absent"
                require_covariance(harness.run(stream.with_arrays({name: other}), when), when)
                ways += 1
    if not ways:
        raise CheckSkipped("it reads no channel")
    return f"single and all readings of each channel were made absent in {ways} ways: every estimate stayed finite"


def covariance(harness: Harness) -> str:
    """Every covariance is symmetric and has no negative variance, in any direction."""
    for stream, base in harness.cases:
        require_covariance(base, "nothing was changed")
        for mode in MODES:
            when = f"readings were {mode}"
            require_covariance(harness.run(vary.perturb_readings(stream, mode, harness.rng), when), when)
    return f"P was symmetric and positive semidefinite to {ROUNDING:g} of its largest entry at every tick"


def require_covariance(found: RunRecord, when: str) -> None:
    """Require that every covariance is symmetric and has no negative variance.

    Raises:
        CheckFailed: one is not; says where and by how much.

    """
    P = found.trace.P
    scale = np.maximum(np.abs(P).max((-2, -1)), NOTHING)
    asymmetry = np.abs(P - P.mT).max((-2, -1))
    least = np.linalg.eigvalsh((P + P.mT) / 2)[..., 0]
    skew, negative = float((asymmetry / scale).max()), float((least / scale).min())
    of = f"of its largest entry, when {when}"
    require_none(asymmetry > ROUNDING * scale, found.stream, f"'s covariance is not symmetric, by {skew:.1e} {of}")
    fault = f"'s covariance has a negative variance, {negative:.1e} {of}"
    require_none(least < -ROUNDING * scale, found.stream, fault)


def silence(harness: Harness) -> str:
    """With odometry alone it moves as dead reckoning does, and its uncertainty never shrinks.

    A deterministic estimator agrees to `OFF_TRACK` of dead reckoning's standard deviation, one that samples to one
    standard deviation of what odometry adds. Where odometry has led out of the arena it may do as it likes: an
    estimator may know that no robot is there.
    """
    if harness.traits.own_motion:
        raise CheckSkipped(f"own_motion: {harness.traits.own_motion}")
    moving = [stream for stream in harness.streams if "odometry" in harness.channels(stream)]
    if not moving:
        raise CheckSkipped("it declares no odometry, so where it goes without other readings is its own affair")
    for stream in moving:
        quiet = vary.only_odometry(stream)
        found, dead = harness.run(quiet, QUIET), trace("dead-reckoning", make("dead-reckoning"), quiet)
        variance = _position_variance(dead.P)
        growth = np.sqrt(np.maximum(variance - variance[:, :1], 0.0))
        allowed = OFF_TRACK * np.sqrt(variance) if harness.deterministic else growth + 0.1 * growth[:, -1:]
        moved, expected = (x[..., :2] - x[:, :1, :, :2] for x in (found.trace.x, dead.x))
        low, high = quiet.world.arena
        inside = ((dead.x[..., :2] > low) & (dead.x[..., :2] < high)).all(-1)
        so_far: Array = np.logical_and.accumulate(inside, axis=1)
        off = np.where(so_far, np.sqrt(((moved - expected) ** 2).sum(-1)), 0.0)
        if (off > allowed).any():
            where = earliest(off > allowed)
            limit = f"where {allowed[where]:.2g} m is allowed, when {QUIET}"
            fail_at(where, quiet, f" is {off[where]:.2g} m away from where odometry leads, {limit}")
        if harness.deterministic:
            stated = _position_variance(found.trace.P)
            shrunk = np.diff(stated, axis=1, prepend=stated[:, :1]) < -ROUNDING * stated
            require_none(shrunk, found.stream, f"'s position variance shrank when {QUIET}")
    agrees = "and its uncertainty never shrank" if harness.deterministic else "to one standard deviation"
    return f"{QUIET}: it moved as dead reckoning does, {agrees}"


def _position_variance(P: Array) -> Array:
    variance: Array = P[..., 0, 0] + P[..., 1, 1]
    return variance


def declaration(harness: Harness) -> str:
    """Every channel that it declares changes an estimate somewhere, no other one does, and a team's traffic adds up.

    A channel that matters seldom, as where fusion seldom pays, is looked for again in longer streams, and in streams in
    which the robots do not start equally certain: covariance intersection of equal beliefs never pays.
    """
    for stream, base in harness.cases:
        messages, sent = base.trace.messages, base.trace.bytes
        sound = np.isfinite(messages) & (messages >= 0) & (messages == np.round(messages)) & (sent >= 8 * messages)
        sound &= (messages > 0) | (sent == 0)
        require_none(~sound[:, None], stream, " states messages and bytes of which each has no header of 8 bytes")
        for channel in sorted(stream.channels() - harness.channels(stream)):
            name = harness.array(channel)
            hidden = stream.with_arrays({name: np.full_like(stream.arrays()[name], np.nan)})
            harness.require_same(base, hidden, f"{channel}, which it does not declare, was hidden")
    declared = {channel for stream in harness.streams for channel in harness.channels(stream)}
    unused = declared - _used(harness, harness.cases, declared)
    if unused:
        longer = Harness(harness.name, harness.estimator, harness.seed, ticks=LONG)
        unused -= _used(longer, longer.cases, unused)
    if unused:
        uneven = [vary.make_first_certain(stream) for stream in harness.streams]
        unused -= _used(harness, [(s, harness.run(s, "the first robot was certain")) for s in uneven], unused)
    if unused:
        raise CheckFailed(f"it declares {', '.join(sorted(unused))}, but that never changed an estimate or a packet")
    return f"each declared channel ({', '.join(sorted(declared))}) changed a result; messages and bytes add up"


def _used(harness: Harness, cases: list[tuple[Stream, RunRecord]], channels: set[str]) -> set[str]:
    """Return those of these channels that change anything on some stream where they are perturbed, or hidden."""
    found: set[str] = set()
    for stream, base in cases:
        for channel in sorted((harness.channels(stream) & channels) - found):
            name = harness.array(channel)
            array = stream.arrays()[name]
            for other in (array + 0.1 * harness.rng.normal(size=array.shape), np.full_like(array, np.nan)):
                try:
                    harness.require_same(base, stream.with_arrays({name: other}), f"{channel} was changed")
                except CheckFailed:
                    found.add(channel)
                    break
    return found


def equivariance(harness: Harness) -> str:
    """Shift the world, turn it by 90 degrees, renumber the robots: the estimates follow.

    Only for estimators without randomness; compared with a tolerance, as other coordinates round differently. Where the
    approximation itself lies along the axes, as the sigma points of an unscented filter do, the estimator states the
    reason in a class variable `axes`; then the world is only shifted, and the report repeats the reason.
    """
    if not harness.deterministic:
        raise CheckSkipped("it draws random numbers, which do not turn with the world")
    axes, in_turns = harness.traits.axes, harness.traits.team and not harness.centralised
    for stream, base in harness.cases:
        if stream.senses.extra or not isinstance(stream.world.motion, Displacement | Unicycle):
            raise CheckSkipped("it is not known how this scenario's channels or odometry turn with the world")
        belief = Belief(base.trace.x, base.trace.P)
        _require_close(harness, vary.shift_belief(belief), vary.shifted(stream), "the world was shifted")
        if axes:
            continue
        turned, when = vary.turn_belief(belief), "the world was turned by 90 degrees"
        try:  # some estimators take the anchors one by one, some want the corners in order
            _require_close(harness, turned, vary.turned(stream, roll=0), when)
        except CheckFailed:
            _require_close(harness, turned, vary.turned(stream, roll=1), when, AXES)
        if stream.robots > 1 and not in_turns:
            order, single = [*range(1, stream.robots), 0], vary.in_turn(stream)
            alone = harness.run(single, "one pair of robots met in each tick").trace
            expected = Belief(alone.x[:, :, order], alone.P[:, :, order])
            _require_close(harness, expected, vary.renumbered(single, order), "its robots were renumbered")
    same = f"the estimates followed to {TOLERANCE:.0%} of a standard deviation"
    if axes:
        return f"the world was shifted: {same}; not turned or renumbered, as {axes}"
    if in_turns:
        return f"the world was shifted and turned by 90 degrees: {same}; not renumbered, as its robots go in turns"
    return f"the world was shifted and turned by 90 degrees, the robots were renumbered: {same}"


def _require_close(harness: Harness, expected: Belief, stream: Stream, when: str, remedy: str = "") -> None:
    """Run on the stream, and compare with the beliefs expected there."""
    found = harness.run(stream, when).trace
    sd = np.sqrt(np.maximum(np.diagonal(expected.P, axis1=-2, axis2=-1), 0.0))
    off_x = np.abs(wrap_heading(expected.x - found.x))
    off_P = np.abs(expected.P - found.P)
    allowed = TOLERANCE * sd[..., None] * sd[..., None, :]
    for what, off, limit in (("estimate", off_x, TOLERANCE * sd), ("covariance", off_P, allowed)):
        far: Mask = np.asarray((off > limit + ROUNDED).reshape(*off.shape[:3], -1).any(-1))
        if far.any():
            missed = f"'s {what} did not follow when {when}: it is up to {off[far].max():.2g} away"
            fail_at(earliest(far), stream, missed, remedy)


@contextmanager
def _seed_globally(seed: int) -> Iterator[Callable[[], str]]:
    """Seed the global generators; yield a function that names the one whose state has changed since."""
    before = random.getstate(), np.random.get_state()  # noqa: NPY002
    random.seed(seed)
    np.random.seed(seed)  # noqa: NPY002, TID251
    now: dict[str, Callable[[], Any]] = {"random": random.getstate, "numpy.random": np.random.get_state}
    started = {name: snapshot(state(), name) for name, state in now.items()}
    try:
        yield lambda: next((name for name, state in now.items() if snapshot(state(), name) != started[name]), "")
    finally:
        random.setstate(before[0])
        np.random.set_state(before[1])  # noqa: NPY002


class Check(NamedTuple):
    """One rule of the comparison."""

    name: str
    run: Callable[[Harness], str]  # what it tried and saw; raises CheckFailed or CheckSkipped
    remedy: str  # what to change in an estimator that fails it


UNLIKE = (
    "look for what differs from call to call: a counter in the class or module, a cache, a generator that is seeded "
    "once, the clock, id() or hash(), a file, threads"
)
AXES = (
    "take directions only from the prior, the world and the readings; where the method itself lies along the axes, as "
    "sigma points and grids do, say so in a class variable: axes = 'its sigma points lie along the axes'"
)
CHECKS = (
    Check("runs", runs, "follow cooploc.estimators.interface: its shapes, and nan for an absent reading"),
    Check(
        "determinism",
        determinism,
        "draw random numbers from rows.key alone, and store everything in the state that init() makes; a library that "
        "draws globally gets a keyed generator by cl.PerRobot(..., own_random=True)",
    ),
    Check("truth-blindness", truth_blindness, "use only what the methods are given"),
    Check("causality", causality, "use only what the methods are given in this tick, and your own state"),
    Check(
        "link-honesty",
        link_honesty,
        "use a packet and its radio readings only where mail.heard is True, and nothing else of a teammate",
    ),
    Check(
        "non-interference",
        non_interference,
        "compute each row from that row alone, without a sum, mean or matrix product over rows; teammates' data come "
        "in only through `mail`, in fuse()",
    ),
    Check(
        "immutability",
        immutability,
        "copy an array before writing to it, return a new state, and store nothing in parameters or module variables",
    ),
    Check("nan-safety", nan_safety, "treat nan as an absent reading: leave that row as it is in that update"),
    Check(
        "covariance",
        covariance,
        "return (P + P.mT) / 2, and use an update that keeps P positive semidefinite, such as the Joseph form",
    ),
    Check(
        "silence",
        silence,
        "where nothing is sensed or heard, move by odometry alone and let P grow; a method that must move otherwise, "
        "as a constant-velocity filter or Euler's integration, says why in a class variable: own_motion = '...'",
    ),
    Check(
        "declaration",
        declaration,
        "name in `uses` only channels that change the estimate; a message costs 8 bytes and its payload",
    ),
    Check(
        "equivariance",
        equivariance,
        "take positions, directions and robots only from the prior, the world and the readings",
    ),
)

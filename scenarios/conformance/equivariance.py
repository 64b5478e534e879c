"""The check that nothing depends on where the world lies, which way is north, or who is called robot 0.

Only for estimators without randomness; compared to a tolerance, as other coordinates round otherwise. One whose
approximation itself lies along the axes, as the sigma points of an unscented filter, says so by a class variable
`axes`, the reason in words; it is only shifted, and the report repeats what it says.
"""

from dataclasses import replace

import numpy as np

from cooploc.estimators.interface import Array, Belief, Mask, World
from cooploc.estimators.models.angles import wrap, wrap_heading
from cooploc.estimators.models.motion import Displacement, Unicycle
from cooploc.scenarios.conformance.harness import Bench, Failed, Skipped
from cooploc.scenarios.stream import Stream

TOLERANCE = 0.05  # of the standard deviation it states, and of a product of two for covariances
ROUNDING = 1e-6  # [m], [rad] and their squares
SHIFT = np.array([3.0, -7.0])  # [m]
QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])  # an arena has sides along the axes: it turns by right angles


def equivariance(bench: Bench) -> str:
    """Shift the world, turn it by 90 degrees, renumber the robots: the estimates go along."""
    if not bench.deterministic:
        raise Skipped("it draws random numbers, which do not turn with the world")
    axes = getattr(bench.estimator, "axes", "")
    for stream, base in zip(bench.streams, bench.base, strict=True):
        if stream.senses.extra or not isinstance(stream.world.motion, Displacement | Unicycle):
            raise Skipped("it is not known how this scenario's channels or odometry turn")
        belief = Belief(base.trace.x, base.trace.P)
        _demand_along(bench, shifted(stream), _shift_belief(belief), "the world was shifted")
        if not axes:
            _turning(bench, stream, _turn_belief(belief))
        if stream.robots > 1 and not (axes or _sequential(bench)):
            _renumbering(bench, stream)
    if axes:
        return (
            f"shifted, it gives the same to {TOLERANCE:.0%} of a standard deviation; not turned or renumbered: {axes}"
        )
    what = "shifted and turned by 90 degrees" if _sequential(bench) else "shifted, turned and with robots renumbered"
    exempt = "; its robots take turns by number, and are not renumbered" if _sequential(bench) else ""
    return f"{what}, it gives the same to {TOLERANCE:.0%} of a standard deviation{exempt}"


def shifted(stream: Stream) -> Stream:
    """The same readings in a world that lies elsewhere."""
    x, w = _shift_belief(stream.prior).x, stream.world
    world = replace(w, arena=w.arena + SHIFT, anchors=w.anchors + SHIFT, landmarks=w.landmarks + SHIFT)
    return replace(stream.with_arrays({"prior.x": x}), world=world)


def turned(stream: Stream, roll: int) -> Stream:
    """The same readings in a world turned by 90 degrees, its anchors renumbered by `roll`.

    With one, four corners keep their order from the lower left.
    """
    x, P = _turn_belief(stream.prior)
    senses, compass = stream.senses, x.shape[-1] == 2
    changed = {"prior.x": x, "prior.P": P, "senses.anchor_rssi": np.roll(senses.anchor_rssi, -roll, axis=-1)}
    if isinstance(stream.world.motion, Displacement):
        changed["senses.odometry"] = senses.odometry @ QUARTER.T
    if compass:  # a bearing is against the x axis
        for name in ("landmark", "sighting"):
            z = getattr(senses, name)
            changed[f"senses.{name}"] = np.stack([z[..., 0], wrap(z[..., 1] + np.pi / 2)], -1)
    return replace(stream.with_arrays(changed), world=_turn_world(stream.world, roll))


def renumbered(stream: Stream, order: list[int]) -> Stream:
    """Robot `order[i]` is called i."""
    changed = {}
    for name, array in stream.arrays().items():
        own = array[:, order] if name.startswith("prior.") else array[:, :, order]
        pairs = name.startswith("air.") or name == "senses.sighting"
        changed[name] = own[:, :, :, order] if pairs and own.shape[3] else own
    return stream.with_arrays(changed)


def in_turn(stream: Stream) -> Stream:
    """One pair of robots meets in each tick, one way: nothing is left to the order in which teammates are taken."""
    n, T = stream.robots, len(stream.time)
    pair, reads = np.zeros((T, n, n), bool), np.zeros((T, n, n), bool)
    for k in range(T):
        i, j = k % n, (k + 1 + k // n % (n - 1)) % n
        pair[k, i, j] = pair[k, j, i] = reads[k, i, j] = True
    changed: dict[str, Array | Mask] = {}
    for name in ("air.link", "air.rssi", "air.range", "senses.sighting"):
        array = stream.arrays()[name]
        if name == "air.link":
            changed[name] = np.logical_and(np.logical_and(array, array.swapaxes(-1, -2)), pair)
        elif array.shape[3]:
            keep = reads[..., None] if array.ndim == 5 else reads
            changed[name] = np.where(keep, array, np.nan)
    return stream.with_arrays(changed)


def _sequential(bench: Bench) -> bool:
    """A team that is no bound takes robots in turn, and each hears of what those before it did."""
    return bench.team and not bench.bound


def _renumbering(bench: Bench, stream: Stream) -> None:
    order = [*range(1, stream.robots), 0]
    single = in_turn(stream)
    base = bench.run(single, "one pair of robots met in each tick").trace
    got = bench.run(renumbered(single, order), "robots were renumbered").trace
    expected = Belief(base.x[:, :, order], base.P[:, :, order])
    _demand_close(expected, Belief(got.x, got.P), stream, "its robots were renumbered")


def _turning(bench: Bench, stream: Stream, along: Belief) -> None:
    """Anchors in their order or renumbered: some estimators take them one by one, some want their corners in order."""
    when = "the world was turned by 90 degrees"
    try:
        _demand_along(bench, turned(stream, roll=0), along, when)
    except Failed:
        _demand_along(bench, turned(stream, roll=1), along, when)


def _demand_along(bench: Bench, moved: Stream, along: Belief, when: str) -> None:
    got = bench.run(moved, when).trace
    _demand_close(along, Belief(got.x, got.P), moved, when)


def _demand_close(a: Belief, b: Belief, stream: Stream, when: str) -> None:
    sd = np.sqrt(np.maximum(np.diagonal(a.P, axis1=-2, axis2=-1), 0.0))
    off_x = np.abs(wrap_heading(a.x - b.x)) - ROUNDING - TOLERANCE * sd
    off_P = np.abs(a.P - b.P) - ROUNDING - TOLERANCE * sd[..., None] * sd[..., None, :]
    for what, off in (("estimate", off_x), ("covariance", off_P)):
        far: Mask = np.asarray((off > 0).reshape(*off.shape[:3], -1).any(-1))
        if far.any():
            k, i, robot = np.argwhere(far.swapaxes(0, 1))[0]
            raise Failed(
                f"robot {robot}'s {what} is another when {when}: {stream.scenario!r}, trial {stream.trial[i]}, tick {k}"
            )


def _shift_belief(belief: Belief) -> Belief:
    x = belief.x.copy()
    x[..., :2] += SHIFT
    return belief._replace(x=x)


def _turn_belief(belief: Belief) -> Belief:
    x, d = belief.x.copy(), belief.x.shape[-1]
    x[..., :2] = x[..., :2] @ QUARTER.T
    if d > 2:
        x[..., 2] = wrap(x[..., 2] + np.pi / 2)
    J = np.eye(d)
    J[:2, :2] = QUARTER
    return Belief(x, J @ belief.P @ J.T)


def _turn_world(world: World, roll: int) -> World:
    corners = world.arena @ QUARTER.T
    arena = np.array([corners.min(0), corners.max(0)])
    anchors = np.roll(world.anchors @ QUARTER.T, -roll, axis=0)
    return replace(world, arena=arena, anchors=anchors, landmarks=world.landmarks @ QUARTER.T)

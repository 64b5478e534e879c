"""The check that nothing depends on where the world lies, which way is north, or which robot has number 0.

Only for estimators without randomness; compared with a tolerance, as other coordinates round differently. Where the
approximation itself lies along the axes, as the sigma points of an unscented filter do, the estimator states the reason
in a class variable `axes`; then the world is only shifted, and the report repeats the reason.
"""

from dataclasses import replace

import numpy as np

from cooploc.estimators.interface import Array, Belief, Mask, World
from cooploc.estimators.models import Displacement, Unicycle, wrap, wrap_heading
from cooploc.scenarios.conformance.compare import CheckFailed, CheckSkipped, earliest, place
from cooploc.scenarios.conformance.harness import Harness
from cooploc.scenarios.stream import Stream

TOLERANCE = 0.05  # of the standard deviation that it states, and of a product of two for covariances
ROUNDING = 1e-6  # [m], [rad] and their squares
SHIFT = np.array([3.0, -7.0])  # [m]
AXES = (
    "take directions only from the prior, the world and the readings; where the method itself lies along the axes, as "
    "sigma points and grids do, say so in a class variable: axes = 'its sigma points lie along the axes'"
)
QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])  # an arena has sides along the axes: it turns by right angles


def equivariance(harness: Harness) -> str:
    """Shift the world, turn it by 90 degrees, renumber the robots: the estimates follow."""
    if not harness.deterministic:
        raise CheckSkipped("it draws random numbers, which do not turn with the world")
    in_turns = (
        harness.traits.team and not harness.centralised
    )  # robots go one after another and hear of what those before them did
    for stream, base in harness.cases:
        if stream.senses.extra or not isinstance(stream.world.motion, Displacement | Unicycle):
            raise CheckSkipped("it is not known how this scenario's channels or odometry turn with the world")
        belief = Belief(base.trace.x, base.trace.P)
        _require_close(harness, _shift_belief(belief), shifted(stream), "the world was shifted")
        if not harness.traits.axes:
            _require_turned(harness, stream, _turn_belief(belief))
        if stream.robots > 1 and not (harness.traits.axes or in_turns):
            _require_renumbered(harness, stream)
    same = f"the estimates followed to {TOLERANCE:.0%} of a standard deviation"
    if harness.traits.axes:
        return f"the world was shifted: {same}; not turned or renumbered, as {harness.traits.axes}"
    if in_turns:
        return f"the world was shifted and turned by 90 degrees: {same}; not renumbered, as its robots go in turns"
    return f"the world was shifted and turned by 90 degrees, the robots were renumbered: {same}"


def shifted(stream: Stream) -> Stream:
    """The same readings in a world with its origin elsewhere."""
    x, w = _shift_belief(stream.prior).x, stream.world
    world = replace(w, arena=w.arena + SHIFT, anchors=w.anchors + SHIFT, landmarks=w.landmarks + SHIFT)
    return replace(stream.with_arrays({"prior.x": x}), world=world)


def turned(stream: Stream, roll: int) -> Stream:
    """The same readings in a world turned by 90 degrees, its anchors renumbered by `roll`.

    With roll=1, the numbers of four corners begin at the lower left again.
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
    """The same readings where robot `order[i]` has number i."""
    changed = {}
    for name, array in stream.arrays().items():
        rows = array[:, order] if name.startswith("prior.") else array[:, :, order]
        pairs = name.startswith("air.") or name == "senses.sighting"
        changed[name] = rows[:, :, :, order] if pairs and rows.shape[3] else rows
    return stream.with_arrays(changed)


def in_turn(stream: Stream) -> Stream:
    """One pair of robots meets in each tick, and one of them measures: the order of teammates makes no difference."""
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


def _require_renumbered(harness: Harness, stream: Stream) -> None:
    order = [*range(1, stream.robots), 0]
    single = in_turn(stream)
    base = harness.run(single, "one pair of robots met in each tick").trace
    expected = Belief(base.x[:, :, order], base.P[:, :, order])
    _require_close(harness, expected, renumbered(single, order), "its robots were renumbered")


def _require_turned(harness: Harness, stream: Stream, expected: Belief) -> None:
    """Anchors in their order or renumbered: some estimators take them one by one, some want their corners in order."""
    when = "the world was turned by 90 degrees"
    try:
        _require_close(harness, expected, turned(stream, roll=0), when)
    except CheckFailed:
        _require_close(harness, expected, turned(stream, roll=1), when, AXES)


def _require_close(harness: Harness, expected: Belief, stream: Stream, when: str, remedy: str = "") -> None:
    """Run on the stream, and compare with the beliefs expected there."""
    found = harness.run(stream, when).trace
    sd = np.sqrt(np.maximum(np.diagonal(expected.P, axis1=-2, axis2=-1), 0.0))
    off_x = np.abs(wrap_heading(expected.x - found.x)) - ROUNDING - TOLERANCE * sd
    off_P = np.abs(expected.P - found.P) - ROUNDING - TOLERANCE * sd[..., None] * sd[..., None, :]
    for what, letter, off in (("estimate", "x", off_x), ("covariance", "P", off_P)):
        far: Mask = np.asarray((off > 0).reshape(*off.shape[:3], -1).any(-1))
        if far.any():
            size = np.abs(getattr(expected, letter) - getattr(found, letter)).reshape(*far.shape, -1).max(-1)
            missed = f"'s {what} did not follow when {when}: it is up to {size[far].max():.2g} away"
            raise CheckFailed(place(earliest(far), stream, missed), remedy)


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

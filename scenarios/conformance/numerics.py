"""Checks that an estimator's numbers make sense: covariances, absent readings, silence."""

import numpy as np

from cooploc.estimators import make
from cooploc.estimators.interface import Array, Mask
from cooploc.scenarios.conformance import perturb
from cooploc.scenarios.conformance.compare import CheckSkipped, RunRecord, earliest, fail_at, require_none
from cooploc.scenarios.conformance.harness import Harness
from cooploc.scenarios.runner.trace import NOTHING, ROUNDING, trace
from cooploc.scenarios.stream import Stream

# Allowed distance from dead reckoning, in its standard deviations: an unscented filter's mean differs to second order.
OFF_TRACK = 0.02
ONLY_ODOMETRY = "nothing was sensed but odometry and no packet arrived"


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
    return f"single and all readings of each channel were made absent in {ways} ways: every estimate stayed finite"


def covariance(harness: Harness) -> str:
    """Every covariance is symmetric and has no negative variance, in any direction."""
    for stream, base in harness.cases:
        require_covariance(base, "nothing was changed")
        for mode in perturb.MODES:
            when = f"readings were {mode}"
            require_covariance(harness.run(perturb.perturb_readings(stream, mode, harness.rng), when), when)
    return (
        f"at every tick, with readings perturbed and hidden too, P was symmetric and positive semidefinite to "
        f"{ROUNDING:g} of its largest entry"
    )


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
        quiet = _only_odometry(stream)
        found, dead = harness.run(quiet, ONLY_ODOMETRY), trace("dead-reckoning", make("dead-reckoning"), quiet)
        variance = _position_variance(dead.P)
        growth = np.sqrt(np.maximum(variance - variance[:, :1], 0.0))
        allowed = OFF_TRACK * np.sqrt(variance) if harness.deterministic else growth + 0.1 * growth[:, -1:]
        moved, expected = (x[..., :2] - x[:, :1, :, :2] for x in (found.trace.x, dead.x))
        off = np.where(_inside(quiet, dead.x), np.sqrt(((moved - expected) ** 2).sum(-1)), 0.0)
        if (off > allowed).any():
            where = earliest(off > allowed)
            distance = off[where]
            limit = f"{allowed[where]:.2g} m is allowed"
            far = f" is {distance:.2g} m away from where odometry leads, where {limit}, when {ONLY_ODOMETRY}"
            fail_at(where, quiet, far)
        if harness.deterministic:
            _require_no_shrinking(found)
    agrees = "and its uncertainty never shrank" if harness.deterministic else "to one standard deviation"
    return f"{ONLY_ODOMETRY}: it moved as dead reckoning does, {agrees}"


def _inside(stream: Stream, x: Array) -> Mask:
    """Whether paths x (t, T, n, d) have been in the arena at every tick so far."""
    low, high = stream.world.arena
    return np.asarray(np.logical_and.accumulate(((x[..., :2] > low) & (x[..., :2] < high)).all(-1), axis=1))


def _only_odometry(stream: Stream) -> Stream:
    hidden = {
        name: np.full_like(array, np.nan)
        for name, array in stream.arrays().items()
        if array.dtype.kind == "f" and name not in perturb.NEVER_HIDDEN
    }
    return perturb.drop_packets(stream.with_arrays(hidden))


def _position_variance(P: Array) -> Array:
    variance: Array = P[..., 0, 0] + P[..., 1, 1]
    return variance


def _require_no_shrinking(found: RunRecord) -> None:
    variance = _position_variance(found.trace.P)
    shrunk = np.zeros(variance.shape, bool)
    shrunk[:, 1:] = variance[:, 1:] < variance[:, :-1] * (1 - ROUNDING)
    if shrunk.any():
        share = 1 - variance[:, 1:][shrunk[:, 1:]] / variance[:, :-1][shrunk[:, 1:]]
        by = f"by up to {share.max():.1e} of itself"
        require_none(shrunk, found.stream, f"'s position variance shrank {by} when {ONLY_ODOMETRY}")


def require_covariance(found: RunRecord, when: str) -> None:
    """Require that every covariance is symmetric and has no negative variance.

    Raises:
        CheckFailed: one is not; says where and by how much.

    """
    P = found.trace.P
    scale = np.maximum(np.abs(P).max((-2, -1)), NOTHING)
    asymmetry = np.abs(P - P.mT).max((-2, -1))
    least = np.linalg.eigvalsh((P + P.mT) / 2)[..., 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        skew, negative = (np.nanmax(a / scale) for a in (asymmetry, -least))
    of = "of its largest entry"
    fault = f"'s covariance is not symmetric, by {skew:.1e} {of}, when {when}"
    require_none(asymmetry > ROUNDING * scale, found.stream, fault)
    fault = f"'s covariance has a negative variance, {-negative:.1e} {of}, when {when}"
    require_none(least < -ROUNDING * scale, found.stream, fault)

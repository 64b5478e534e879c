"""Checks that an estimator's numbers make sense: covariances, absent readings, silence."""

import numpy as np

from cooploc.estimators import make
from cooploc.estimators.interface import Array
from cooploc.scenarios.conformance import perturb
from cooploc.scenarios.conformance.harness import Bench, Failed, Recording
from cooploc.scenarios.runner.trace import trace
from cooploc.scenarios.stream import Stream

ROUNDING = 1e-9  # relative to the covariance's largest entry: what asymmetry and negative variance are forgiven
# Disagreement with dead reckoning in its standard deviations: an unscented filter's mean differs to second order.
STILL = 0.02


def nan_safety(bench: Bench) -> str:
    """Single readings absent, one channel absent, odometry absent: finite estimates, and other rows untouched."""
    ways = 0
    for stream in bench.streams:
        for channel in sorted(bench.channels(stream)):
            name = bench.array(channel)
            array = stream.arrays()[name]
            single = np.where(bench.rng.uniform(size=array.shape) < 0.3, np.nan, array)
            for other, what in ((single, "single numbers"), (np.full_like(array, np.nan), "all")):
                when = f"{what} of {channel} were absent"
                _demand_covariance(bench.run(stream.with_arrays({name: other}), when), stream, when)
                ways += 1
    return f"finite estimates in {ways} patterns of absence"


def covariance(bench: Bench) -> str:
    """Every covariance is symmetric and has no negative variance, in any direction."""
    for stream, base in zip(bench.streams, bench.base, strict=True):
        _demand_covariance(base, stream, "as it is")
        for how in perturb.HOW:
            when = f"readings were {how}"
            _demand_covariance(bench.run(perturb.disturbed(stream, how, bench.rng), when), stream, when)
    return f"symmetric and positive semidefinite to {ROUNDING:g} of the largest entry, at every tick"


def silence(bench: Bench) -> str:
    """Nothing sensed but odometry, nothing heard: it moves as dead reckoning does, and grows no surer.

    One without randomness agrees to `STILL` of dead reckoning's standard deviation, one that samples to one standard
    deviation of what odometry adds.
    """
    for stream in bench.streams:
        quiet = _quiet(stream)
        when = "nothing was sensed but odometry and no packet arrived"
        got, dead = bench.run(quiet, when), trace("dead-reckoning", make("dead-reckoning"), quiet)
        variance = _position_variance(dead.P)
        growth = np.sqrt(np.maximum(variance - variance[:, :1], 0.0))
        allowed = STILL * np.sqrt(variance) if bench.deterministic else growth + 0.1 * growth[:, -1:]
        moved, should = (x[..., :2] - x[:, :1, :, :2] for x in (got.trace.x, dead.x))
        off = np.sqrt(((moved - should) ** 2).sum(-1))
        if (off > allowed).any():
            k, i, robot = np.argwhere((off > allowed).swapaxes(0, 1))[0]
            raise Failed(
                f"robot {robot} is {off[i, k, robot]:.2g} m from where odometry leads when {when}: "
                f"{stream.scenario!r}, trial {stream.trial[i]}, tick {k}"
            )
        if bench.deterministic:
            _demand_no_surer(got, stream, when)
    return "it moves as odometry says" + (
        " and grows no surer" if bench.deterministic else ", to one standard deviation"
    )


def _quiet(stream: Stream) -> Stream:
    arrays = stream.arrays()
    gone = {
        name: np.full_like(array, np.nan)
        for name, array in arrays.items()
        if array.dtype.kind == "f" and name not in perturb.KEPT
    }
    return perturb.silent(stream.with_arrays(gone))


def _position_variance(P: Array) -> Array:
    variance: Array = P[..., 0, 0] + P[..., 1, 1]
    return variance


def _demand_no_surer(got: Recording, stream: Stream, when: str) -> None:
    variance = _position_variance(got.trace.P)
    shrunk = variance[:, 1:] < variance[:, :-1] * (1 - ROUNDING)
    if shrunk.any():
        k, i, robot = np.argwhere(shrunk.swapaxes(0, 1))[0]
        raise Failed(
            f"robot {robot} grew surer when {when}: {stream.scenario!r}, trial {stream.trial[i]}, tick {k + 1}"
        )


def _demand_covariance(got: Recording, stream: Stream, when: str) -> None:
    P = got.trace.P
    scale = np.abs(P).max((-2, -1))
    skew = np.abs(P - P.mT).max((-2, -1))
    least = np.linalg.eigvalsh((P + P.mT) / 2)[..., 0]
    for bad, what in (
        (skew > ROUNDING * scale, "is not symmetric"),
        (least < -ROUNDING * scale, "has a negative variance"),
    ):
        if bad.any():
            k, i, robot = np.argwhere(bad.swapaxes(0, 1))[0]
            raise Failed(
                f"robot {robot}'s covariance {what} ({when}): {stream.scenario!r}, trial {stream.trial[i]}, tick {k}"
            )

"""The posterior Cramer-Rao bound: the least error of any estimator whose models of its world are true.

    J' = (Q + F J^-1 F')^-1 + E[H' R^-1 H | prior, odometry]

over the whole team, J its information; a reading between two robots adds to both of their blocks and subtracts off the
diagonal. The expectation is over the paths that a trial's prior and odometry allow, by Monte Carlo. Bounds of trials
are averaged: averaging their information would forget that each trial's prior mean is known.

The bound for the anchors' gradient, or for its angle, holds where the estimator sees nothing else of the anchors.
Shadowing is the same in both directions of a pair of robots, but counted as independent: the floor of `radio_rssi` is
loose, but valid.

Sources: P. Tichavsky, C. Muravchik, A. Nehorai, "Posterior Cramer-Rao bounds for discrete-time nonlinear filtering",
IEEE Trans. Signal Processing 46(5), 1998, eq. (21), conditioned on the prior mean as in H. Van Trees, K. Bell, Z. Tian,
"Detection, Estimation, and Modulation Theory, Part I", 2nd ed. 2013, sec. 4.3; K. V. Mardia, P. E. Jupp, "Directional
Statistics", 2000, sec. 3.5.6 (the projected normal distribution, for the angle).
"""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace
from functools import cache
from math import isqrt

import numpy as np
import scipy
from scipy.special import erfcx
from threadpoolctl import threadpool_limits

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Mail, Sensor
from cooploc.estimators.kalman import root
from cooploc.estimators.label_syntax import parse
from cooploc.estimators.models import NOWHERE, Displacement, GradientDoa, GradientReading, gradient_doa
from cooploc.estimators.plugin_files import is_file
from cooploc.scenarios import resolve, simulate
from cooploc.scenarios.scenario import split_family
from cooploc.scenarios.stream import Stream
from cooploc.scenarios.worlds.radio import Paper

# ---- the angle of a gradient
#
# A gradient in units of its errors is u ~ N(m, I). The Fisher information of its angle about m is the variance of the
# score E[u | angle] - m, diagonal along m and across it; a is the angle between u and m, r = |u|:
#
#     across  E[(E[r | a] sin a)^2],   along  E[(E[r | a] cos a - |m|)^2]

STRONGEST, STRENGTHS, ANGLES = 30.0, 1201, 1024  # of the table: |m|, its values, angles of each integral


@dataclass(frozen=True)
class DirectionAlone:
    """The angle of a gradient as a sensor whose H' R^-1 H is that angle's Fisher information about the position."""

    doa: GradientDoa

    @property
    def R(self) -> Array:
        return np.eye(2)

    def innovation(self, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
        """z, nan where the gradient (..., 2) is absent, and H (..., 2, 2) at x (..., 2); `q` is not used."""
        scale = np.array(self.doa.sides) / self.doa.rssi.sigma
        m, dm = self.doa.expect(x) * scale, self.doa.slope(x) * scale
        strength = np.maximum(np.hypot(m[..., 0], m[..., 1]), 1e-9)
        along = m / strength[..., None]
        across = np.stack([-along[..., 1], along[..., 0]], -1)
        strengths, *known = tabulate_information()
        scale_of = np.sqrt(np.stack([np.interp(strength, strengths, one) for one in known], -1))
        H = scale_of[..., None] * np.stack([(dm @ e[..., None])[..., 0] for e in (along, across)], -2)
        return z, H, np.zeros_like(H)


@cache
def tabulate_information() -> tuple[Array, Array, Array]:
    """Return |m|, and the information of the angle along m and across it, by quadrature over the angle.

    Above the last |m| its information is taken: too large by less than 0.003, so that a floor stays a floor.
    """
    s = np.linspace(0, STRONGEST, STRENGTHS)[:, None]
    a = 2 * np.pi * np.arange(ANGLES) / ANGLES
    t = s * np.cos(a)
    h = np.sqrt(np.pi / 2) * erfcx(-t / np.sqrt(2))  # Phi(t) / phi(t)
    density = np.exp(-(s**2) / 2) * (1 + t * h) / ANGLES  # of the angle, times the step
    r = (t + (1 + t**2) * h) / (1 + t * h)  # E[r | a]
    along = (density * (r * np.cos(a) - s) ** 2).sum(-1)
    across = (density * (r * np.sin(a)) ** 2).sum(-1)
    return s[:, 0], along, across


# ---- the floor

CHANNELS = ("anchor_rssi", "radio_rssi", "radio_range")
DERIVED: dict[str, Callable[[GradientDoa], Sensor]] = {  # channels that are made of anchor_rssi
    "anchor_gradient": GradientReading,
    "anchor_doa": DirectionAlone,
}
SAMPLES = 128  # paths of a trial in the expectation: the floor is 0.2 % too high, and 1 % with 32 paths
TRIALS = 20  # over which a floor is averaged, at most
MOST_TICKS = 10_000  # of a scenario with a floor
TOGETHER = 20_000  # robots of all paths and ticks whose readings are looked at together; their number changes no bit
PAIRS = 80_000  # of robots in all sampled paths together: large teams get fewer trials, and fewer paths


def floors(
    scenarios: Iterable[str], seed: int, most: int = 100, samples: int = SAMPLES, trials: int = TRIALS
) -> dict[str, float]:
    """Return the floor [m] of each scenario for an estimator of all readings, as of `pooled_floor`."""
    return {label: pooled_floor(label, seed, CHANNELS, most, samples, trials) for label in dict.fromkeys(scenarios)}


@cache
def pooled_floor(
    label: str, seed: int, channels: tuple[str, ...], most: int = 100, samples: int = SAMPLES, trials: int = TRIALS
) -> float:
    """Return the floor [m] of a scenario for an estimator of these channels, pooled over ticks; nan where none holds.

    Over at most `trials` trials of this seed, and `samples` paths of each. None holds for teams of more than `most`
    robots (a hundred take some ten seconds), and for scenarios of a Python file, whose code a table does not run.
    """
    try:
        resolved = None if is_file(split_family(parse(label)[0])[0]) else resolve(label)
        if resolved is None or resolved.robots > most or resolved.ticks > MOST_TICKS:
            return np.nan
        paths = max(4, PAIRS // resolved.robots**2)
        samples = min(samples, 1 << (isqrt(paths) - 1).bit_length())  # ten robots: 32, and the floor 0.6 % too high
        _, stream = simulate(label, trials=min(trials, max(1, paths // samples)), seed=seed)
        return float(np.sqrt((floor(stream, channels, samples) ** 2).mean()))
    except BadInput:  # no floor, or no recording at hand
        return np.nan


def floor(stream: Stream, channels: Collection[str], samples: int = SAMPLES) -> Array:
    """Return the least RMSE (T,) [m] of a team at every tick, for an estimator with odometry and these channels.

    Channels are of "anchor_rssi", "radio_rssi", "radio_range"; instead of the first "anchor_gradient", the gradient
    of four corner readings, or "anchor_doa", its angle alone. Samples are paths of each trial, a power of 2.

    Raises:
        BadInput: the floor does not hold there; says why. Or the anchors are used twice.

    """
    if reason := no_floor_reason(stream):
        raise BadInput(f"{stream.scenario!r} has no floor: {reason}")
    twice = [name for name in ("anchor_rssi", *DERIVED) if name in channels]
    if len(twice) > 1:
        raise BadInput(f"{' and '.join(twice)} are made of the same readings: name one of them")
    with threadpool_limits(1):  # matrices this small only wait for threads
        P = covariances(paths(stream, samples), stream, channels)
    return np.asarray(np.sqrt(np.trace(P, axis1=2, axis2=3).mean(1) / stream.robots))


def paths(stream: Stream, samples: int) -> Array:
    """Draw positions (t, samples, T, n, 2) [m] as the trial's prior and odometry allow them: x_0 ~ N, x' = x + u + w.

    Each robot's x_0 are Sobol points in random order, as the prior is far wider than odometry's noise.
    """
    motion, (t, T, n) = stream.world.motion, stream.senses.dt.shape
    if not isinstance(motion, Displacement):
        raise BadInput(f"{stream.scenario!r} has no floor: its motion is not a displacement")
    rng = np.random.default_rng([stream.seed, *stream.trial])
    normal = scipy.stats.qmc.MultivariateNormalQMC
    even = [rng.permutation(normal(np.zeros(2), rng=rng).random(samples)) for _ in range(t * n)]
    start = np.stack(even).reshape(t, n, samples, 2).swapaxes(1, 2)
    spread = root(stream.prior.P[:, None, :, :2, :2])
    x = stream.prior.x[:, None, :, :2] + (spread @ start[..., None])[..., 0]
    out = np.empty((t, samples, T, n, 2))
    for k in range(T):
        u, dt = stream.senses.odometry[:, None, k], stream.senses.dt[:, None, k]
        x = motion.sample(x, u, dt, rng.normal(size=x.shape))
        out[:, :, k] = x
    return out


def no_floor_reason(stream: Stream) -> str:
    """Return why a stream's world has no floor; empty where it has one."""
    if stream.notes.get("world") != "Paper":
        return "it is a recording, or of another world than the paper's"
    made = Paper(**stream.notes["parameters"])
    assumed, true = stream.world, made.world()
    reasons = {
        "its team assumes another world": (assumed.motion, dict(assumed.sensors)) != (true.motion, dict(true.sensors)),
        "things stand in the way": bool(made.walls or made.obstacles or made.body_blocking),
        "its shadowing has memory": made.shadow_correlation > 0,
        "its readings are rounded": made.rounding > 0,
        "its readings are averaged over a tick": made.samples > 1,
        "a packet that is not heard carries information, too": np.isfinite(made.radio_range),
    }
    return "; ".join(reason for reason, holds in reasons.items() if holds)


def covariances(x: Array, stream: Stream, channels: Collection[str]) -> Array:
    """J^-1 (T, t, 2n, 2n) [m^2], J each trial's information after every tick, expected over paths x (t, s, T, n, 2)."""
    t, s, T, n, _ = x.shape
    P = _diagonal(stream.prior.P[..., :2, :2])
    out = np.empty((T, *P.shape))
    together = max(1, TOGETHER // (t * s * n))  # ticks
    for first in range(0, T, together):
        gained = _information(x[:, :, first : first + together], stream, channels, slice(first, first + together))
        for k in range(first, min(first + together, T)):
            _, _, Q = stream.world.motion.move(x[:, 0, k], stream.senses.odometry[:, k], stream.senses.dt[:, k])
            J = np.linalg.inv(P + _diagonal(Q)) + gained[:, k - first]
            out[k] = P = np.asarray(np.linalg.inv((J + J.mT) / 2), float)
    return out


def _information(x: Array, stream: Stream, channels: Collection[str], ticks: slice) -> Array:
    """E[H' R^-1 H] (t, k, 2n, 2n) of the readings of some ticks, the mean over places x (t, s, k, n, 2)."""
    t, _, k, n = x.shape[:4]
    z, air = stream.senses, stream.air
    world = replace(stream.world, sensors={c: s for c, s in stream.world.sensors.items() if c in channels})
    now = z._replace(**{name: getattr(z, name)[:, None, ticks] for name in z._fields[:-1]})
    heard = air.link[:, None, ticks]
    nothing = np.full(heard.shape, np.nan)
    rssi, ranged = (np.where(heard, a[:, None, ticks], np.nan) if a.shape[-1] else nothing for a in air[1:])
    own, between, each = np.zeros((t, k, n, 2, 2)), np.zeros((t, k, n, n, 2, 2)), np.arange(n)
    fixed = list(world.fixed(now))
    for channel in [name for name in DERIVED if name in channels]:
        doa = gradient_doa(stream.world)
        fixed.append((DERIVED[channel](doa), NOWHERE, doa.gradient(now.anchor_rssi)))
    for sensor, place, reading in fixed:
        y, H, _ = sensor.innovation(x, place, reading)
        own += _mean_information(H, sensor.R, y)
    for sensor, j, reading in world.relative(now, Mail(heard, nothing[..., :0, None], rssi, ranged)):
        y, H, _ = sensor.innovation(x, x[:, :, :, j, None], reading)  # of the difference of two places: H_j = -H
        between[:, :, :, j] += _mean_information(H, sensor.R, y)
    between += between.swapaxes(2, 3)
    J = -between
    J[:, :, each, each] += own + between.sum(3)
    return _flat(J)


def _mean_information(H: Array, R: Array, y: Array) -> Array:
    """Return the mean over paths of H' R^-1 H (t, k, n, 2, 2) where the reading is there.

    Number by number: numpy's products of stacks of matrices this small are several times slower.
    """
    there, weight = np.isfinite(sum(np.moveaxis(y, -1, 0))), np.linalg.inv(R)
    rows = [[np.where(there, h, 0.0) for h in np.moveaxis(row, -1, 0)] for row in np.moveaxis(H, -2, 0)]
    out = np.empty((len(H), *H.shape[2:-2], 2, 2))
    for i, j in ((0, 0), (0, 1), (1, 1)):
        products = (w * (rows[a][i] * rows[b][j]).mean(1) for (a, b), w in np.ndenumerate(weight) if w)
        out[..., i, j] = out[..., j, i] = sum(products)
    return out


def _diagonal(P: Array) -> Array:
    """(t, n, 2, 2) along the diagonal of (t, 2n, 2n)."""
    t, n = P.shape[:2]
    out = np.zeros((t, n, n, 2, 2))
    out[:, np.arange(n), np.arange(n)] = P
    return _flat(out)


def _flat(blocks: Array) -> Array:
    """(..., n, n, 2, 2) as (..., 2n, 2n)."""
    *leading, n = blocks.shape[:-3]
    return blocks.swapaxes(-3, -2).reshape(*leading, 2 * n, 2 * n)

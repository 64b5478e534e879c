"""The posterior Cramer-Rao bound: the least error of any estimator whose models of its world are true.

    J' = (Q + F J^-1 F')^-1 + E[H' R^-1 H]

over the whole team, J its information; a reading between two robots adds to both of their blocks and subtracts off the
diagonal. The expectation is over the trials, at their true positions, for the readings that were there and the packets
that arrived. In a linear-Gaussian world it is the covariance of the Kalman filter.

Source: P. Tichavsky, C. Muravchik, A. Nehorai, "Posterior Cramer-Rao bounds for discrete-time nonlinear filtering",
IEEE Trans. Signal Processing 46(5), 1998, eq. (21).

Shadowing is the same in both directions of a pair of robots, but counted as if it were independent: the floor of
`radio_rssi` is loose, but still a valid bound.
"""

from collections.abc import Collection, Iterable
from dataclasses import replace
from functools import cache

import numpy as np
from threadpoolctl import threadpool_limits

from cooploc.estimators.interface import Array, Mail, World
from cooploc.estimators.models.motion import Displacement
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios import simulate
from cooploc.scenarios.stream import Stream, Truth
from cooploc.scenarios.worlds.radio_arena import Paper

CHANNELS = ("anchor_rssi", "radio_rssi", "radio_range")
PAIRS = 20_000  # of robots, at whose places the expectation is taken: it hardly differs from trial to trial


def floors(scenarios: Iterable[str], seed: int, most: int = 100) -> dict[str, float]:
    """The floor [m] of each of these scenarios, for an estimator with all readings, over all ticks; nan without one.

    The expectation is taken over the first of the trials with this seed, at most twenty. Teams of more than `most`
    robots are left out: a hundred take some ten seconds.
    """
    return {label: _pooled(label, seed, most) for label in dict.fromkeys(scenarios)}


@cache
def _pooled(label: str, seed: int, most: int) -> float:
    try:
        robots = simulate(label, trials=1, seed=seed)[1].robots
        if robots > most:
            return np.nan
        truth, stream = simulate(label, trials=int(np.clip(PAIRS / robots**2, 2, 20)), seed=seed)
        return float(np.sqrt((floor(truth, stream, CHANNELS) ** 2).mean()))
    except BadInput:  # no floor, or no recording at hand
        return np.nan


def floor(truth: Truth, stream: Stream, channels: Collection[str]) -> Array:
    """The least RMSE (T,) [m] of a team's positions at every tick, for an estimator with odometry and these channels.

    Args:
        truth: of the same stream.
        stream: of a simulated world whose assumed models are the true ones.
        channels: of "anchor_rssi", "radio_rssi", "radio_range".

    Raises:
        BadInput: the floor does not hold there; says why.

    """
    if truth.origin != stream.hashes:
        raise BadInput(f"this truth and stream of {stream.scenario!r} are of different trials: simulate again")
    reason = why_not(stream)
    if reason:
        raise BadInput(f"{stream.scenario!r} has no floor: {reason}")
    with threadpool_limits(1):  # matrices this small only wait for threads
        P = covariances(truth.x[..., :2], stream, channels)
    least: Array = np.sqrt(np.trace(P, axis1=1, axis2=2) / stream.robots)
    return least


def why_not(stream: Stream) -> str:
    """Why a stream's world has no floor; empty where it has one."""
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
    """The inverse J^-1 (T, 2n, 2n) [m^2] of the team's information after every tick, at true positions x (t, T, n, 2).

    Raises:
        BadInput: the motion is not a displacement, or the length of ticks differs between trials.

    """
    dt, n = stream.senses.dt, stream.robots
    if not isinstance(stream.world.motion, Displacement) or np.ptp(dt, axis=0).any():
        raise BadInput(
            f"{stream.scenario!r} has no floor: its motion is not a displacement, or its ticks differ between trials"
        )
    world = replace(stream.world, sensors={c: s for c, s in stream.world.sensors.items() if c in channels})
    P: Array = _blocks(stream.prior.P[..., :2, :2].mean(0))
    out = np.empty((dt.shape[1], 2 * n, 2 * n))
    for k in range(len(out)):
        _, _, Q = world.motion.move(x[0, k], stream.senses.odometry[0, k], dt[0, k])
        J = np.linalg.inv(P + _blocks(Q)) + _information(x[:, k], stream, world, k)
        P = np.linalg.inv((J + J.T) / 2).astype(float)
        out[k] = P
    return out


def _information(x: Array, stream: Stream, world: World, k: int) -> Array:
    """E[H' R^-1 H] (2n, 2n) of the readings of tick k."""
    t, n = x.shape[:2]
    z, air = stream.senses, stream.air
    now = z._replace(**{name: getattr(z, name)[:, k] for name in z._fields[:-1]})
    heard = air.link[:, k]
    rssi, ranged = (np.where(heard, a[:, k], np.nan) if a.shape[-1] else np.full(heard.shape, np.nan) for a in air[1:])
    J = np.zeros((t, n, n, 2, 2))
    own = np.arange(n)
    for sensor, place, reading in world.fixed(now):
        y, H, _ = sensor.innovation(x, place, reading)
        J[:, own, own] += _weighed(H, H, sensor.R, y)
    for sensor, j, reading in world.relative(now, Mail(heard, np.empty((t, n, n, 0)), rssi, ranged)):
        y, H, Hq = sensor.innovation(x, x[:, j, None], reading)
        between = _weighed(H, Hq, sensor.R, y)
        J[:, own, own] += _weighed(H, H, sensor.R, y)
        J[:, j, j] += _weighed(Hq, Hq, sensor.R, y).sum(1)
        J[:, :, j] += between
        J[:, j] += between.mT
    return _flat(J.mean(0))


def _weighed(A: Array, B: Array, R: Array, y: Array) -> Array:
    """A' R^-1 B (t, n, 2, 2) where the reading is there."""
    there = np.isfinite(y.sum(-1))[..., None, None]
    B = np.broadcast_to(np.linalg.inv(R) @ B, B.shape)
    # Products of 2 x 1 by 1 x 2 matrices: numpy's stacked @ is ten times slower.
    return np.where(there, (A[..., :, None] * B[..., None, :]).sum(-3), 0.0)


def _blocks(P: Array) -> Array:
    """(n, 2, 2) along the diagonal of (2n, 2n)."""
    n = len(P)
    out = np.zeros((n, n, 2, 2))
    out[np.arange(n), np.arange(n)] = P
    return _flat(out)


def _flat(blocks: Array) -> Array:
    """(n, n, 2, 2) as (2n, 2n)."""
    n = len(blocks)
    return blocks.transpose(0, 2, 1, 3).reshape(2 * n, 2 * n)

"""The filter of `batched_numpy.py` in JAX: one robot's tick is a pure function, `vmap` makes it one of all rows.

The readings' models are those of the world, as pure functions in `cooploc.estimators.models`, and JAX takes the
slopes. XLA compiles a program for every number of rows, which takes a second, and does not promise that two of them
round alike, as `non-interference` wants it. So rows are padded to blocks of one size: one program computes every block,
and nothing here sums over rows.

    cooploc check examples/jax_traced.py:Traced
"""

from dataclasses import dataclass
from functools import cache, partial
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from cooploc import Belief
from cooploc.estimators.models import innovation

jax.config.update("jax_enable_x64", True)
WEIGHTS = (0.5, 0.75, 0.9)
BLOCK = 64  # rows of one call


class State(NamedTuple):
    """What the robots remember."""

    x: np.ndarray  # (r, 2) [m]
    P: np.ndarray  # (r, 2, 2)
    world: object


@dataclass(frozen=True)
class Traced:
    """EKF on own readings, covariance intersection with received beliefs by range."""

    api: ClassVar[int] = 1
    uses: tuple[str, ...] = ("odometry", "anchor_rssi", "radio_range")

    def init(self, prior, world, rows):
        return State(prior.x, prior.P, world)

    def predict(self, s, z):
        x, F, Q = s.world.motion.move(s.x, z.odometry, z.dt)
        return s._replace(x=x, P=F @ s.P @ F.mT + Q)

    def correct(self, s, z):
        one = partial(corrected, s.world.sensors["anchor_rssi"], tuple(map(tuple, s.world.anchors)))
        return s._replace(**in_blocks(one, s.x, s.P, z.anchor_rssi))

    def send(self, s, z):
        return np.concatenate([s.x, s.P.reshape(-1, 4)], -1)

    def fuse(self, s, z, mail):
        one = partial(fused, s.world.sensors["radio_range"])
        return s._replace(**in_blocks(one, s.x, s.P, mail.packets, mail.range))

    def estimate(self, s):
        return Belief(s.x, s.P)


def in_blocks(one, *rows):
    """x and P of a function of one row, for all rows; the last block is filled with its last row."""
    count = len(rows[0])
    padded = [np.concatenate([a, np.repeat(a[-1:], -count % BLOCK, 0)]) for a in rows]
    parts = [compiled(one.func, *one.args)(*(a[k : k + BLOCK] for a in padded)) for k in range(0, count, BLOCK)]
    return {name: np.concatenate(found)[:count] for name, found in zip("xP", zip(*parts, strict=True), strict=True)}


@cache
def compiled(function, *told):
    """A function of one row as a program of a block, once for each world's models."""
    return jax.jit(jax.vmap(partial(function, *told)))


def corrected(sensor, anchors, x, P, levels):
    """A robot's x (2,), P (2, 2) after the signals (a,) of its anchors."""
    for q, level in zip(jnp.array(anchors), levels, strict=True):
        x, P = update(x, P, *innovated(sensor, x, q, level[None]), sensor.R)
    return x, P


def fused(sensor, x, P, packets, ranges):
    """The same after what teammates sent (n, 6) and the ranges to them (n,), each with the best of the weights."""
    for packet, z in zip(packets, ranges, strict=True):
        (x_j, P_j), best = (packet[:2], packet[2:].reshape(2, 2)), (x, P)
        y, H = innovated(sensor, x, x_j, z[None])
        for w in WEIGHTS:
            now = update(x, P / w, y, H, sensor.R + H @ P_j @ H.T / (1 - w))  # dh/dq = -dh/dx
            better = jnp.trace(now[1]) < jnp.trace(best[1])
            best = jnp.where(better, now[0], best[0]), jnp.where(better, now[1], best[1])
        x, P = best
    return x, P


def innovated(sensor, x, q, z):
    """y (1,), and H (1, 2) as JAX derives it."""
    return innovation(jnp, sensor, x, q, z), -jax.jacfwd(innovation, 2)(jnp, sensor, x, q, z)


def update(x, P, y, H, R):
    """The Kalman step of a scalar reading, in Joseph's form; x and P as they are where it is absent."""
    K = P @ H.T / (H @ P @ H.T + R)
    I_KH = jnp.eye(2) - K @ H
    there = jnp.isfinite(y).all()
    return jnp.where(there, x + K @ y, x), jnp.where(there, I_KH @ P @ I_KH.T + K @ R @ K.T, P)

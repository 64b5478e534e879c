"""What every particle filter here shares: spreading a prior, moving, weighting, moments, and renewal.

Renewal is systematic resampling where the effective sample size falls below half, followed by Liu & West's kernel:
particles shrink towards the mean by a = sqrt(1 - h^2) and are spread by h times the covariance, so that mean and
covariance stay what they were.

Source: J. Liu, M. West, "Combined parameter and state estimation in simulation-based filtering", 2001.

A tick is two passes over each row. `advance` renews where that is due, moves, weighs by anchors, and computes the
belief that is sent; `conclude` weighs by the packets received. For states that are positions (d = 2) they are the
compiled loops of particle_kernels.py; with a heading, and for other motions, numpy functions, with which tests compare
the loops.
"""

from collections.abc import Sequence

import numpy as np

from cooploc.estimators.compiled import random_numbers
from cooploc.estimators.compiled.jit import readable
from cooploc.estimators.interface import Array, Belief, Keys, Mask, Motion, Senses
from cooploc.estimators.models.angles import circular_mean, wrap, wrap_heading
from cooploc.estimators.models.motion import Displacement
from cooploc.estimators.particle import likelihood
from cooploc.estimators.particle.likelihood import Fixed, ReceivedPackets, planes
from cooploc.estimators.particle.particle_kernels import BANDWIDTH, Cloud, Moved, Step, advance_rows, conclude_rows
from cooploc.estimators.particle.resampling import systematic


def spread(prior: Belief, key: Keys, n: int) -> Array:
    """Particles (r, n, d) drawn from the prior."""
    return wrap_heading(
        prior.x[:, None, :] + _scatter(prior.P, _noise(key, 0, random_numbers.INIT, n, prior.x.shape[-1]))
    )


def advance(
    motion: Motion,
    x: Array,
    logw: Array,
    due: Mask,
    z: Senses,
    key: Keys,
    tick: int,
    fixed: Sequence[Fixed] = (),
    sends: bool = False,
) -> tuple[Array, Array, Belief | None]:
    """Begin a tick: renew, move, and weigh by the readings of fixed places.

    Args:
        motion: how particles move.
        x: particles (r, n, d).
        logw: their log-weights (r, n).
        due: rows (r,) to renew first, as `conclude` found.
        z: odometry and dt.
        key: of the random numbers (r, 2).
        tick: the number of this tick.
        fixed: readings that weigh the particles after they have moved.
        sends: whether the moments of the particles are needed, to be sent.

    Returns:
        particles drawn from P(x' | x, u), their log-weights, and their moments, None unless `sends`.

    """
    if type(motion) is not Displacement or x.shape[-1] != 2 or not likelihood.have_loop(fixed):
        x, logw = renew(x, logw, key, tick - 1)
        noise = random_numbers.normals(key, tick, random_numbers.MOVE, x.shape[1])
        x = motion.sample(x, z.odometry[:, None, :], z.dt[:, None], noise)
        logw = likelihood.anchors(fixed, x, logw)
        return x, logw, summary(x, logw) if sends else None
    cloud, sd = Cloud(planes(x), readable(logw), readable(due)), np.sqrt(motion.sigma**2 / motion.tick * z.dt)
    step = Step(readable(z.odometry), readable(sd), readable(key), tick * random_numbers.PURPOSES)
    out = Moved(np.empty((2 * len(x), x.shape[1]), x.dtype), np.empty_like(logw, order="C"))
    belief = empty_belief(len(x))
    anchors = likelihood.anchor_readings(fixed, len(x))
    advance_rows(tuple(cloud), tuple(step), tuple(anchors), sends, tuple(out), tuple(belief))
    return out.x.reshape(-1, 2, x.shape[1]).transpose(0, 2, 1), out.logw, belief if sends else None


def summary(x: Array, logw: Array) -> Belief:
    """Weighted mean and covariance of particles x (r, n, d) with log-weights (r, n)."""
    return conclude(x, logw)[0]


def conclude(x: Array, logw: Array, heard: ReceivedPackets | None = None) -> tuple[Belief, Array, Mask]:
    """End a tick: weigh particles by the packets `heard`.

    Returns:
        their moments, their log-weights, and which rows (r,) are due for renewal.

    """
    if x.shape[-1] != 2 or (heard and not heard.compiled):
        logw = likelihood.teammates(heard, x, logw) if heard else logw
        w = weights(logw)
        return moments(x, w), restarted(logw), poor(w)
    belief, logw_new, due = empty_belief(len(x)), np.empty_like(logw, order="C"), np.empty(len(x), np.bool_)
    packets = (heard or likelihood.no_packets(len(x))).for_loop()
    conclude_rows(planes(x), readable(logw), tuple(packets), tuple(belief), logw_new, due)
    return belief, logw_new, due


def empty_belief(rows: int) -> Belief:
    """Arrays for the moments of so many rows, to be written."""
    return Belief(np.empty((rows, 2)), np.empty((rows, 2, 2)))


def weights(logw: Array) -> Array:
    """Normalised weights (r, n). A row in which all are -inf starts again from equal weights; nan stays nan."""
    top = logw.max(-1, keepdims=True)
    w = np.exp(np.where(top == -np.inf, 0.0, logw - np.maximum(top, np.finfo(float).min)))
    normalised: Array = w / w.sum(-1, keepdims=True)
    return normalised


def mean(x: Array, w: Array) -> Array:
    """Weighted mean (r, d); the heading's is circular."""
    m: Array = (w[..., None] * x).sum(-2)
    if x.shape[-1] > 2:
        m[:, 2] = circular_mean(x[..., 2], w)
    return m


def moments(x: Array, w: Array) -> Belief:
    """Weighted mean and covariance of particles x (r, n, d), w (r, n)."""
    m = mean(x, w)
    e = offset(x, m)
    P = np.stack([(w[..., None] * e[..., :, i, None] * e).sum(-2) for i in range(x.shape[-1])], -2)
    return Belief(m, P)


def poor(w: Array) -> Mask:
    """Rows (r,) of weights (r, n) with an effective sample size below n/2."""
    few: Mask = 1 / (w**2).sum(-1) < w.shape[-1] / 2
    return few


def restarted(logw: Array) -> Array:
    """Log-weights (r, n) in which a row of -inf alone starts again from equal weights."""
    return np.where(logw.max(-1, keepdims=True) == -np.inf, 0.0, logw)


def renew(x: Array, logw: Array, key: Keys, tick: int) -> tuple[Array, Array]:
    """Resampled particles and their log-weights; rows that are not poor stay as they are."""
    n, d = x.shape[1:]
    logw = restarted(logw)
    w = weights(logw)
    due = poor(w)
    if not due.any():
        return x, logw
    h = BANDWIDTH * n ** (-1 / 6)
    old, w, key = x[due], w[due], key[due]
    u = random_numbers.uniforms(key, tick, random_numbers.RESAMPLE, 1)[:, 0, 0]
    chosen = np.take_along_axis(old, systematic(w, u)[..., None], 1)
    belief = moments(old, w)
    noise = _noise(key, tick, random_numbers.JITTER, n, d)
    kernel = np.sqrt(1 - h**2) * offset(chosen, belief.x) + h * _scatter(belief.P, noise)
    x, logw = x.copy(), logw.copy()
    x[due] = wrap_heading(belief.x[:, None, :] + kernel)
    logw[due] = 0.0
    return x, logw


def offset(x: Array, m: Array) -> Array:
    """Particles (r, n, d) less their mean (r, d), headings wrapped."""
    e = x - m[:, None, :]
    if x.shape[-1] > 2:
        e[..., 2] = wrap(e[..., 2])
    return e


def _noise(key: Keys, tick: int, purpose: int, n: int, d: int) -> Array:
    """Standard normals (r, n, d); the purpose after `purpose` is the heading's."""
    pair = random_numbers.normals(key, tick, purpose, n)
    if d == 2:
        return pair
    return np.concatenate([pair, random_numbers.normals(key, tick, purpose + 1, n)[..., : d - 2]], -1)


def _scatter(P: Array, noise: Array) -> Array:
    """noise (r, n, d) times a Cholesky factor of P (r, d, d), which may be singular."""
    d = P.shape[-1]
    L = np.zeros_like(P)
    for j in range(d):
        L[:, j, j] = np.sqrt(np.maximum(P[:, j, j] - (L[:, j, :j] ** 2).sum(-1), 0.0))
        for i in range(j + 1, d):
            rest = P[:, i, j] - (L[:, i, :j] * L[:, j, :j]).sum(-1)
            L[:, i, j] = np.divide(rest, L[:, j, j], out=np.zeros_like(rest), where=L[:, j, j] > 0)
    out = np.zeros_like(noise)
    for i in range(d):
        for j in range(i + 1):
            out[..., i] += L[:, i, j, None] * noise[..., j]
    return out

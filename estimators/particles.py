"""What every particle filter here shares: spreading a prior, moving, weighting, moments, and renewal.

Renewal is systematic resampling where the effective sample size falls below half, followed by Liu & West's kernel:
particles shrink towards the mean by a = sqrt(1 - h^2) and are spread by h times the covariance, so that mean and
covariance stay what they were.

Source: J. Liu, M. West, "Combined parameter and state estimation in simulation-based filtering", 2001.

A tick is two passes over each row. `advance` renews where that is due, moves, weighs by anchors, and says what is told
to others; `conclude` weighs by what was heard. Where positions are all of a state (d = 2) they are compiled loops over
rows, each row by itself; with a heading, and for other motions, they are the numpy functions that tests hold the loops
to.
"""

from collections.abc import Sequence

import numpy as np

from cooploc.estimators import kernels, likelihood
from cooploc.estimators.angles import circular_mean, wrap, wrap_heading
from cooploc.estimators.elementary import exp, inlined, kernel, ordered, readable, wide
from cooploc.estimators.interface import Array, Belief, Keys, Mask, Motion, Senses
from cooploc.estimators.likelihood import Fixed, fill, give, planes, scratch, take
from cooploc.estimators.models import Displacement

BANDWIDTH = 0.3  # h of the kernel, times n^(-1/6)


def spread(prior: Belief, key: Keys, n: int) -> Array:
    """Particles (r, n, d) drawn from the prior."""
    return wrap_heading(prior.x[:, None, :] + _scatter(prior.P, _noise(key, 0, kernels.INIT, n, prior.x.shape[-1])))


def advance(
    motion: Motion, x: Array, logw: Array, due: Mask, z: Senses, key: Keys, tick: int, fixed: Sequence[Fixed] = ()
) -> tuple[Array, Array, Belief | None]:
    """Begin a tick: renew, move, and weigh by the readings of fixed places.

    Args:
        motion: how particles move.
        x: particles (r, n, d).
        logw: their log-weights (r, n).
        due: rows (r,) to renew first, as `conclude` found.
        z: odometry and dt.
        key: of the random numbers (r, 2).
        tick: that begins.
        fixed: readings that weigh the particles where they are then.

    Returns:
        particles drawn from P(x' | x, u), their log-weights, and their moments if there are any such readings.

    """
    n = x.shape[1]
    if type(motion) is not Displacement or x.shape[-1] != 2 or not likelihood.alike(fixed):
        x, logw = renew(x, logw, key, tick - 1)
        noise = kernels.normals(key, tick, kernels.MOVE, n)
        x = motion.sample(x, z.odometry[:, None, :], z.dt[:, None], noise)
        logw = likelihood.anchors(fixed, x, logw)
        return x, logw, summary(x, logw) if fixed else None
    new, logw_new = np.empty((2 * len(x), n)), np.empty_like(logw, order="C")
    sd = np.sqrt(motion.sigma**2 / motion.tick * z.dt)
    belief, told = blank(len(x)), (readable(z.odometry), readable(sd), readable(key), tick * kernels.PURPOSES)
    _advance(planes(x), readable(logw), readable(due), *likelihood.told(fixed, len(x)), *told, new, logw_new, *belief)
    return new.reshape(-1, 2, n).transpose(0, 2, 1), logw_new, belief if fixed else None


def summary(x: Array, logw: Array) -> Belief:
    """Weighted mean and covariance of particles x (r, n, d) with log-weights (r, n)."""
    return conclude(x, logw)[0]


def conclude(x: Array, logw: Array, heard: likelihood.Heard | None = None) -> tuple[Belief, Array, Mask]:
    """End a tick: weigh particles by what was `heard`.

    Returns:
        their moments, their log-weights, and which rows (r,) are due for renewal.

    """
    if x.shape[-1] != 2 or (heard and not heard.compiled):
        logw = likelihood.teammates(heard, x, logw) if heard else logw
        w = weights(logw)
        return moments(x, w), restarted(logw), poor(w)
    belief, logw_new, due = blank(len(x)), np.empty_like(logw, order="C"), np.empty(len(x), np.bool_)
    told = (heard or likelihood.nothing_heard(len(x))).told()
    _conclude(planes(x), readable(logw), *told, *belief, logw_new, due)
    return belief, logw_new, due


def blank(rows: int) -> Belief:
    """Room for the moments of as many rows."""
    return Belief(np.empty((rows, 2)), np.empty((rows, 2, 2)))


def weights(logw: Array) -> Array:
    """Normalised weights (r, n). A row of nothing but -inf starts again from equal weights; nan stays nan."""
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
    """Log-weights (r, n) in which rows of nothing but -inf start again."""
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
    u = kernels.uniforms(key, tick, kernels.RESAMPLE, 1)[:, 0, 0]
    chosen = np.take_along_axis(old, kernels.systematic(w, u)[..., None], 1)
    belief = moments(old, w)
    noise = _noise(key, tick, kernels.JITTER, n, d)
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
    pair = kernels.normals(key, tick, purpose, n)
    return pair if d == 2 else np.concatenate([pair, kernels.normals(key, tick, purpose + 1, n)[..., : d - 2]], -1)


def _scatter(P: Array, noise: Array) -> Array:
    """noise (r, n, d) times a Cholesky factor of P (r, d, d), which may be singular."""
    d = P.shape[-1]
    L = np.zeros_like(P)
    for j in range(d):
        L[:, j, j] = np.sqrt(np.maximum(P[:, j, j] - (L[:, j, :j] ** 2).sum(-1), 0.0))
        for i in range(j + 1, d):
            rest = P[:, i, j] - (L[:, i, :j] * L[:, j, :j]).sum(-1)
            L[:, i, j] = np.divide(rest, L[:, j, j], out=np.zeros_like(rest), where=L[:, j, j] > 0)
    return np.stack([sum(L[:, i, j, None] * noise[..., j] for j in range(i + 1)) for i in range(d)], -1)


@kernel
def _advance(  # type: ignore[no-untyped-def]
    x, logw, due, places, readings, A, slope, unit, u, sd, key, counter, out, logw_out, mean, P
):
    wide()
    n, links, ln_unit = logw.shape[1], np.empty((len(places), likelihood.NUMBERS)), np.log(unit)
    X, Y, total, w = scratch(n), scratch(n), scratch(n), scratch(n)
    noise, count, marks = (scratch(n), scratch(n)), np.empty(n, np.int64), np.empty(n + 1, np.int64)
    renewed, words = np.empty((2, n)), np.empty((2, len(X)), np.uint32)
    for r in range(len(logw)):
        k0, k1 = np.int64(key[r, 0]), np.int64(key[r, 1])
        take(logw, r, total)
        if due[r]:
            take(x, 2 * r, X)
            take(x, 2 * r + 1, Y)
            _renew(X, Y, total, k0, k1, counter - kernels.PURPOSES, w, count, marks, words, noise, renewed)
        kernels.draw_words(k0, k1, counter + kernels.MOVE, words)
        kernels.normal_pairs(words, X, Y)
        if due[r]:
            fill(total, 0, 0.0)
            west, east = _moved(renewed, 0, u[r, 0], sd[r], X)
            south, north = _moved(renewed, 1, u[r, 1], sd[r], Y)
        else:
            west, east = _moved(x, 2 * r, u[r, 0], sd[r], X)
            south, north = _moved(x, 2 * r + 1, u[r, 1], sd[r], Y)
        give(X, out, 2 * r)
        give(Y, out, 2 * r + 1)
        if len(places) > 0:
            box = west, east, south, north
            likelihood.add_anchors(X, Y, box, r, places, readings, A, slope, unit, ln_unit, links, total)
        give(total, logw_out, r)
        if len(places) > 0:
            _weigh(X, Y, total, n, w, mean, P, r)


@inlined
def _moved(rows, r, way, sd, noise):  # type: ignore[no-untyped-def]
    """One axis of a row's particles, in the place of the noise that moves them; their extent."""
    wide()
    n, way = rows.shape[1], 0.0 if np.isnan(way) else way
    low = high = ordered(rows[r, 0] + way + sd * noise[0])
    for i in range(n):
        noise[i] = rows[r, i] + way + sd * noise[i]
        low, high = min(low, ordered(noise[i])), max(high, ordered(noise[i]))
    fill(noise, n, noise[0])
    return ordered(low), ordered(high)


@inlined
def _renew(X, Y, logw, k0, k1, counter, w, count, marks, words, noise, renewed):  # type: ignore[no-untyped-def]
    """One row of `renew`: m + shrink (x_a - m) + h L noise, L the Cholesky factor of P, which may be singular."""
    wide()
    n, (east, north) = len(count), noise
    h = BANDWIDTH * n ** (-1 / 6)
    shrink = np.sqrt(1 - h * h)
    total, _, mx, my, xx, xy, yy = _weighed(X, Y, logw, n, w)
    u, _ = kernels.uniform_pair(k0, k1, counter + kernels.RESAMPLE, 0)
    kernels.mark_ancestors(w, total, u, count, marks)
    kernels.draw_words(k0, k1, counter + kernels.JITTER, words)
    kernels.normal_pairs(words, east, north)
    mx, my = (1 - shrink) * mx, (1 - shrink) * my
    a = np.sqrt(max(xx, 0.0))
    b = xy / a if a > 0 else 0.0
    c = h * np.sqrt(max(yy - b * b, 0.0))
    a, b = h * a, h * b
    ancestor = 0
    for i in range(n):
        ancestor = max(ancestor, marks[i])
        j = np.uint64(ancestor)
        g0, g1 = east[i], north[i]
        renewed[0, i] = shrink * X[j] + (mx + a * g0)
        renewed[1, i] = shrink * Y[j] + (my + (b * g0 + c * g1))


@inlined
def _weigh(X, Y, logw, n, w, mean, P, r):  # type: ignore[no-untyped-def]
    """Moments of a row into mean and P; the sum of its weights and of their squares."""
    total, squares, mx, my, xx, xy, yy = _weighed(X, Y, logw, n, w)
    mean[r, 0], mean[r, 1] = mx, my
    P[r, 0, 0], P[r, 0, 1], P[r, 1, 0], P[r, 1, 1] = xx, xy, xy, yy
    return total, squares


@inlined
def _weighed(X, Y, logw, n, w):  # type: ignore[no-untyped-def]
    """Weights into `w` of a row of n, which starts again if it is nothing but -inf; their sum, squares, moments."""
    wide()
    fill(logw, n, -np.inf)
    _, top = likelihood.extent(logw)
    if top == -np.inf:
        top = 0.0
        for i in range(n):
            logw[i] = 0.0
    total, squares, mx, my = 0.0, 0.0, 0.0, 0.0
    for i in range(len(logw)):
        w[i] = exp(logw[i] - top)
        total += w[i]
        squares += w[i] * w[i]
        mx += w[i] * X[i]
        my += w[i] * Y[i]
    mx, my = mx / total, my / total
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(len(logw)):
        ex, ey = X[i] - mx, Y[i] - my
        xx += w[i] * (ex * ex)
        xy += w[i] * (ex * ey)
        yy += w[i] * (ey * ey)
    return total, squares, mx, my, xx / total, xy / total, yy / total


@kernel
def _conclude(  # type: ignore[no-untyped-def]
    x, logw, packets, readings, ranged, A, slope, unit, gain, mean, P, logw_out, due
):
    wide()
    n, links, ln_unit = logw.shape[1], np.empty((readings.shape[1], likelihood.NUMBERS)), np.log(unit)
    X, Y, total, w = scratch(n), scratch(n), scratch(n), scratch(n)
    for r in range(len(logw)):
        take(x, 2 * r, X)
        take(x, 2 * r + 1, Y)
        take(logw, r, total)
        likelihood.add_teammates(X, Y, r, packets, readings, ranged, A, slope, unit, ln_unit, gain, links, total)
        sum_w, squares = _weigh(X, Y, total, n, w, mean, P, r)
        due[r] = sum_w * sum_w < n / 2 * squares
        give(total, logw_out, r)

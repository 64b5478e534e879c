"""What every particle filter here shares: spreading a prior, moving, weighting, moments, and renewal.

Renewal is systematic resampling where the effective sample size falls below half, followed by Liu & West's kernel:
particles shrink towards the mean by a = sqrt(1 - h^2) and are spread by h times the covariance, so that mean and
covariance stay what they were.

Source: J. Liu, M. West, "Combined parameter and state estimation in simulation-based filtering", 2001.

Where positions are all of a state (d = 2), `walk`, `summary` and `conclude` are compiled loops over rows, each row by
itself; with a heading, and for other motions, they are the numpy functions that tests hold the loops to.
"""

import numpy as np

from cooploc.estimators import kernels, likelihood
from cooploc.estimators.angles import circular_mean, wrap, wrap_heading
from cooploc.estimators.elementary import exp, inlined, kernel, readable, wide
from cooploc.estimators.interface import Array, Belief, Keys, Motion
from cooploc.estimators.models import Displacement

BANDWIDTH = 0.3  # h of the kernel, times n^(-1/6)


def spread(prior: Belief, key: Keys, n: int) -> Array:
    """Particles (r, n, d) drawn from the prior."""
    return wrap_heading(prior.x[:, None, :] + _scatter(prior.P, _noise(key, 0, kernels.INIT, n, prior.x.shape[-1])))


def walk(motion: Motion, x: Array, u: Array, dt: Array, key: Keys, tick: int) -> Array:
    """Particles (r, n, d) drawn from P(x' | x, u) for odometry u (r, k) over dt (r,)."""
    n = x.shape[1]
    if type(motion) is not Displacement or x.shape[-1] != 2:
        return motion.sample(x, u[:, None, :], dt[:, None], kernels.normals(key, tick, kernels.MOVE, n))
    out = np.empty_like(x, order="C")
    sd = np.sqrt(motion.sigma**2 / motion.tick * dt)
    _walk(
        readable(_flat(x)), readable(u), readable(sd), readable(key), tick * kernels.PURPOSES + kernels.MOVE, _flat(out)
    )
    return out


def summary(x: Array, logw: Array) -> Belief:
    """Weighted mean and covariance of particles x (r, n, d) with log-weights (r, n)."""
    if x.shape[-1] != 2:
        return moments(x, weights(logw))
    belief = Belief(np.empty((len(x), 2)), np.empty((len(x), 2, 2)))
    _summary(readable(_flat(x)), readable(logw), *belief)
    return belief


def conclude(
    x: Array, logw: Array, key: Keys, tick: int, heard: likelihood.Heard | None = None
) -> tuple[Belief, Array, Array]:
    """Weigh particles by what was `heard`: their moments, and what `renew` makes of them."""
    if x.shape[-1] != 2 or (heard and not heard.compiled):
        logw = likelihood.teammates(heard, x, logw) if heard else logw
        return moments(x, weights(logw)), *renew(x, logw, key, tick)
    belief = Belief(np.empty((len(x), 2)), np.empty((len(x), 2, 2)))
    new, logw_new = np.empty_like(x, order="C"), np.empty_like(logw, order="C")
    counter = tick * kernels.PURPOSES
    told = (heard or likelihood.nothing_heard(len(x))).told()
    counters = counter + kernels.RESAMPLE, counter + kernels.JITTER
    _conclude(readable(_flat(x)), readable(logw), *told, readable(key), *counters, *belief, _flat(new), logw_new)
    return belief, new, logw_new


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


def renew(x: Array, logw: Array, key: Keys, tick: int) -> tuple[Array, Array]:
    """Resampled particles and their log-weights; rows with an effective sample size of n/2 or more stay as they are."""
    n, d = x.shape[1:]
    logw = np.where(logw.max(-1, keepdims=True) == -np.inf, 0.0, logw)  # a row that lost everything starts again
    w = weights(logw)
    poor = 1 / (w**2).sum(-1) < n / 2
    if not poor.any():
        return x, logw
    h = BANDWIDTH * n ** (-1 / 6)
    old, w, key = x[poor], w[poor], key[poor]
    u = kernels.uniforms(key, tick, kernels.RESAMPLE, 1)[:, 0, 0]
    chosen = np.take_along_axis(old, kernels.systematic(w, u)[..., None], 1)
    belief = moments(old, w)
    noise = _noise(key, tick, kernels.JITTER, n, d)
    kernel = np.sqrt(1 - h**2) * offset(chosen, belief.x) + h * _scatter(belief.P, noise)
    x, logw = x.copy(), logw.copy()
    x[poor] = wrap_heading(belief.x[:, None, :] + kernel)
    logw[poor] = 0.0
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


def _flat(x: Array) -> Array:
    """Particles (r, n, d) as (r, n d)."""
    return x.reshape(len(x), -1)


@kernel
def _walk(x, u, sd, key, counter, out):  # type: ignore[no-untyped-def]
    wide()
    words = np.empty((2, x.shape[1] // 2), np.uint32)
    for r in range(x.shape[0]):
        kernels.draw_words(np.int64(key[r, 0]), np.int64(key[r, 1]), counter, words)
        east = 0.0 if np.isnan(u[r, 0]) else u[r, 0]
        north = 0.0 if np.isnan(u[r, 1]) else u[r, 1]
        was, becomes, s, first, second = x[r], out[r], sd[r], words[0], words[1]
        for i in range(len(first)):
            a, b = kernels.normal_pair(first[i], second[i])
            becomes[2 * i] = was[2 * i] + east + s * a
            becomes[2 * i + 1] = was[2 * i + 1] + north + s * b


@inlined
def _largest(logw):  # type: ignore[no-untyped-def]
    """The largest of a row without nan. Four at a time hide the latency of a comparison."""
    a, b, c, d = -np.inf, -np.inf, -np.inf, -np.inf
    n = len(logw)
    for i in range(0, n - 3, 4):
        a, b = max(a, logw[i]), max(b, logw[i + 1])
        c, d = max(c, logw[i + 2]), max(d, logw[i + 3])
    for i in range(n - n % 4, n):
        a = max(a, logw[i])
    return max(max(a, b), max(c, d))


@inlined
def _weighed(x, logw, w, mean, P):  # type: ignore[no-untyped-def]
    """Unnormalised weights of one row, its mean and covariance; the sum of the weights and of their squares."""
    wide()
    n = len(logw)
    top = _largest(logw)
    total, squares, mx, my = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        w[i] = 1.0 if top == -np.inf else exp(logw[i] - top)
    for i in range(n):
        total += w[i]
        squares += w[i] * w[i]
        mx += w[i] * x[2 * i]
        my += w[i] * x[2 * i + 1]
    mx, my = mx / total, my / total
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(n):
        ex, ey = x[2 * i] - mx, x[2 * i + 1] - my
        xx += w[i] * (ex * ex)
        xy += w[i] * (ex * ey)
        yy += w[i] * (ey * ey)
    mean[0], mean[1] = mx, my
    P[0, 0], P[0, 1], P[1, 0], P[1, 1] = xx / total, xy / total, xy / total, yy / total
    return top, total, squares


@kernel
def _summary(x, logw, mean, P):  # type: ignore[no-untyped-def]
    wide()
    w = np.empty(logw.shape[1])
    for r in range(logw.shape[0]):
        _weighed(x[r], logw[r], w, mean[r], P[r])


@kernel
def _conclude(  # type: ignore[no-untyped-def]
    x, logw, packets, readings, ranged, A, slope, variance, gain, key, resample, jitter, mean, P, out, logw_out
):
    wide()
    n = logw.shape[1]
    X, Y, links = np.empty(likelihood.BLOCK), np.empty(likelihood.BLOCK), np.empty((readings.shape[1], 6))
    w, count, marks, words = np.empty(n), np.empty(n, np.int64), np.empty(n + 1, np.int64), np.empty((2, n), np.uint32)
    h = BANDWIDTH * n ** (-1 / 6)
    shrink = np.sqrt(1 - h * h)
    for r in range(logw.shape[0]):
        told = packets[r], readings[r], ranged, A, slope, variance, gain
        likelihood.add_teammates(x[r], 2, logw[r], told, X, Y, links, logw_out[r])
        top, total, squares = _weighed(x[r], logw_out[r], w, mean[r], P[r])
        if total * total < n / 2 * squares:
            u, _ = kernels.uniform_pair(np.int64(key[r, 0]), np.int64(key[r, 1]), resample, 0)
            kernels.mark_ancestors(w, total, u, count, marks)
            kernels.draw_words(np.int64(key[r, 0]), np.int64(key[r, 1]), jitter, words)
            _jitter(x[r], marks, mean[r], P[r], shrink, h, words, out[r])
            _fill(logw_out[r], 0.0)
        else:
            _copy(x[r], out[r])
            if top == -np.inf:
                _fill(logw_out[r], 0.0)


@inlined
def _copy(a, out):  # type: ignore[no-untyped-def]
    wide()
    for i in range(len(a)):
        out[i] = a[i]


@inlined
def _fill(out, value):  # type: ignore[no-untyped-def]
    wide()
    for i in range(len(out)):
        out[i] = value


@inlined
def _jitter(x, marks, mean, P, shrink, h, words, out):  # type: ignore[no-untyped-def]
    """m + shrink (x_a - m) + h L noise, L the Cholesky factor of P, which may be singular."""
    wide()
    first, second = words[0], words[1]
    mx, my = mean[0], mean[1]
    a = np.sqrt(max(P[0, 0], 0.0))
    b = P[1, 0] / a if a > 0 else 0.0
    c = h * np.sqrt(max(P[1, 1] - b * b, 0.0))
    a, b = h * a, h * b
    mx, my = (1 - shrink) * mx, (1 - shrink) * my
    for i in range(len(first)):
        g0, g1 = kernels.normal_pair(first[i], second[i])
        out[2 * i] = mx + a * g0
        out[2 * i + 1] = my + (b * g0 + c * g1)
    ancestor = 0
    for i in range(len(first)):
        ancestor = max(ancestor, marks[i])
        j = np.uint64(2 * ancestor)
        out[2 * i] += shrink * x[j]
        out[2 * i + 1] += shrink * x[j + np.uint64(1)]

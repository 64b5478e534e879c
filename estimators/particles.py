"""What every particle filter here shares: spreading a prior, weighting, moments, and renewal.

Renewal is systematic resampling where the effective sample size falls below half, followed by Liu & West's kernel:
particles shrink towards the mean by a = sqrt(1 - h^2) and are spread by h times the covariance, so that mean and
covariance stay what they were.

Source: J. Liu, M. West, "Combined parameter and state estimation in simulation-based filtering", 2001.
"""

import numpy as np

from cooploc.estimators import kernels
from cooploc.estimators.angles import circular_mean, wrap, wrap_heading
from cooploc.estimators.interface import Array, Belief, Keys


def spread(prior: Belief, key: Keys, n: int) -> Array:
    """Particles (r, n, d) drawn from the prior."""
    return wrap_heading(prior.x[:, None, :] + _scatter(prior.P, _noise(key, 0, kernels.INIT, n, prior.x.shape[-1])))


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
    h = 0.3 * n ** (-1 / 6)
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

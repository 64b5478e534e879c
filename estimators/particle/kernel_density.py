"""A few particles as a density: Gaussian kernels around a sample of them.

With a = sqrt(1 - h^2), the kernels N(m + a (x_s - m), h^2 P) have together the mean m and covariance P of the
particles, up to what is lost by sampling. h = S^(-1/6) is Scott's rule for S samples of two numbers.

Source: J. Liu, M. West, "Combined parameter and state estimation in simulation-based filtering", 2001; D. Scott,
"Multivariate density estimation", 1992.
"""

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.estimators.particle.mixtures import Mixture
from cooploc.estimators.particle.steps import summary, weights


def sample(x: Array, logw: Array, u: Array, S: int) -> Array:
    """A packet (r, 3 + 2 S) of particles x (r, N, d): the kernel's P_xx, P_xy, P_yy, then the kernels' places.

    Args:
        x: particles.
        logw: their log-weights (r, N).
        u: a uniform (r,) per row, for systematic sampling.
        S: number of samples, at least 2.

    """
    mean, P = summary(x[..., :2], logw)
    points = (np.arange(S) + u[:, None]) / S
    cumulated = np.cumsum(weights(logw), -1)
    chosen = np.stack([np.searchsorted(c, p) for c, p in zip(cumulated, points, strict=True)])
    chosen = np.minimum(chosen, x.shape[1] - 1)  # where rounding leaves the sum below 1
    h2 = S ** (-1 / 3)
    away = np.take_along_axis(x[..., :2], chosen[..., None], 1) - mean[:, None]
    places = mean[:, None] + np.sqrt(1 - h2) * away
    return np.concatenate([h2 * P[:, (0, 0, 1), (0, 1, 1)], places.reshape(len(x), 2 * S)], -1)


def density(packets: Array) -> Mixture:
    """The density of packets (..., 3 + 2 S), as a mixture of S equal kernels; nan where there is no packet."""
    H = np.stack([packets[..., 0:2], packets[..., 1:3]], -2)[..., None, :, :]
    places = packets[..., 3:].reshape(*packets.shape[:-1], (packets.shape[-1] - 3) // 2, 2)
    w = np.where(np.isnan(places[..., 0]), np.nan, 1 / places.shape[-2])
    return Mixture(w, places, np.broadcast_to(H, (*places.shape, 2)))

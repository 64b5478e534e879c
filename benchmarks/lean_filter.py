"""The cooperative particle filter of `particle_filter.py` as a good numpy user writes it around filterpy's resampling.

x and y apart, squared distances, a logarithm for a link's distance and one for its variance, and no product of matrices
in the loops: the leanest reference for `mrsl-rssi[anchor_reading=rssi,particles=500]`.
"""

from typing import Any

import numpy as np
from filterpy.monte_carlo import systematic_resample

N = 500  # particles
H = 0.3 * N ** (-1 / 6)
NEAR = 0.1


def lean_loop(stream: Any, trials: int, ticks: int) -> Any:
    """Positions (trials, ticks, n, 2) of the first trials and ticks of a stream."""
    rng, told, n = np.random.default_rng(0), stream.world, stream.robots
    odometry, anchor_rssi, rssi = stream.senses.odometry, stream.senses.anchor_rssi, stream.air.rssi
    anchor, radio, sigma = told.sensors["anchor_rssi"], told.sensors["radio_rssi"], told.motion.sigma
    out = np.empty((trials, ticks, n, 2))
    for t in range(trials):
        spread = np.linalg.cholesky(stream.prior.P[t])
        x = [stream.prior.x[t, i][:, None] + spread[i] @ rng.standard_normal((2, N)) for i in range(n)]
        w = [np.full(N, 1 / N) for _ in range(n)]
        for k in range(ticks):
            said = []
            for i in range(n):
                x[i] += odometry[t, k, i][:, None] + sigma * rng.standard_normal((2, N))
                log_likelihood = np.zeros(N)
                for a, q in enumerate(told.anchors):
                    y = missed(anchor, x[i], q, anchor_rssi[t, k, i, a])[0]
                    log_likelihood -= y * y
                w[i] = reweighed(w[i], log_likelihood / (2 * anchor.sigma**2))
                said.append(moments(x[i], w[i]))
            for i in range(n):
                w[i] = reweighed(w[i], heard(radio, x[i], said, rssi[t, k, i], stream.air.link[t, k, i]))
                mx, my, xx, xy, yy = moments(x[i], w[i])
                out[t, k, i] = mx, my
                if 1 / (w[i] @ w[i]) < N / 2:
                    mean, L = np.array([[mx], [my]]), np.linalg.cholesky([[xx, xy], [xy, yy]])
                    chosen = x[i][:, systematic_resample(w[i])]
                    x[i] = mean + np.sqrt(1 - H**2) * (chosen - mean) + H * (L @ rng.standard_normal((2, N)))
                    w[i] = np.full(N, 1 / N)
    return out


def missed(sensor: Any, x: Any, q: Any, z: float) -> tuple[Any, Any, Any, Any]:
    """A reading less what each particle expects, east and north of the place, and the squared distance."""
    dx, dy = x[0] - q[0], x[1] - q[1]
    D = np.maximum(dx * dx + dy * dy, NEAR**2)
    return (z - sensor.A) + (5 * sensor.eta / np.log(10)) * np.log(D), dx, dy, D


def heard(sensor: Any, x: Any, said: Any, z: Any, link: Any) -> Any:
    """The log-likelihood of all links, with the variance that the sender's position adds."""
    total, gain = np.zeros(N), (10 * sensor.eta / np.log(10)) ** 2
    for j in np.flatnonzero(link):
        mx, my, xx, xy, yy = said[j]
        y, dx, dy, D = missed(sensor, x, (mx, my), z[j])
        v = sensor.sigma**2 + gain * (dx * (xx * dx + 2 * xy * dy) + yy * dy * dy) / (D * D)
        total -= y * y / v + np.log(v)
    return total / 2


def reweighed(w: Any, log_likelihood: Any) -> Any:
    w = w * np.exp(log_likelihood - log_likelihood.max())
    return w / w.sum()


def moments(x: Any, w: Any) -> tuple[float, float, float, float, float]:
    mx, my = x @ w
    dx, dy = x[0] - mx, x[1] - my
    return mx, my, (w * dx) @ dx, (w * dx) @ dy, (w * dy) @ dy

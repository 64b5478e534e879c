"""Places drawn from what a packet and its reading say alone: the detection model, the other way round.

The sender lies at q ~ sum_k w_k N(m_k, P_k). The robot lies from it at the distance that was read, in the direction
that was read; a radio reads none, and then all are as likely. An RSSI becomes a distance by its own path loss. Each is
drawn with the sensor's error in the reading itself, as the source draws range and bearing.

Source: A. Prorok, A. Martinoli, "A reciprocal sampling algorithm for lightweight distributed multi-robot localization",
IROS 2011.
"""

import numpy as np

from cooploc.estimators.interface import Array, Indices, Keys, Mask, Sensor
from cooploc.estimators.models.sensors import LogDistance, Range, Sighting
from cooploc.estimators.particle import draws
from cooploc.estimators.particle.mixtures import Mixture
from cooploc.estimators.plugins.errors import BadInput

KNOWN = LogDistance, Range, Sighting


def require_inverse(sensor: Sensor) -> None:
    """Refuse, before anything runs, a sensor that cannot be read the other way round.

    Raises:
        BadInput: it is none of those of `models/sensors.py`.

    """
    if not isinstance(sensor, KNOWN):
        raise BadInput(
            f"reciprocal sampling draws places from readings of {', '.join(one.__name__ for one in KNOWN)}; the world "
            f"has {type(sensor).__name__}: set alpha=0"
        )


def places(sensor: Sensor, sent: Mixture, z: Array, heading: Array, key: Keys, tick: int) -> Array:
    """Places (r, N, 2) where the robot may be, nan in a row where no sender has a reading.

    Args:
        sensor: of the readings.
        sent: what each sender believes, (r, n, K).
        z: readings (r, n, k), nan where there is none.
        heading: of each particle (r, N) [rad], which a bearing is against; 0 where there is a compass.
        key: of the random numbers.
        tick: the number of this tick.

    """
    r, N = heading.shape
    u = draws.uniforms(key, tick, draws.SENDER, N)
    j = _one_of(usable(sent, z).astype(float), u[..., 0])
    rows = np.arange(r)[:, None]
    k = _one_of(np.nan_to_num(sent.w)[rows, j], u[..., 1])
    q = _scattered(sent.x[rows, j, k], sent.P[rows, j, k], draws.normals(key, tick, draws.PLACE, N))
    noise, turn = draws.normals(key, tick, draws.NOISE, N), draws.uniforms(key, tick, draws.SHARE, N)[..., 1]
    away, angle = _inverse(sensor, z[rows, j], noise, turn, heading)
    return np.asarray(q - away[..., None] * np.stack([np.cos(angle), np.sin(angle)], -1))


def usable(sent: Mixture, z: Array) -> Mask:
    """The senders (r, n) that have a reading and a belief."""
    heard: Mask = ~np.isnan(z).any(-1) & (np.nan_to_num(sent.w).sum(-1) > 0)
    return heard


def _inverse(sensor: Sensor, z: Array, noise: Array, turn: Array, heading: Array) -> tuple[Array, Array]:
    """Distance [m] and direction [rad] of the sender, seen from the robot: r = z + error, and so on."""
    if isinstance(sensor, LogDistance):
        away = 10 ** ((sensor.A - z[..., 0] - sensor.sigma * noise[..., 0]) / (10 * sensor.eta))
        return away, 2 * np.pi * turn
    if isinstance(sensor, Sighting):
        angle = heading + z[..., 1] + sensor.sigma_bearing * noise[..., 1]
        return z[..., 0] + sensor.sigma_range * noise[..., 0], angle
    return z[..., 0] + np.sqrt(sensor.R[0, 0]) * noise[..., 0], 2 * np.pi * turn


def _one_of(weight: Array, u: Array) -> Indices:
    """An index by weights (r, n), or (r, N, n), for each of the uniforms u (r, N)."""
    cumulated = np.cumsum(weight, -1)
    if weight.ndim == 2:
        cumulated = cumulated[:, None]
    index: Indices = (u[..., None] * cumulated[..., -1:] > cumulated).sum(-1)
    return np.asarray(np.minimum(index, weight.shape[-1] - 1))


def _scattered(m: Array, P: Array, noise: Array) -> Array:
    """m + L noise, L the lower triangular root of P (..., 2, 2), which may be singular."""
    a = np.sqrt(np.maximum(P[..., 0, 0], 0.0))
    b = np.divide(P[..., 0, 1], a, out=np.zeros_like(a), where=a > 0)
    c = np.sqrt(np.maximum(P[..., 1, 1] - b * b, 0.0))
    east, north = noise[..., 0], noise[..., 1]
    return np.asarray(m + np.stack([a * east, b * east + c * north], -1))

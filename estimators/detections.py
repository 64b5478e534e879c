"""Places drawn from what a packet and its reading say alone: the detection model, the other way round.

The sender lies at q ~ sum_k w_k N(m_k, P_k). The robot lies from it at the distance that was read, in the direction
that was read; a radio reads none, and then all are as likely. An RSSI becomes a distance by its own path loss. Each is
drawn with the sensor's error in the reading itself, as the source draws range and bearing.

Source: A. Prorok, A. Martinoli, "A reciprocal sampling algorithm for lightweight distributed multi-robot localization",
IROS 2011.
"""

import numpy as np

from cooploc.estimators import random_numbers
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Indices, Keys, Mask, Sensor
from cooploc.estimators.mixtures import Mixture
from cooploc.estimators.models import LogDistance, Range, Sighting

KNOWN = LogDistance, Range, Sighting


def require_inverse(sensor: Sensor) -> None:
    """Refuse, before anything runs, a sensor that cannot be read the other way round.

    Raises:
        BadInput: it is none of those of `models.py`.

    """
    if not isinstance(sensor, KNOWN):
        raise BadInput(
            f"reciprocal sampling draws places from readings of {', '.join(one.__name__ for one in KNOWN)}; the world "
            f"has {type(sensor).__name__}: set alpha=0"
        )


def places(sensor: Sensor, sent: Mixture, z: Array, chosen: Mask, heading: Array, key: Keys, tick: int) -> Array:
    """Places (c, 2) where robots may be, one for each of the c particles that are `chosen`, row by row.

    Args:
        sensor: of the readings.
        sent: what each sender believes, (r, n, K).
        z: readings (r, n, k), nan where there is none.
        chosen: particles (r, N), in rows that have a usable reading.
        heading: of each particle (r, N) [rad], which a bearing is against; 0 where there is a compass.
        key: of the random numbers (r, 2).
        tick: the number of this tick.

    """
    N, row = chosen.shape[1], np.nonzero(chosen)[0]
    u, turn = (
        random_numbers.further_uniforms(key, tick, what, N)[chosen]
        for what in (random_numbers.SENDER, random_numbers.SHARE)
    )
    at, noise = (
        random_numbers.further_normals(key, tick, what, N)[chosen]
        for what in (random_numbers.PLACE, random_numbers.NOISE)
    )
    j = _one_of(usable(sent, z)[row].astype(float), u[:, 0])
    k = _one_of(np.nan_to_num(sent.w)[row, j], u[:, 1])
    q = _scatter(sent.x[row, j, k], sent.P[row, j, k], at)
    away, angle = _inverse(sensor, z[row, j], noise, turn[:, 1], heading[chosen])
    return np.asarray(q - away[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1))


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
    """An index (c,) by weights (c, n), for each of the uniforms u (c,)."""
    cumulated = np.cumsum(weight, -1)
    index: Indices = (u[:, None] * cumulated[:, -1:] > cumulated).sum(-1)
    return index


def _scatter(m: Array, P: Array, noise: Array) -> Array:
    """m + L noise, L the lower triangular root of P (..., 2, 2), which may be singular."""
    a = np.sqrt(np.maximum(P[..., 0, 0], 0.0))
    b = np.divide(P[..., 0, 1], a, out=np.zeros_like(a), where=a > 0)
    c = np.sqrt(np.maximum(P[..., 1, 1] - b * b, 0.0))
    east, north = noise[..., 0], noise[..., 1]
    return np.asarray(m + np.stack([a * east, b * east + c * north], -1))

"""The models of a world, linearised at a state: in a compiled loop over rows where they are built in.

Another motion or sensor linearises itself, by its `move` or its `innovation`: the same equations, in numpy.
"""

import numpy as np

from cooploc.estimators.compiled.jit import readable, spread_out
from cooploc.estimators.interface import Array, Motion, Senses, Sensor
from cooploc.estimators.kalman import row_kernels
from cooploc.estimators.models.motion import Unicycle
from cooploc.estimators.models.sensors import LogDistance, Range, Sighting

KINDS: dict[type, int] = {Range: row_kernels.RANGE, LogDistance: row_kernels.RSSI, Sighting: row_kernels.SIGHTING}


def move(motion: Motion, x: Array, z: Senses) -> tuple[Array, Array, Array]:
    """x', F, Q of states x (..., d) after a tick's odometry."""
    if type(motion) is not Unicycle:
        return motion.move(x, z.odometry, z.dt)
    out, F, Q = np.empty(x.shape), np.empty((*x.shape, 3)), np.empty((*x.shape, 3))
    row_kernels.drive(*_driving(motion, x, z), out.reshape(-1, 3), F.reshape(-1, 3, 3), Q.reshape(-1, 3, 3))
    return out, F, Q


def driven(motion: Unicycle, x: Array, P: Array, z: Senses) -> tuple[Array, Array, Array]:
    """x', F P F' + Q, and F, in one loop."""
    out, P1, F = np.empty(x.shape), np.empty(P.shape), np.empty(P.shape)
    rows = readable(P).reshape(-1, 3, 3), out.reshape(-1, 3), P1.reshape(-1, 3, 3), F.reshape(-1, 3, 3)
    row_kernels.drive_and_widen(*_driving(motion, x, z), *rows)
    return out, P1, F


def _driving(motion: Unicycle, x: Array, z: Senses) -> tuple[Array, Array, Array, tuple[float, float]]:
    """States, odometry and its variances as `row_kernels.drive` takes them."""
    variances = motion.sigma_v**2 * motion.tick, motion.sigma_omega**2 * motion.tick
    return readable(x).reshape(-1, 3), readable(z.odometry).reshape(-1, 2), readable(z.dt).reshape(-1), variances


def innovation(sensor: Sensor, x: Array, q: Array, z: Array) -> tuple[Array, Array, Array]:
    """y (..., k), H (..., k, d), Hq (..., k, 2) of readings z (..., k) of places q (..., 2) at states x (..., d)."""
    if type(sensor) not in KINDS:
        return sensor.innovation(x, q, z)
    lead, d, k = x.shape[:-1], x.shape[-1], z.shape[-1]
    if q.ndim > 1 and q.shape[:-1] != lead:
        lead = np.broadcast_shapes(lead, q.shape[:-1])
    A, slope = (sensor.A, 10 * sensor.eta / np.log(10)) if isinstance(sensor, LogDistance) else (0.0, 0.0)
    one_place = readable(q).reshape(-1, q.shape[-1]) if q.ndim == 1 else _rows(q, lead)
    y, H = np.empty((*lead, k)), np.empty((*lead, k, d))
    row_kernels.relate(
        KINDS[type(sensor)], A, slope, _rows(x, lead), one_place, _rows(z, lead), y.reshape(-1, k), H.reshape(-1, k, d)
    )
    return y, H, -H[..., :2]


def _rows(part: Array, lead: tuple[int, ...]) -> Array:
    """An array (..., m) as rows (r, m), one for each of `lead`."""
    return spread_out(part, (*lead, part.shape[-1])).reshape(-1, part.shape[-1])

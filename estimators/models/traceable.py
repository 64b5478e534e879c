"""The shipped models as pure functions of an array library, for those that trace, such as JAX.

`xp` is the library, `jax.numpy` or another with numpy's names; nothing is written in place, and no branch looks at a
value. The numbers are those of the models in `motion` and `sensors`, whose formulas these are; a nan stays a nan.

    H = jax.jacfwd(lambda x: expect(jnp, sensor, x, place))(x)
    y = innovation(jnp, sensor, x, place, reading)
"""

from collections.abc import Callable
from math import pi
from typing import Any

from cooploc.estimators.interface import TOO_NEAR_TO_RANGE, Motion, Sensor
from cooploc.estimators.models.motion import Displacement, Unicycle
from cooploc.estimators.models.sensors import NEAR, Bearing, LogDistance, Range, Sighting

Traced = Any  # an array of the library


def moved(xp: Any, motion: Motion, x: Traced, u: Traced, dt: Traced) -> Traced:
    """x' (..., d) of states (..., d) by odometry (..., k) over dt (...); absent odometry says: did not move.

    Raises:
        TypeError: the motion has no traceable form.

    """
    u = xp.where(xp.isnan(u), 0.0, u)
    if isinstance(motion, Displacement):
        return xp.concatenate([x[..., :2] + u, x[..., 2:]], -1)
    if isinstance(motion, Unicycle):
        arc, turn = u[..., 0] * dt, u[..., 1] * dt
        a = x[..., 2] + turn / 2
        north = x[..., 1] + arc * xp.sin(a)
        return xp.stack([x[..., 0] + arc * xp.cos(a), north, wrap(xp, x[..., 2] + turn)], -1)
    raise TypeError(f"{type(motion).__name__} has no traceable form; known are Displacement and Unicycle")


def expect(xp: Any, sensor: Sensor, x: Traced, q: Traced) -> Traced:
    """The mean reading (..., k) of places q (..., 2) at states (..., d).

    Raises:
        TypeError: the sensor has no traceable form.

    """
    try:
        return FORMS[type(sensor)](xp, sensor, x, q)
    except KeyError:
        known = ", ".join(one.__name__ for one in FORMS)
        raise TypeError(f"{type(sensor).__name__} has no traceable form; known are {known}") from None


def innovation(xp: Any, sensor: Sensor, x: Traced, q: Traced, z: Traced) -> Traced:
    """z - h(x, q) (..., k), with the angle wrapped; nan where a reading is absent or a range is refused."""
    y = z - expect(xp, sensor, x, q)
    if isinstance(sensor, Bearing):
        return wrap(xp, y)
    if isinstance(sensor, Range | Sighting):
        short = z[..., :1] < TOO_NEAR_TO_RANGE
        return xp.concatenate([xp.where(short, xp.nan, y[..., :1]), wrap(xp, y[..., 1:])], -1)
    return y


def wrap(xp: Any, angle: Traced) -> Traced:
    """The same angle in [-pi, pi)."""
    return xp.remainder(angle + pi, 2 * pi) - pi


def _square(x: Traced, q: Traced) -> Traced:
    return (x[..., 0] - q[..., 0]) ** 2 + (x[..., 1] - q[..., 1]) ** 2


def _level(xp: Any, sensor: Any, x: Traced, q: Traced) -> Traced:
    d2 = xp.clip(_square(x, q), min=NEAR**2)
    return (sensor.A - 5 * sensor.eta * xp.log10(d2))[..., None]


def _distance(xp: Any, _: Any, x: Traced, q: Traced) -> Traced:
    return xp.sqrt(_square(x, q))[..., None]


def _direction(xp: Any, _: Any, x: Traced, q: Traced) -> Traced:
    away = xp.arctan2(q[..., 1] - x[..., 1], q[..., 0] - x[..., 0])
    return wrap(xp, away - x[..., 2] if x.shape[-1] > 2 else away)[..., None]


def _both(xp: Any, sensor: Any, x: Traced, q: Traced) -> Traced:
    return xp.concatenate([_distance(xp, sensor, x, q), _direction(xp, sensor, x, q)], -1)


FORMS: dict[type, Callable[[Any, Any, Traced, Traced], Traced]] = {
    LogDistance: _level,
    Range: _distance,
    Bearing: _direction,
    Sighting: _both,
}

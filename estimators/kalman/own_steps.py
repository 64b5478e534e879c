"""The two steps of an EKF that need no teammate: a move by odometry, an update by readings of fixed things."""

from cooploc.estimators.interface import Array, Senses, World
from cooploc.estimators.kalman.settings import Settings
from cooploc.estimators.kalman.update import ENGINES
from cooploc.estimators.models.anchor_readings import fixed


def moved(p: Settings, world: World, x: Array, P: Array, z: Senses) -> tuple[Array, Array, Array]:
    """x' = f(x, u),  P' = F P F' + Q,  and F itself; x (..., d), P (..., d, d)."""
    x, F, Q = world.motion.move(x, z.odometry, z.dt)
    return *ENGINES[p.engine].predict(x, P, F, Q), F


def corrected(p: Settings, world: World, x: Array, P: Array, z: Senses) -> tuple[Array, Array]:
    """x' = x + K y,  P' = (I - K H) P (I - K H)' + K R K', one reading of an anchor or a landmark after the other."""
    for sensor, place, reading in fixed(world, z, p.anchor_reading):
        y, H, _ = sensor.innovation(x, place, reading)
        x, P = ENGINES[p.engine].update(x, P, y, H, sensor.R, p.gate)
    return x, P

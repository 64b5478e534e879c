"""The two steps of an EKF that need no teammate: a move by odometry, an update by readings of fixed things."""

from cooploc.estimators.compiled.jit import readable
from cooploc.estimators.interface import Array, Senses, World
from cooploc.estimators.kalman import row_kernels
from cooploc.estimators.kalman.landmark_kernels import Sightings
from cooploc.estimators.kalman.linearised import driven, innovation, move
from cooploc.estimators.kalman.settings import Settings
from cooploc.estimators.kalman.update import ENGINES
from cooploc.estimators.models.anchor_readings import fixed
from cooploc.estimators.models.motion import Unicycle
from cooploc.estimators.models.sensors import Sighting


def moved(p: Settings, world: World, x: Array, P: Array, z: Senses) -> tuple[Array, Array, Array]:
    """x' = f(x, u),  P' = F P F' + Q,  and F itself; x (..., d), P (..., d, d)."""
    if p.engine == "batched" and type(world.motion) is Unicycle:
        return driven(world.motion, x, P, z)
    x, F, Q = move(world.motion, x, z)
    return *ENGINES[p.engine].predict(x, P, F, Q), F


def corrected(p: Settings, world: World, x: Array, P: Array, z: Senses) -> tuple[Array, Array]:
    """x' = x + K y,  P' = (I - K H) P (I - K H)' + K R K', one reading of an anchor or a landmark after the other."""
    camera = camera_alone(p, world)
    if camera is not None:
        return _sighted(x, P, world.landmarks, z.landmark, camera, p.gate)
    for sensor, place, reading in fixed(world, z, p.anchor_reading):
        y, H, _ = innovation(sensor, x, place, reading)
        x, P = ENGINES[p.engine].update(x, P, y, H, sensor.R, p.gate)
    return x, P


def camera_alone(p: Settings, world: World) -> Sighting | None:
    """The camera whose sightings of landmarks are all that is used of fixed things, for those who compile them."""
    camera = world.sensors.get("landmark")
    if p.engine != "batched" or p.anchor_reading == "none" or type(camera) is not Sighting:
        return None
    return None if "anchor_rssi" in world.sensors or "anchor_range" in world.sensors else camera


def sightings(world: World, z: Array, camera: Sighting, gate: float) -> Sightings:
    """Those of landmarks z (t, n, l, 2), as compiled loops take them."""
    return Sightings(world.landmarks, readable(z), camera.R, gate)


def _sighted(x: Array, P: Array, places: Array, z: Array, camera: Sighting, gate: float) -> tuple[Array, Array]:
    """The same by all sightings (..., l, 2) of landmarks, in one compiled loop."""
    d, x, P = x.shape[-1], x.copy(), P.copy()
    rows = x.reshape(-1, d), P.reshape(-1, d, d)
    row_kernels.sight(*rows, places, readable(z).reshape(-1, *z.shape[-2:]), camera.R, gate)
    return x, P

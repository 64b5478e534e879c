"""An extended Kalman filter in JAX: the slopes are derivatives that JAX takes, the loop over readings is a scan."""

import jax
import jax.numpy as jnp
import numpy as np

from cooploc import Belief

jax.config.update("jax_enable_x64", True)


def innovation(x, q, z, radio):
    """Of an RSSI [dBm] (1,), or of range [m] and bearing [rad] (2,)."""
    dx, dy = q - x[:2]
    d = jnp.sqrt(dx**2 + dy**2)
    if len(z) == 1:
        return z - (radio[0] - 10 * radio[1] * jnp.log10(jnp.maximum(d, 0.1)))
    turn = z[1] - (jnp.arctan2(dy, dx) - x[2])
    return jnp.stack([z[0] - d, jnp.arctan2(jnp.sin(turn), jnp.cos(turn))])


@jax.jit
def corrected(x, P, places, readings, R, radio):
    def one(belief, reading):
        (x, P), (q, z) = belief, reading
        there = jnp.isfinite(z).all()
        y, H = innovation(x, q, z, radio), -jax.jacfwd(innovation)(x, q, z, radio)
        K = jnp.linalg.solve(H @ P @ H.T + R, H @ P).T
        return (jnp.where(there, x + K @ y, x), jnp.where(there, P - K @ H @ P, P)), None

    return jax.lax.scan(one, (x, P), (places, readings))[0]


class JaxEkf:
    """One robot."""

    uses = ("odometry", "anchor_rssi|landmark")

    def __init__(self, prior, world, robot, key):
        self.x, self.P, self.world = *prior, world

    def predict(self, z):
        self.x, F, Q = self.world.motion.move(self.x, z.odometry, z.dt)
        self.P = F @ self.P @ F.T + Q

    def correct(self, z):
        sensor = self.world.sensors.get("anchor_rssi") or self.world.sensors["landmark"]
        radio = np.array([getattr(sensor, "A", 0.0), getattr(sensor, "eta", 0.0)])
        there = (self.world.anchors, z.anchor_rssi[:, None]) if radio.any() else (self.world.landmarks, z.landmark)
        self.x, self.P = map(np.array, corrected(self.x, self.P, *there, sensor.R, radio))

    def estimate(self):
        x = np.concatenate([self.x[:2], np.arctan2(np.sin(self.x[2:]), np.cos(self.x[2:]))])
        return Belief(x, (self.P + self.P.T) / 2)

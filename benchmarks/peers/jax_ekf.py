# SPDX-License-Identifier: MIT
"""An extended Kalman filter in JAX: the slopes are derivatives that JAX takes, the loop over readings is a scan."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import cooploc as cl
from cooploc.estimators.models import innovation

jax.config.update("jax_enable_x64", True)


@partial(jax.jit, static_argnums=0)
def corrected(sensor, x, P, places, readings):
    def one(belief, seen):
        (x, P), (q, z) = belief, seen
        there, z = jnp.isfinite(z).all(), jnp.nan_to_num(z)
        y, H = innovation(jnp, sensor, x, q, z), -jax.jacfwd(innovation, 2)(jnp, sensor, x, q, z)
        K = jnp.linalg.solve(H @ P @ H.T + sensor.R, H @ P).T
        return (jnp.where(there, x + K @ y, x), jnp.where(there, P - K @ H @ P, P)), None

    return jax.lax.scan(one, (x, P), (places, readings))[0]


class JaxEkf:
    """One robot."""

    uses = ("odometry", "anchor_rssi|landmark")

    def __init__(self, prior, world, robot, key):
        self.x, self.P, self.world = *prior, world

    def predict(self, z):
        F, c, Q = cl.motion_of(self.world, z).linear(self.x)
        self.x, self.P = F @ self.x + c, F @ self.P @ F.T + Q

    def correct(self, z):
        ((channel, sensor),) = self.world.sensors.items()
        places = self.world.landmarks if channel == "landmark" else self.world.anchors
        readings = z.landmark if channel == "landmark" else z.anchor_rssi[:, None]
        self.x, self.P = map(np.array, corrected(sensor, self.x, self.P, places, readings))

"""Reciprocal sampling: a share of a robot's particles is drawn from the packets it just heard, not from its belief.

A robot broadcasts its particles as K clusters. A robot that has a reading of the sender multiplies its weights with the
likelihood of that reading, as MRSL does. Then each particle is, with probability alpha, drawn again from the detection
model, and nothing corrects the weights for that: a robot that is lost finds back to where its team sees it.

Our reading: the receiver of a packet makes the detection, in the source the sender does; particles are resampled only
where their weights are poor; one that is drawn again has the mean weight of all. Draws, clusters and alpha = 0.06
follow the public implementation of N. Zimmerman, A. Giusti, J. Guzzi, IROS 2024.

Source: A. Prorok, A. Martinoli, "A reciprocal sampling algorithm for lightweight distributed multi-robot localization",
IROS 2011; the clusters: A. Prorok, A. Bahr, A. Martinoli, ICRA 2012.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from cooploc.estimators import mixtures, random_numbers
from cooploc.estimators import particles as shared
from cooploc.estimators.errors import BadInput, Limits
from cooploc.estimators.interface import Array, Belief, Indices, Keys, Mail, Mask, Rows, Senses, Sensor, World
from cooploc.estimators.mixtures import Mixture, clusters
from cooploc.estimators.models import LogDistance, Range, Sighting
from cooploc.estimators.particle_kernels import systematic
from cooploc.estimators.particles import poor, resample, scatter, summary, weights
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable

TINY = 1e-300  # a weight that is 0 to all others
FAR = 1e3  # sides of the arena: a broken reading may draw places beyond
KNOWN = LogDistance, Range, Sighting


@dataclass(frozen=True)
@shared.explain
class ReciprocalPf:
    """Particle filter on own readings; clusters of particles are exchanged, and particles drawn from detections.

    Args:
        reading: of a packet, where no camera sees teammates: "rssi" [dBm] or "range" [m].
        alpha: probability, in [0, 1], that a particle is drawn again from a detection.
        clusters: of particles in a packet, 1 to 100.
        report: the belief of all particles "after" the draws, or "before" them: the draws are then proposals only.
    """

    api: ClassVar[int] = 1
    limits: ClassVar[Limits] = {"alpha": (0, 1), "clusters": (1, 100)}
    sends: ClassVar[str] = "particles as clusters"
    consistency: ClassVar[str] = "no guarantee: repeated counting narrows it, draws widen it"
    particles: int = 200
    anchor_reading: shared.AnchorReading = "doa"
    density: Literal["constant", "exact"] = tunable("constant", choices=("constant", "exact"), where=shared.DOA)
    residual: Literal["wrapped", "sum", "corners", "code"] = "wrapped"
    M: int = tunable(5, 1, 10, where=shared.DOA)
    K: int = tunable(5, 1, 10, where=shared.DOA)
    decay: float = tunable(0.99, 0.5, 1.0, where=shared.DOA)
    temper: bool = tunable(True, choices=(True, False), where=shared.DOA)
    point: Literal["mean", "max"] = "mean"
    proposal: Literal["walk", "box", "best"] = "walk"
    box: float = 0.5  # [m]
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    precision: Literal["double", "single"] = "double"
    reading: shared.RadioReading = "range"
    alpha: float = 0.06
    clusters: int = 4
    report: Literal["after", "before"] = "after"
    loss: AssumedLoss = "world"

    uses = property(shared.team_channels)
    predict = shared.predict
    correct = shared.correct
    estimate = shared.estimate

    def init(self, prior: Belief, world: World, rows: Rows) -> shared.FilterState:
        for channel in ("sighting", "radio_rssi", "radio_range"):
            sensor = world.sensors.get(channel)
            if self.alpha and sensor and not isinstance(sensor, KNOWN):
                raise BadInput(
                    f"reciprocal sampling draws places from readings of {', '.join(one.__name__ for one in KNOWN)}; "
                    f"the world has {type(sensor).__name__}: set alpha=0"
                )
        return shared.init(self, prior, world, rows)

    def send(self, s: shared.FilterState, z: Senses) -> Array:
        """Send w, x, y, P_xx, P_xy, P_yy of each cluster: six numbers for each that has particles."""
        return clusters(s.x, weights(s.logw), self.clusters).pack()

    def fuse(self, s: shared.FilterState, z: Senses, mail: Mail) -> shared.FilterState:
        """w_i *= prod_j p(z_j | x_i, clusters of j); then x_i ~ p(x | z_j, clusters of j) with probability alpha."""
        sensor, readings = shared.team_readings(s.world, z, mail)
        sent = mixtures.unpack(mail.packets)
        logw = mixtures.weigh(sensor, sent, readings, s.x, s.logw)
        s = shared.resample_and_estimate(self, s._replace(logw=logw))
        heard: Mask = np.asarray(usable(sent, readings).any(-1))
        return self._draw_from_detections(s, sensor, sent, readings, heard) if self.alpha and heard.any() else s

    def _draw_from_detections(
        self, s: shared.FilterState, sensor: Sensor, sent: Mixture, readings: Array, heard: Mask
    ) -> shared.FilterState:
        """Draw particles of the rows that `heard` from a detection, each with probability alpha."""
        N, key, (old, logw) = s.x.shape[1], s.key ^ random_numbers.FURTHER, resample(s.x, s.logw, s.key, s.tick)
        w = weights(logw)
        u = random_numbers.uniforms(key, s.tick, random_numbers.ANCESTOR, 1)[:, 0, 0]
        resampled = np.take_along_axis(old, systematic(w, u)[..., None], 1)
        heading = resampled[..., 2] if resampled.shape[-1] > 2 else np.zeros(w.shape)
        again = heard[:, None] & (random_numbers.uniforms(key, s.tick, random_numbers.SHARE, N)[..., 0] < self.alpha)
        drawn = sample_places(sensor, sent, readings, again, heading, key, s.tick)
        x, logw = np.where(again[..., None], resampled, old), np.log(np.where(again, 1 / N, np.maximum(w, TINY)))
        low, high = s.world.arena
        near = (np.abs(drawn - (low + high) / 2) < FAR * np.max(high - low)).all(-1, keepdims=True)
        x[again, :2] = np.where(near, drawn, x[again, :2])
        x, logw = (each.astype(s.x.dtype, copy=False) for each in (x, logw))  # as they are kept
        belief = summary(x, logw) if self.report == "after" else s.belief
        row, part = heard[:, None], heard[:, None, None]
        belief = Belief(np.where(row, belief.x, s.belief.x), np.where(part, belief.P, s.belief.P))
        x, logw, due = np.where(part, x, s.x), np.where(row, logw, s.logw), np.where(heard, poor(weights(logw)), s.due)
        return shared.round_to_single(self, s._replace(x=x, logw=logw, due=due, belief=belief))


def sample_places(sensor: Sensor, sent: Mixture, z: Array, chosen: Mask, heading: Array, key: Keys, tick: int) -> Array:
    """Draw places (c, 2) by the detection model, one for each of the c particles that are `chosen`, row by row.

    The sender lies at q ~ sum_k w_k N(m_k, P_k), the robot from it at the distance and in the direction that were read,
    with the sensor's error; a radio reads no direction. `sent` (r, n, K) are the senders' beliefs, z (r, n, k) is nan
    where there is none; a bearing is against the particles' heading (r, N) [rad], 0 where there is a compass.
    """
    N, row = chosen.shape[1], np.nonzero(chosen)[0]
    u = random_numbers.uniforms(key, tick, random_numbers.SENDER, N)[chosen]
    turn = 2 * np.pi * random_numbers.uniforms(key, tick, random_numbers.SHARE, N)[chosen][:, 1]
    at = random_numbers.normals(key, tick, random_numbers.PLACE, N)[chosen]
    noise = random_numbers.normals(key, tick, random_numbers.NOISE, N)[chosen]
    j = _draw_index(usable(sent, z)[row].astype(float), u[:, 0])
    k = _draw_index(np.nan_to_num(sent.w)[row, j], u[:, 1])
    q = sent.x[row, j, k] + scatter(sent.P[row, j, k], at[:, None])[:, 0]
    z = z[row, j]
    if isinstance(sensor, LogDistance):
        away, angle = 10 ** ((sensor.A - z[:, 0] - sensor.sigma * noise[:, 0]) / (10 * sensor.eta)), turn
    elif isinstance(sensor, Sighting):
        away = z[:, 0] + sensor.sigma_range * noise[:, 0]
        angle = heading[chosen] + z[:, 1] + sensor.sigma_bearing * noise[:, 1]
    else:
        away, angle = z[:, 0] + np.sqrt(sensor.R[0, 0]) * noise[:, 0], turn
    return np.asarray(q - away[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1))


def usable(sent: Mixture, z: Array) -> Mask:
    """Return the senders (r, n) that have a reading and a belief."""
    return np.asarray(~np.isnan(z).any(-1) & (np.nan_to_num(sent.w).sum(-1) > 0))


def _draw_index(weight: Array, u: Array) -> Indices:
    """Return an index (c,) by weights (c, n), for each of the uniforms u (c,)."""
    cumulated = np.cumsum(weight, -1)
    return np.asarray((u[:, None] * cumulated[:, -1:] > cumulated).sum(-1))

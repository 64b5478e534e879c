"""Reciprocal sampling: a share of a robot's particles is drawn from what it just heard, not from what it believed.

A robot broadcasts its particles as K clusters. A robot that has a reading of the sender multiplies its weights with the
likelihood of that reading, as MRSL does. Then each particle is, with probability alpha, drawn again from the detection
model: from the sender's clusters, at the distance (and in the direction) that was read. So a robot that is lost finds
back to where its team sees it. Nothing corrects the weights for having been drawn there, and beliefs are multiplied as
if they were independent: the one biases it, the other makes it over-confident.

Our reading: the detection is made by the robot that receives the packet, by radio or by camera; in the source it is the
sender that detects, and says so in the packet. Particles are resampled by weight only where their weights are poor, as
in all filters here; a particle that is then drawn again has the mean weight of all, and the heading of one chosen by
weight. With ranges alone a draw may lie anywhere around the sender, so the draws widen the reported belief and pull its
mean towards the team; report="before" leaves them out.

The papers' text was not at hand: the draws, the clusters and alpha = 0.06 follow the public implementation of N.
Zimmerman, A. Giusti, J. Guzzi, "Resource-aware collaborative Monte Carlo localization", IROS 2024.

Source: A. Prorok, A. Martinoli, "A reciprocal sampling algorithm for lightweight distributed multi-robot localization",
IROS 2011; the clusters: A. Prorok, A. Bahr, A. Martinoli, ICRA 2012.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from cooploc.estimators import detections, mixtures, particles, random_numbers
from cooploc.estimators.errors import require
from cooploc.estimators.interface import Array, Belief, Mail, Mask, Rows, Senses, Sensor, World
from cooploc.estimators.mixtures import clusters
from cooploc.estimators.particle_kernels import systematic
from cooploc.estimators.particles import poor, resample, summary, weights

TINY = 1e-300  # a weight that is 0 to all others
FAR = 1e3  # sides of the arena


@dataclass(frozen=True)
class ReciprocalPf(particles.TeamParticleSettings):
    """Particle filter on own readings; clusters of particles are exchanged, and particles drawn from detections.

    Args:
        reading: of a packet, where no camera sees teammates: "rssi" [dBm] or "range" [m].
        alpha: probability, in [0, 1], that a particle is drawn again from a detection.
        clusters: of particles in a packet, 1 to 100.
        report: the belief of all particles "after" the draws, or "before" them: the draws are then proposals only.

    """

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "particles as clusters"
    consistency: ClassVar[str] = "no guarantee: repeated counting narrows it, draws widen it"
    alpha: float = 0.06
    clusters: int = 4
    report: Literal["after", "before"] = "after"

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, alpha=(0, 1), clusters=(1, 100))

    def init(self, prior: Belief, world: World, rows: Rows) -> particles.FilterState:
        for channel in ("sighting", "radio_rssi", "radio_range"):
            if self.alpha and channel in world.sensors:
                detections.require_inverse(world.sensors[channel])
        return particles.init_team(self, prior, world, rows)

    def predict(self, s: particles.FilterState, z: Senses) -> particles.FilterState:
        return particles.predict_team(self, s, z)

    def correct(self, s: particles.FilterState, z: Senses) -> particles.FilterState:
        return particles.correct_team(self, s, z)

    def send(self, s: particles.FilterState, z: Senses) -> Array:
        """w, x, y, P_xx, P_xy, P_yy of each cluster: six numbers for each that has particles."""
        return clusters(s.x, weights(s.logw), self.clusters).pack()

    def fuse(self, s: particles.FilterState, z: Senses, mail: Mail) -> particles.FilterState:
        """w_i *= prod_j p(z_j | x_i, clusters of j); then x_i ~ p(x | z_j, clusters of j) with probability alpha."""
        sensor, readings = particles.team_readings(s.world, z, mail)
        sent = mixtures.unpack(mail.packets)
        logw = mixtures.weigh(sensor, sent, readings, s.x, s.logw)
        s = particles.resample_and_estimate(self, s._replace(logw=logw))
        heard: Mask = np.asarray(detections.usable(sent, readings).any(-1))
        return self._drawn_again(s, sensor, sent, readings, heard) if self.alpha and heard.any() else s

    def estimate(self, s: particles.FilterState) -> Belief:
        return s.belief

    @staticmethod
    def _near(world: World, places: Array) -> Mask:
        """Places (c, 1) that a robot of this world may be at, by a wide margin: what a broken reading draws is not."""
        low, high = world.arena
        near: Mask = np.asarray((np.abs(places - (low + high) / 2) < FAR * np.max(high - low)).all(-1, keepdims=True))
        return near

    def _drawn_again(
        self, s: particles.FilterState, sensor: Sensor, sent: mixtures.Mixture, readings: Array, heard: Mask
    ) -> particles.FilterState:
        """Particles of the rows that `heard`, each drawn from a detection with probability alpha."""
        N, (old, logw) = s.x.shape[1], resample(s.x, s.logw, s.key, s.tick)
        w = weights(logw)
        u = random_numbers.further_uniforms(s.key, s.tick, random_numbers.ANCESTOR, 1)[:, 0, 0]
        resampled = np.take_along_axis(old, systematic(w, u)[..., None], 1)
        heading = resampled[..., 2] if resampled.shape[-1] > 2 else np.zeros(w.shape)
        again = heard[:, None] & (
            random_numbers.further_uniforms(s.key, s.tick, random_numbers.SHARE, N)[..., 0] < self.alpha
        )
        drawn = detections.places(sensor, sent, readings, again, heading, s.key, s.tick)
        x, logw = np.where(again[..., None], resampled, old), np.log(np.where(again, 1 / N, np.maximum(w, TINY)))
        x[again, :2] = np.where(self._near(s.world, drawn), drawn, x[again, :2])
        belief = summary(x, logw) if self.report == "after" else s.belief
        s = s._replace(
            x=np.where(heard[:, None, None], x, s.x),
            logw=np.where(heard[:, None], logw, s.logw),
            due=np.where(heard, poor(weights(logw)), s.due),
            belief=Belief(
                np.where(heard[:, None], belief.x, s.belief.x), np.where(heard[:, None, None], belief.P, s.belief.P)
            ),
        )
        return particles.round_to_single(self, s)

"""Multi-robot synergistic localization (MRSL): each robot weighs its particles by its teammates' broadcast beliefs.

A robot sends the mean and covariance of its belief as it stood before this tick's fusion, so nothing depends on the
order of arrival. A robot that hears it multiplies in the likelihood of the radio reading of that packet, with the
sender's position integrated out. The product treats beliefs as independent, which they no longer are once robots have
heard each other.

Source: E. Latif, R. Parasuraman, "Multi-Robot Synergistic Localization in Dynamic Environments", 2022, eqs.
(6)-(9).
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from cooploc.estimators import particles
from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, World
from cooploc.estimators.particle_likelihood import ReceivedPackets, pack


@dataclass(frozen=True)
class Mrsl(particles.ParticleSettings):
    """Particle filter on own readings, Bayes product with received beliefs.

    Args:
        reading: what is measured of a packet: "rssi" [dBm] or "range" [m].
        neighbours: "integrate" over the sender's position, or "exact", the paper's literal form: the sender is taken to
            be at the mean that it sent.
        neighbour_samples: "one", the newest reading of each teammate, or "M", the product of eq. (5) over its last M
            readings, with the exponent that `temper` sets.

    """

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "mean and covariance"
    consistency: ClassVar[str] = "over-confident: counts shared beliefs again and again"
    reading: Literal["rssi", "range"] = "rssi"
    neighbours: Literal["integrate", "exact"] = "integrate"
    neighbour_samples: Literal["one", "M"] = "one"

    @property
    def uses(self) -> tuple[str, ...]:
        return (*super().uses, f"radio_{self.reading}")

    @property
    def several(self) -> bool:
        """Whether more than the newest reading of a teammate is used."""
        return self.neighbour_samples == "M" and self.M > 1

    def init(self, prior: Belief, world: World, rows: Rows) -> particles.FilterState:
        s = particles.init_single(self, prior, world, rows)
        return s._replace(past=particles.no_past_packets(len(prior.x), world.robots, self.M)) if self.several else s

    def predict(self, s: particles.FilterState, z: Senses) -> particles.FilterState:
        s = particles.predict_single(self, s, z)
        return s._replace(past=particles.shift_past_packets(s.past, s.world.motion, z)) if self.several else s

    def correct(self, s: particles.FilterState, z: Senses) -> particles.FilterState:
        return particles.correct_single(self, s, z)

    def send(self, s: particles.FilterState, z: Senses) -> Array:
        """x, y, and the position covariance's P_xx, P_xy, P_yy: five numbers."""
        return pack(particles.belief_to_send(s))

    def fuse(self, s: particles.FilterState, z: Senses, mail: Mail) -> particles.FilterState:
        """w_i = P_l(q_i) prod_j integral P(r_j | x_i, x_j) N(x_j; received) dx_j  (8), variance sigma^2 + J P_j J'.

        With neighbour_samples="M", P(r_j | x_i, x_j) is a product over the last M packets of sender j.
        """
        sensor, readings = s.world.sensors[f"radio_{self.reading}"], getattr(mail, self.reading)
        heard = ReceivedPackets(sensor, mail.packets, readings, self.neighbours == "integrate")
        if not self.several:
            return particles.resample_and_estimate(self, s, heard)
        past = particles.keep_received(s.past, heard)
        logw = particles.weigh_past_packets(past, heard, s.world.motion, s.x, s.logw, self.power)
        return particles.resample_and_estimate(self, s._replace(past=past, logw=logw))

    def estimate(self, s: particles.FilterState) -> Belief:
        return s.belief

"""Multi-robot synergistic localization (MRSL): each robot weighs its particles by its teammates' broadcast beliefs.

A robot sends the mean and covariance of its belief as it stood before this tick's fusion, so nothing depends on the
order of arrival. Whoever hears it multiplies in the likelihood of the radio reading of that packet, with the sender's
position integrated out. The product treats beliefs as independent, which they are no longer once robots have heard each
other.

Source: E. Latif, R. Parasuraman, "Multi-Robot Synergistic Localization in Dynamic Environments", 2022, eqs.
(6)-(9).
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, World
from cooploc.estimators.particle import own_filter
from cooploc.estimators.particle.likelihood import Heard
from cooploc.estimators.particle.packet import pack


@dataclass(frozen=True)
class Mrsl(own_filter.Settings):
    """Particle filter on own readings, Bayes product with received beliefs."""

    api: ClassVar[int] = 1
    reading: Literal["rssi", "range"] = "rssi"  # what is measured of a packet
    # "exact" is the paper's literal form: the sender is taken to be where it says.
    neighbours: Literal["integrate", "exact"] = "integrate"

    @property
    def uses(self) -> tuple[str, ...]:
        return ("odometry", "anchor_rssi", f"radio_{self.reading}")

    def init(self, prior: Belief, world: World, rows: Rows) -> own_filter.Own:
        return own_filter.init(self, prior, world, rows)

    def predict(self, s: own_filter.Own, z: Senses) -> own_filter.Own:
        return own_filter.predict(self, s, z)

    def correct(self, s: own_filter.Own, z: Senses) -> own_filter.Own:
        return own_filter.correct(self, s, z)

    def send(self, s: own_filter.Own, z: Senses) -> Array:
        """x, y, and the position covariance's P_xx, P_xy, P_yy: five numbers."""
        return pack(own_filter.tell(s))

    def fuse(self, s: own_filter.Own, z: Senses, mail: Mail) -> own_filter.Own:
        """w_i = P_l(q_i) prod_j integral P(r_j | x_i, x_j) N(x_j; received) dx_j  (8), variance sigma^2 + J P_j J'."""
        sensor, readings = s.world.sensors[f"radio_{self.reading}"], getattr(mail, self.reading)
        return own_filter.finish(self, s, Heard(sensor, mail.packets, readings, self.neighbours == "integrate"))

    def estimate(self, s: own_filter.Own) -> Belief:
        return s.belief

"""Multi-robot synergistic localization (MRSL): each robot weighs its particles by its teammates' broadcast beliefs.

A robot sends the mean and covariance of its belief before this tick's fusion. A robot that hears it multiplies in the
likelihood of the radio reading of that packet, with the sender's position integrated out, as if all were independent.

Source: E. Latif, R. Parasuraman, "Multi-Robot Synergistic Localization in Dynamic Environments", 2022, eqs. (6)-(9).
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from cooploc.estimators import particles as shared
from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, World
from cooploc.estimators.particle_likelihood import ReceivedPackets, pack
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable


@dataclass(frozen=True)
@shared.explain
class Mrsl:
    """Particle filter on own readings, Bayes product with received beliefs.

    Args:
        reading: what is measured of a packet: "rssi" [dBm] or "range" [m], which without a radio is that of a sighting.
        neighbours: "integrate" over the sender's position, or "exact", the paper's literal form: the sender is taken to
            be at the mean that it sent.
        neighbour_samples: "one", the newest reading of each teammate, or "M", the product of eq. (5) over its last M
            readings, with the exponent that `temper` sets.
    """

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "mean and covariance"
    consistency: ClassVar[str] = "over-confident: counts shared beliefs again and again"
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
    reading: shared.RadioReading = "rssi"
    neighbours: Literal["integrate", "exact"] = "integrate"
    neighbour_samples: Literal["one", "M"] = "one"
    loss: AssumedLoss = "world"

    correct = shared.correct
    estimate = shared.estimate

    @property
    def uses(self) -> tuple[str, ...]:
        return (*shared.own_channels(self), shared.radio_channel(self))

    @property
    def keeps_packets(self) -> bool:
        """Return whether more than the newest reading of a teammate is used."""
        return self.neighbour_samples == "M" and self.M > 1

    def init(self, prior: Belief, world: World, rows: Rows) -> shared.FilterState:
        s = shared.init(self, prior, shared.take_sightings_for_ranges(world), rows)
        return s._replace(past=shared.no_past_packets(len(prior.x), world.robots, self.M)) if self.keeps_packets else s

    def predict(self, s: shared.FilterState, z: Senses) -> shared.FilterState:
        s = shared.predict(self, s, z)
        return s._replace(past=s.past.shift(s.world.motion, z)) if self.keeps_packets else s

    def send(self, s: shared.FilterState, z: Senses) -> Array:
        """Send x, y, and the position covariance's P_xx, P_xy, P_yy: five numbers."""
        return pack(shared.belief_to_send(s))

    def fuse(self, s: shared.FilterState, z: Senses, mail: Mail) -> shared.FilterState:
        """w_i = P_l(q_i) prod_j integral P(r_j | x_i, x_j) N(x_j; received) dx_j  (8), variance sigma^2 + J P_j J'.

        With neighbour_samples="M", P(r_j | x_i, x_j) is a product over the last M packets of sender j.
        """
        mail = shared.range_of_sightings(z, mail)
        sensor, readings = s.world.sensors[f"radio_{self.reading}"], getattr(mail, self.reading)
        heard = ReceivedPackets(sensor, mail.packets, readings, self.neighbours == "integrate")
        if not self.keeps_packets:
            return shared.resample_and_estimate(self, s, heard)
        past = shared.keep_received(s.past, heard)
        logw = shared.weigh_past_packets(past, heard, s.world.motion, s.x, s.logw, shared.power(self))
        return shared.resample_and_estimate(self, s._replace(past=past, logw=logw))

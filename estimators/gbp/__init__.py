"""Gaussian belief propagation: every robot holds its own part of the team's factor graph, and messages do the rest.

A robot holds its last `window` poses, a chain tied by odometry and by readings of fixed things, and one factor for each
of its readings of teammates. Such a factor also depends on a pose that the teammate holds. What the one knows of that
pose, and what the other's factor says of it, go over the air in every tick as long as the pose is in the window; no
message repeats what its receiver said. A lost packet loses this tick's messages, and the next one brings newer ones.
Where the graph is a tree the beliefs become exact, means and covariances. Where it has loops, and two robots that meet
twice make one, the means converge to the most probable poses of `map-joint`, and covariances become too small: what
came around a loop counts as new. What leaves the window each robot keeps for itself, as one Gaussian. That two robots
have it from each other is forgotten then, and where they meet again it counts twice, as in `ekf_naive.py`.

Within a robot the chain is solved at once, which costs no message, `iterations` times a tick. Between robots messages
go once a tick, as the mail of this world does; in the source any number of times. Whether the source lets poses leave a
window is not said in what we have of it (the abstract and talks): the window, and what it keeps, are our reading.

Sent to each teammate, in numbers of 8 bytes: 5 for the newest position, mean and covariance; and for every reading
between the two in the window 5 from each: who was read says where it was then, who read says what this tells of it.

Sources: R. Murai, J. Ortiz, S. Saeedi, P. Kelly, A. Davison, "A robot web for distributed many-device localisation",
IEEE T-RO 40, 2024, arXiv 2202.03314; A. Davison, J. Ortiz, "FutureMapping 2: Gaussian belief propagation for spatial
AI", arXiv 1910.14139 (Huber's weights); Y. Weiss, W. Freeman, "Correctness of belief propagation in Gaussian graphical
models of arbitrary topology", Neural Computation 13, 2001 (means exact, covariances not).
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from cooploc.estimators.gbp import messages
from cooploc.estimators.gbp.chain import State, relaxed, start
from cooploc.estimators.gbp.messages import Packet
from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, World
from cooploc.estimators.kalman.sliding_window import READINGS, moved, shortened
from cooploc.estimators.models.anchor_readings import RAW, AnchorReading
from cooploc.estimators.models.angles import wrap_heading
from cooploc.estimators.models.gradient_doa import gradient_doa
from cooploc.estimators.plugins.bounds import require


@dataclass(frozen=True)
class Gbp:
    """Gaussian belief propagation over a sliding window of every robot's poses.

    Parameters:
        window: poses that a robot holds [ticks, at least 1].
        iterations: how often a robot linearises and solves its own window after the mail of a tick [count, at least 1].
        anchor_reading: "rssi", each raw reading of an anchor [dBm]; "doa", the direction of arrival [rad] made of four
            corners, with the variance that it has where the robot is; "doa-constant", with one variance everywhere;
            "gradient", the gradient [dB/m] it is taken from; "any", as "rssi", and nothing where there are neither
            anchors nor landmarks; or "none", no reading of anchors, nor of landmarks.
        reading: the radio reading that is used where no camera sees teammates: "range" [m] or "rssi" [dBm].
        huber: errors beyond so many standard deviations (no unit) count less, as in Huber's loss; inf: all count fully.
    """

    api: ClassVar[int] = 1
    window: int = 10
    iterations: int = 1
    anchor_reading: AnchorReading = "rssi"
    reading: Literal["range", "rssi"] = "range"
    huber: float = 3.0

    def __post_init__(self) -> None:
        require(self, window=(1, 1000), iterations=(1, 1000), huber=(0.1, np.inf))

    @property
    def uses(self) -> tuple[str, ...]:
        """The channels, in order of preference."""
        optional = "?" * (self.anchor_reading == "any")
        fixed = () if self.anchor_reading == "none" else ("anchor_rssi|landmark" + optional,)
        return ("odometry", *fixed, f"sighting|radio_{self.reading}")

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        if self.anchor_reading not in (*RAW, "none") and "anchor_rssi" in world.sensors:
            gradient_doa(world)
        return start(prior, world, rows.robot)

    def predict(self, s: State, z: Senses) -> State:
        """A new pose x' = f(x, u) at the end of the window, which nobody has yet said anything about."""
        alone = z._replace(**{name: getattr(z, name)[:, None] for name in READINGS})
        return s.lengthened(moved(s.own, alone))

    def correct(self, s: State, z: Senses) -> State:
        """The window solved with this tick's readings of fixed things, so that what is sent has them."""
        return relaxed(s, 1, self.anchor_reading, self.huber)

    def send(self, s: State, z: Senses) -> Array:
        """One packet (r, n, m) for each teammate: what is known of own positions, and of the teammate's."""
        return messages.outgoing(s, self.huber).pack(self.window)

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        """Newest messages replace older ones; readings of who was heard become factors. The oldest pose may leave."""
        reading = z.sighting if "sighting" in s.world.sensors else getattr(mail, self.reading)[..., None]
        packet = Packet.unpack(mail.packets, s.own.x.shape[1])
        s = messages.received(s, np.where(mail.heard[..., None], reading, np.nan), packet)
        s = relaxed(s, self.iterations, self.anchor_reading, self.huber)
        return s.shortened(shortened(s.own, s.oldest)) if s.own.x.shape[1] == self.window else s

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.newest.x), s.newest.P)

"""What an estimator must have: one that a robot runs, one that holds the whole team, and one with hindsight."""

from typing import ClassVar, Protocol, TypeVar

from cooploc.estimators.interface.tick import Array, Belief, Mail, Rows, Senses, Traffic
from cooploc.estimators.interface.world import World

S = TypeVar("S")


class Estimator(Protocol[S]):
    """What one robot runs.

    `uses` names the channels in order: Senses fields, `radio_rssi`, `radio_range`, or keys of `extra`. "a|b" takes
    the first that the stream has, "a?" is optional. The runner hides everything else, so the declaration is enforced.

    Optional members:
        notes: a method `notes(s)` -> {name: (r,)}, what the estimator counted, shown under the table; values of several
            trials are added, or their maximum is taken where the name begins with "largest".
        axes: a string, why its estimates do not turn with the world, for the check of equivariance.
        own_motion: a string, why it does not move as dead reckoning does where it has odometry alone, for the check of
            silence.
        mutable: True where its state changes in place; the check that inputs stay unchanged then leaves the state out.
    """

    api: ClassVar[int]

    @property
    def uses(self) -> tuple[str, ...]: ...

    def init(self, prior: Belief, world: World, rows: Rows) -> S:
        """The state before tick 0."""
        ...

    def predict(self, s: S, z: Senses) -> S:
        """Move by odometry."""
        ...

    def correct(self, s: S, z: Senses) -> S:
        """Use readings of fixed things: anchors, landmarks."""
        ...

    def send(self, s: S, z: Senses) -> Array:
        """What to transmit: (r, m) for everyone, or (r, n, m) with axis 1 the addressee. All-nan is silence."""
        ...

    def fuse(self, s: S, z: Senses, mail: Mail) -> S:
        """Use what was heard. Called in every tick, also where nothing was heard."""
        ...

    def estimate(self, s: S) -> Belief:
        """The belief that is compared with the truth: x (r, d), P (r, d, d), position first."""
        ...


class TeamEstimator(Protocol[S]):
    """An estimator that holds the whole team: every array is (trial, n, ...). It has neither `send` nor `fuse`.

    `bound` marks one that uses all readings of all robots as well as any estimator could. The optional members are
    those of `Estimator`, and `centralised: bool`, true for one whose readings all reach one computer, and so for every
    bound; such a one is shown beside distributed estimators and not ranked among them.
    """

    api: ClassVar[int]
    bound: ClassVar[bool]

    @property
    def uses(self) -> tuple[str, ...]: ...

    def init(self, prior: Belief, world: World, rows: Rows) -> S: ...

    def predict(self, s: S, z: Senses) -> S: ...

    def correct(self, s: S, z: Senses) -> S: ...

    def exchange(self, s: S, z: Senses, air: Mail) -> tuple[S, Traffic]:
        """Use readings between robots, (trial, n, n) with axis 1 the receiver, and say what was sent.

        `air` has no packets. A centralised one returns zero Traffic: the runner counts what its robots must upload.
        """
        ...

    def estimate(self, s: S) -> Belief: ...


class OfflineEstimator(Protocol):
    """An estimator with hindsight: it is given the readings of all robots and ticks at once, such as a smoother.

    No robot could run it: tables and figures show it as a kind of its own, not ranked and never best. It has `api`,
    `uses`, the optional members of `Estimator`, and nothing but:
    """

    api: ClassVar[int]
    offline: ClassVar[bool]  # True

    @property
    def uses(self) -> tuple[str, ...]: ...

    def smooth(self, prior: Belief, world: World, rows: Rows, z: Senses, air: Mail) -> Belief:
        """Beliefs x (t, T, n, d), P (t, T, n, d, d) of every trial, tick and robot.

        The prior, before tick 0, and rows are (t, n, ...), as of a team; senses (t, T, n, ...); `air` has `heard`,
        `rssi` and `range` (t, T, n, n), axis 2 the receiver, and no packets.
        """
        ...

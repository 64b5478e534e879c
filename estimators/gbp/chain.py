"""What a robot holds: a chain of poses, factors to teammates, and the messages that came; solved by one smoother."""

from typing import NamedTuple, Self

import numpy as np

from cooploc.estimators.gbp.factors import Gaussian, Information, PairFactors, linearised, weighed
from cooploc.estimators.interface import Array, Belief, Indices, World
from cooploc.estimators.kalman.sliding_window import Window, empty, smooth
from cooploc.estimators.models.anchor_readings import AnchorReading, fixed
from cooploc.estimators.models.angles import wrap_heading


class State(NamedTuple):
    """One robot's part of the graph; n teammates, l poses, oldest first. nan where there is no factor or message."""

    own: Window  # poses as a team of one, x (r, l, 1, d)
    P: Array  # (r, l, d, d)  their covariances
    at: Array  # (r, l, d)  where the last solution was linearised
    reading: Array  # (r, l, n, k)  this robot's readings of teammates
    theirs: Gaussian  # (r, l, n, 2)  each teammate's position without the robot's reading: the message to its factor
    seen: Array  # (r, l, n, 2)  each teammate's position with the reading
    seen_at: Array  # (r, l, n, 2)  where the last solution was linearised
    told: Information  # (r, l, n, 2)  of the robot's position, from the factors of teammates
    newest: Belief  # (r, d)
    oldest: Belief  # (r, d)  of the oldest pose from what is before and at it
    robot: Indices  # (r,)
    world: World

    @property
    def x(self) -> Array:
        """The poses (r, l, d)."""
        return self.own.x[:, :, 0]

    def factors(self, huber: float) -> PairFactors:
        """The robot's readings of teammates, as they stand in the last solution."""
        channel = next(c for c in ("sighting", "radio_range", "radio_rssi") if c in self.world.sensors)
        return linearised(self.world.sensors[channel], self.at, self.seen_at, self.reading, huber)

    def lengthened(self, own: Window) -> Self:
        """With a new pose, of which no teammate has said anything."""
        r, n = len(self.robot), self.world.robots
        k = 2 if "sighting" in self.world.sensors else 1

        def longer(past: Array, *shape: int) -> Array:
            return np.concatenate([past, np.full((r, 1, n, *shape), np.nan)], 1)

        return self._replace(
            own=own,
            reading=longer(self.reading, k),
            theirs=Gaussian(longer(self.theirs.x, 2), longer(self.theirs.P, 2, 2)),
            seen=longer(self.seen, 2),
            told=Information(longer(self.told.eta, 2), longer(self.told.Lambda, 2, 2)),
        )

    def shortened(self, own: Window) -> Self:
        """Without the oldest pose, and what was said of it."""
        cut = {name: getattr(self, name)[:, 1:] for name in ("P", "at", "reading", "seen", "seen_at")}
        theirs, told = Gaussian(*(a[:, 1:] for a in self.theirs)), Information(*(a[:, 1:] for a in self.told))
        return self._replace(own=own, theirs=theirs, told=told, **cut)


def start(prior: Belief, world: World, robot: Indices) -> State:
    """Before the first tick: no poses."""
    r, n, d = len(robot), world.robots, prior.x.shape[-1]
    k = 2 if "sighting" in world.sensors else 1
    vectors, matrices = np.empty((r, 0, n, 2)), np.empty((r, 0, n, 2, 2))
    none = Gaussian(vectors, matrices), Information(vectors, matrices)
    own = empty(Belief(prior.x[:, None], prior.P[:, None]), world)
    P, at, reading = np.empty((r, 0, d, d)), np.empty((r, 0, d)), np.empty((r, 0, n, k))
    return State(own, P, at, reading, none[0], vectors, vectors, none[1], prior, prior, robot, world)


def relaxed(s: State, iterations: int, anchor_reading: AnchorReading, huber: float) -> State:
    """The chain solved so many times, linearised at what the last solution found: Gauss-Newton with messages as data.

    A teammate's position follows the solution: x_j = m + C H_j' S^-1 (v - H dx), S = R + H_j C H_j'.
    """
    for _ in range(iterations):
        s = s._replace(at=s.x, seen_at=s.seen)
        pairs = s.factors(huber)
        eta, Lambda = _fixed(s, anchor_reading, huber)
        for message in (pairs.onto_self(s.theirs), s.told.about(s.at)):
            eta, Lambda = eta + message.eta.sum(2), Lambda + message.Lambda.sum(2)
        solution = smooth(s.own, eta, Lambda)
        dx = wrap_heading(solution.x[:, :, 0] - s.at)
        newest, oldest = solution.filtered[-1], solution.filtered[0]
        own = s.own._replace(x=solution.x, P=newest.P)
        s = s._replace(own=own, P=solution.P, seen=pairs.follow(s.theirs, dx), newest=newest, oldest=oldest)
    return s


def _fixed(s: State, anchor_reading: AnchorReading, huber: float) -> tuple[Array, Array]:
    """eta (r, l, d) and Lambda (r, l, d, d) of readings of anchors and landmarks, relative to `at`."""
    eta, Lambda = np.zeros(s.at.shape), np.zeros((*s.at.shape, s.at.shape[-1]))
    for sensor, place, reading in fixed(s.world, s.own.z, anchor_reading):
        y, H, _ = sensor.innovation(s.at, place, reading[:, :, 0])
        y, R, (H,) = weighed(y, sensor.R, huber, H)
        W = H.mT @ np.linalg.inv(R)
        eta += (W @ y[..., None])[..., 0]
        Lambda += W @ H
    return eta, Lambda

"""Covariance intersection that speaks only when there is news: bytes against accuracy by one threshold.

A robot broadcasts when its belief N(x, P) is far from N(x_s, P_s): what it last sent, moved by its own odometry as if
that had no error. How far is the Kullback-Leibler divergence

    D = 1/2 (tr(P_s^-1 P) + (x - x_s)' P_s^-1 (x - x_s) - d + ln det P_s / det P)   [nat],

A teammate that hears nothing does nothing. Everything else is `ekf_ci.py`; with threshold = 0 the two are equal.

Source: G. Battistelli, L. Chisci, L. Gao, D. Selvi, "Event-triggered distributed Bayes filter", ECC 2019
(arXiv 1902.09825): the trigger. P_s without the odometry's error is our choice: with it, robots fall silent for good.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from cooploc.estimators import broadcasts, kalman
from cooploc.estimators.ekf_ci import EkfCi
from cooploc.estimators.errors import Limits
from cooploc.estimators.interface import Array, Belief, Mail, Mask, Rows, Senses, World
from cooploc.estimators.models import AnchorReading, wrap_heading
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable


class State(NamedTuple):
    """The memory of one robot."""

    own: broadcasts.BroadcastState
    sent: Belief  # x (r, d), P (r, d, d) of the last packet, moved on; nan before the first


@dataclass(frozen=True)
@kalman.explain
class EkfEventCi:
    """EKF on own readings, covariance intersection on received beliefs, sent only when they have changed enough.

    Parameters:
        threshold: the least divergence [nat] from what was sent at which a robot sends again; 0 sends in every tick.
    """

    api: ClassVar[int] = 1
    limits: ClassVar[Limits] = {"threshold": (0, np.inf)}
    sends: ClassVar[str] = "as `ekf-ci`, when the belief has changed"
    consistency: ClassVar[str] = "conservative by construction"
    anchor_reading: AnchorReading = "doa"
    gate: float = tunable(kalman.GATE, 2.0, 1000.0, log=True)
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    engine: kalman.EngineName = "batched"
    reading: kalman.RadioReading = "range"
    threshold: float = 0.1
    loss: AssumedLoss = "world"

    uses = property(kalman.team_channels)

    @property
    def ci(self) -> EkfCi:
        """The filter whose packets are held back."""
        return EkfCi(self.anchor_reading, self.gate, self.inflation, self.engine, self.reading, loss=self.loss)

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        nothing = Belief(np.full_like(prior.x, np.nan), np.full_like(prior.P, np.nan))
        return State(self.ci.init(prior, world, rows), nothing)

    def predict(self, s: State, z: Senses) -> State:
        """The filter's; and x_s' = f(x_s, u),  P_s' = F P_s F'."""
        x, F, _ = kalman.move(s.own.world.motion, s.sent.x, z)
        return State(self.ci.predict(s.own, z), Belief(x, kalman.symmetric(F @ s.sent.P @ F.mT)))

    def correct(self, s: State, z: Senses) -> State:
        return s._replace(own=self.ci.correct(s.own, z))

    def send(self, s: State, z: Senses) -> Array:
        return np.where(self._news(s, z)[:, None], self.ci.send(s.own, z), np.nan)

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        """Fuse as `ekf-ci` does, and remember what was sent in this tick."""
        news = self._news(s, z)
        x, P = np.where(news[:, None], s.own.x, s.sent.x), np.where(news[:, None, None], s.own.P, s.sent.P)
        return State(self.ci.fuse(s.own, z, mail), Belief(x, P))

    def estimate(self, s: State) -> Belief:
        return self.ci.estimate(s.own)

    def _news(self, s: State, z: Senses) -> Mask:
        """Return which rows send: those that never did, and those as far from what they sent as the threshold.

        A robot that is asleep, with dt = 0, sends nothing.
        """
        return np.asarray((z.dt > 0) & ~(divergence(Belief(s.own.x, s.own.P), s.sent) < self.threshold))


def divergence(p: Belief, q: Belief) -> Array:
    """Return D(p || q) [nat] of Gaussians, (r,); nan where q is."""
    known = np.asarray(~np.isnan(q.x).any(-1))
    P_q = np.where(known[:, None, None], q.P, p.P)
    e = wrap_heading(p.x - q.x)
    ratio, far = np.linalg.solve(P_q, p.P), np.linalg.solve(P_q, e[..., None])
    logs = np.linalg.slogdet(P_q)[1] - np.linalg.slogdet(p.P)[1]
    D = (np.trace(ratio, axis1=1, axis2=2) + (e[:, None] @ far)[:, 0, 0] - p.x.shape[-1] + logs) / 2
    return np.asarray(np.maximum(D, 0.0))

"""Honest estimators with unusual habits: what a check must not accuse.

Each does something that a careful author might: it keeps its estimate inside the arena, samples its covariance, turns
to a channel late, sends only when something happened.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from counting import Counting, Counts

from cooploc.estimators.ekf_local import EkfLocal
from cooploc.estimators.ekf_naive import EkfNaive
from cooploc.estimators.interface import Array, Belief
from cooploc.estimators.mrsl import Mrsl

LATE = 40  # ticks before a channel is used


@dataclass(frozen=True)
class StaysInTheArena(EkfLocal):
    """Clips its estimate to the arena, whose limits it knows."""

    def estimate(self, s):
        x, P = super().estimate(s)
        x = x.copy()
        x[:, :2] = np.clip(x[:, :2], *s.world.arena)
        return Belief(x, P)


class SamplesItsCovariance(Counts):
    """Reports the covariance of a few hundred samples, which shrinks by chance from one tick to the next."""

    def estimate(self, s):
        normal = np.stack(
            [np.random.default_rng([*map(int, k), s.tick]).normal(size=(400, s.x.shape[-1])) for k in s.key]
        )
        drawn = normal @ np.linalg.cholesky(s.P).mT
        x, _ = super().estimate(s)
        centred = drawn - drawn.mean(1, keepdims=True)
        P = centred.mT @ centred / 399
        return Belief(x, (P + P.mT) / 2)


@dataclass(frozen=True)
class LateToTheAnchors(EkfLocal):
    """Uses anchors and landmarks from its fortieth tick on."""

    def init(self, prior, world, rows):
        s = super().init(prior, world, rows)
        return Counting(s.x, s.P, world, rows.trial, rows.key, 0)

    def correct(self, s, z):
        s = s._replace(tick=s.tick + 1)
        return super().correct(s, z) if s.tick > LATE else s


@dataclass(frozen=True)
class SendsOnEvents(EkfNaive):
    """Sends only where it is surer by a tenth than when it last spoke."""

    def init(self, prior, world, rows):
        s = super().init(prior, world, rows)
        return EventState(
            s.x, s.P, s.robot, s.world, np.trace(prior.P[:, :2, :2], axis1=1, axis2=2), np.zeros(len(s.x), bool)
        )

    def correct(self, s, z):
        s = super().correct(s, z)
        now = np.trace(s.P[:, :2, :2], axis1=1, axis2=2)
        speaks = now < 0.9 * s.spoke
        return s._replace(speaks=speaks, spoke=np.where(speaks, now, s.spoke))

    def send(self, s, z):
        return np.where(s.speaks[:, None], super().send(s, z), np.nan)


class EventState(NamedTuple):
    x: Array
    P: Array
    robot: Array
    world: object
    spoke: Array
    speaks: Array


@dataclass(frozen=True)
class SendsEveryThirdTick(EkfNaive):
    """Saves two of three messages."""

    def init(self, prior, world, rows):
        s = super().init(prior, world, rows)
        return ThirdState(s.x, s.P, s.robot, s.world, 0)

    def send(self, s, z):
        sent = super().send(s, z)
        return sent if s.tick % 3 == 0 else np.full_like(sent, np.nan)

    def fuse(self, s, z, mail):
        return super().fuse(s, z, mail)._replace(tick=s.tick + 1)


class ThirdState(NamedTuple):
    x: Array
    P: Array
    robot: Array
    world: object
    tick: int


@dataclass(frozen=True)
class SendsHalfPrecision(EkfNaive):
    """Rounds what it sends to two bytes a number, positions as seen from the arena's corner."""

    axes: ClassVar[str] = "its numbers of two bytes are the coarser the further from a corner"

    def send(self, s, z):
        sent = super().send(s, z)
        sent[:, :2] -= s.world.arena[0]
        return sent.astype(np.float16)

    def fuse(self, s, z, mail):
        packets = mail.packets.astype(float)
        packets[..., :2] += s.world.arena[0]
        return super().fuse(s, z, mail._replace(packets=packets))


@dataclass(frozen=True)
class InflatesWhenSurprised(EkfLocal):
    """Widens its covariance where the last step was long."""

    def predict(self, s, z):
        before, s = s.x, super().predict(s, z)
        long = np.linalg.norm(s.x[:, :2] - before[:, :2], axis=-1) > 0.12
        return s._replace(P=np.where(long[:, None, None], 1.05 * s.P, s.P))


@dataclass(frozen=True)
class RoundsToMillimetres(EkfLocal):
    """Reports positions in whole millimetres."""

    def estimate(self, s):
        x, P = super().estimate(s)
        return Belief(np.concatenate([np.round(x[:, :2], 3), x[:, 2:]], -1), P)


@dataclass(frozen=True)
class FewParticles(Mrsl):
    """A particle filter with thirty particles: noisy, and entitled to be."""

    particles: int = 30


@dataclass(frozen=True)
class NeverBelowAFloor(EkfLocal):
    """Keeps every variance of the position above a square centimetre, as real systems do."""

    def correct(self, s, z):
        s = super().correct(s, z)
        P = s.P.copy()
        P[:, :2, :2] += 1e-4 * np.eye(2) * (np.linalg.eigvalsh(P[:, :2, :2])[:, :1, None] < 1e-4)
        return s._replace(P=P)


HONEST = (
    StaysInTheArena, SamplesItsCovariance, LateToTheAnchors, SendsOnEvents, SendsEveryThirdTick, SendsHalfPrecision,
    InflatesWhenSurprised, RoundsToMillimetres, FewParticles, NeverBelowAFloor,
)  # fmt: skip

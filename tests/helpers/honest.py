"""Honest estimators with unusual habits, which no check may accuse."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.adapters import PerRobot, motion_of
from cooploc.estimators.ekf_local import EkfLocal
from cooploc.estimators.ekf_naive import EkfNaive
from cooploc.estimators.interface import Array, Belief
from cooploc.estimators.mrsl import Mrsl

LATE = 40  # ticks before a channel is used


class Counting(NamedTuple):
    x: Array
    P: Array
    robot: Array
    world: Any
    key: Array
    tick: int


def begin(self, prior, world, rows):
    return Counting(prior.x, prior.P, rows.robot, world, rows.key, 0)


class SamplesItsCovariance(EkfLocal):
    """Reports the covariance of a few hundred samples, which shrinks by chance from one tick to the next."""

    init = begin

    def predict(self, s, z):
        return super().predict(s._replace(tick=s.tick + 1), z)

    def estimate(self, s):
        generators = [np.random.default_rng([*map(int, k), s.tick]) for k in s.key]
        drawn = np.stack([one.normal(size=(400, s.x.shape[-1])) for one in generators]) @ np.linalg.cholesky(s.P).mT
        centred = drawn - drawn.mean(1, keepdims=True)
        P = centred.mT @ centred / 399
        return Belief(s.x, (P + P.mT) / 2)


class LateToTheAnchors(EkfLocal):
    """Uses anchors and landmarks from its fortieth tick on."""

    init = begin

    def correct(self, s, z):
        s = s._replace(tick=s.tick + 1)
        return super().correct(s, z) if s.tick > LATE else s


class SendsEveryThirdTick(EkfNaive):
    """Saves two of three messages."""

    init = begin

    def send(self, s, z):
        sent = super().send(s, z)
        return sent if s.tick % 3 == 0 else np.full_like(sent, np.nan)

    def fuse(self, s, z, mail):
        return super().fuse(s, z, mail)._replace(tick=s.tick + 1)


@dataclass(frozen=True)
class FewParticles(Mrsl):
    """A particle filter with thirty particles: noisy, and entitled to be."""

    particles: int = 30


class Resampled:
    """A particle filter as one writes it first: it draws all particles again in every tick, whatever was read."""

    uses = ("odometry",)

    def __init__(self, prior, world, robot, key):
        self.world, self.rng = world, np.random.default_rng(key)
        self.points = self.rng.multivariate_normal(prior.x, prior.P, 100)

    def predict(self, z):
        moved = motion_of(self.world, z).sample(self.points, self.rng.normal(size=(100, 2)))
        self.points = moved[self.rng.integers(100, size=100)]

    def correct(self, z):
        pass

    def estimate(self):
        return self.points.mean(0), np.cov(self.points.T)


class ResamplesAlways(PerRobot):
    """`Resampled`, for each robot."""

    def __init__(self):
        super().__init__(Resampled)


HONEST = SamplesItsCovariance, LateToTheAnchors, SendsEveryThirdTick, FewParticles, ResamplesAlways

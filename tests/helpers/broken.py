"""A gallery of estimators that break one rule each: correct ones with a single fault, and a few without any."""

import inspect
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from honest import Resampled

from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.estimators.ekf_joint import EkfJoint
from cooploc.estimators.ekf_local import EkfLocal
from cooploc.estimators.interface import Belief, Traffic
from cooploc.estimators.mrsl import Mrsl

MEMORY: dict[Any, Any] = {}


def nudge(s, by):
    """The state with every position moved."""
    x = s.x.copy()
    x[..., :2] += by
    return s._replace(x=x)


def caller_attribute(name):
    """An attribute of an object among the callers, such as the runner's stream."""
    frame = inspect.currentframe()
    while frame := frame.f_back:
        found = frame.f_locals.get("self")
        if hasattr(found, name):
            return getattr(found, name)
    raise LookupError(name)


def change(name, method, how):
    """A class of dead reckoning, with one method changed: `how` takes its arguments and what it returned."""

    def changed(self, *arguments):
        return how(*arguments, getattr(super(cls, self), method)(*arguments))

    cls = type(name, (DeadReckoning,), {method: changed, "__module__": __name__})
    return cls


def add(name, method, by):
    """A class of dead reckoning that adds `by(s, z)` to every position, after one method."""
    return change(name, method, lambda s, z, found: nudge(found, by(s, z)))


def team_sums(s, n=3):
    """For each row the sum of the positions of its whole team, which a robot cannot know."""
    return np.repeat(s.x[:, :2].reshape(-1, n, 2).sum(1), n, axis=0)


def last_odometry(stream):
    return stream.senses.odometry[:, -1, :, :2].reshape(-1, 2)


def write(array, by):
    array[:] += by


ReadsNeighbour = add("ReadsNeighbour", "correct", lambda s, z: 1e-3 * np.roll(s.x[:, :2], 1, axis=0))
GlobalRng = add("GlobalRng", "correct", lambda s, z: np.random.normal(size=s.x[:, :2].shape))  # noqa: NPY002
TrustsOdometry = add("TrustsOdometry", "predict", lambda s, z: 1e-6 * z.odometry[:, :2])
Prophet = add("Prophet", "predict", lambda s, z: 1e-3 * last_odometry(caller_attribute("stream")))
KnowsLength = add("KnowsLength", "predict", lambda s, z: 1e-3 * len(caller_attribute("stream").time))
KnowsTheLabel = add("KnowsTheLabel", "predict", lambda s, z: caller_attribute("stream").scenario != "another label")
SendsOthers = change("SendsOthers", "send", lambda s, z, sent: team_sums(s))
InPlace = change("InPlace", "correct", lambda s, z, found: write(s.x, 1e-3) or found)
WritesReadings = change("WritesReadings", "predict", lambda s, z, found: write(z.odometry, 1e-3) or found)
ShrinksCovariance = change("ShrinksCovariance", "correct", lambda s, z, found: found._replace(P=0.9 * s.P))
# Shifting the world does not show the next one; the one after it takes randomness of a row's position.
PrefersNorth = change("PrefersNorth", "init", lambda *a: nudge(a[-1], [0.0, 1.0]))
DrawsByPosition = change(
    "DrawsByPosition", "init", lambda *a: nudge(a[-1], np.random.default_rng(0).normal(size=(len(a[-1].x), 2)))
)


class ForeseesAbsence(EkfLocal):
    """Knows how many readings will be missing, but not what the others will say."""

    def predict(self, s, z):
        z_all = caller_attribute("stream").senses
        return nudge(super().predict(s, z), 1e-3 * (np.isnan(z_all.anchor_rssi).sum() + np.isnan(z_all.landmark).sum()))


class NotFinite(DeadReckoning):
    def estimate(self, s):
        return Belief(np.where(s.x > 3.0, s.x, np.nan), s.P)


class LooksForRanges(DeadReckoning):
    uses: tuple[str, ...] = ("odometry", "radio_range|sighting")

    def fuse(self, s, z, mail):
        return s._replace(x=s.x + mail.radio_range)


class SendsNone(DeadReckoning):
    def send(self, s, z):
        return None


class OldInterface(DeadReckoning):
    api: ClassVar[int] = 0


@dataclass(frozen=True)
class UnknownChannel(DeadReckoning):
    uses: tuple[str, ...] = ("odometry", "telepathy")


@dataclass(frozen=True)
class Misspells(DeadReckoning):
    uses: tuple[str, ...] = ("odometry", "anchor_rsi")


class Undecorated(DeadReckoning):
    gain: float = field(default=1.0)


ReturnsPositions = change("ReturnsPositions", "estimate", lambda s, found: found.x)


class Crashes(DeadReckoning):
    def correct(self, s, z):
        return s if z.dt[0] < 0 else s / 0


class IgnoresAbsence(EkfLocal):
    """Assumes that every reading is present."""

    def correct(self, s, z):
        return nudge(s, 1e-6 * z.anchor_rssi.sum(-1, keepdims=True)) if z.anchor_rssi.size else s


@dataclass(frozen=True)
class WaitsForAll(EkfLocal):
    """One robot's missing reading keeps all robots from correcting: perturbed readings do not show it."""

    uses: tuple[str, ...] = ("odometry", "anchor_rssi")

    def correct(self, s, z):
        return s if np.isnan(z.anchor_rssi).any() else super().correct(s, z)


class SendsLittleReadsMore(DeadReckoning):
    """Sends one number, and where that arrives reads its sender's row of the same array."""

    def send(self, s, z):
        return np.zeros((len(s.x), 1))

    def fuse(self, s, z, mail):
        n = s.world.robots
        team = s.x[:, :2].reshape(-1, n, 2)
        heard = mail.heard.reshape(-1, n, n)
        return nudge(s, 1e-3 * (heard[..., None] * team[:, None]).sum(2).reshape(-1, 2))


class Broadcasts(DeadReckoning):
    """Correct, and sends its position."""

    def send(self, s, z):
        return s.x[:, :2]


class UsesDroppedPackets(Broadcasts):
    """A robot that receives any packet in a tick uses every position, received or not."""

    def fuse(self, s, z, mail):
        return nudge(s, 1e-3 * mail.heard.any(-1, keepdims=True) * team_sums(s))


class MultipliesRows(Mrsl):
    """A matrix product over the rows, whose last bit depends on how many there are."""

    def estimate(self, s):
        x, P = super().estimate(s)
        n = s.x.shape[1]
        return Belief(x + (s.x[..., 0] @ np.cos(np.arange(n * n)).reshape(n, n))[:, :2], P)


@dataclass(frozen=True)
class CountsCalls(DeadReckoning):
    """Keeps a list among its parameters."""

    calls: list[int] = field(default_factory=list)

    def correct(self, s, z):
        self.calls.append(1)
        return s


class ContinuesLastRun(DeadReckoning):
    """Starts a second run where the first ended."""

    def init(self, prior, world, rows):
        s = super().init(prior, world, rows)
        return nudge(s, 1e-3 * MEMORY.get(type(self), 0.0))

    def estimate(self, s):
        MEMORY[type(self)] = s.x[:, :1].sum()
        return super().estimate(s)


@dataclass(frozen=True)
class NotPicklable(DeadReckoning):
    scale: Any = None


@dataclass(frozen=True)
class ForgetsParameter(DeadReckoning):
    """Comes back from pickle, but not as it was."""

    drift: float = 0.0

    def predict(self, s, z):
        return nudge(super().predict(s, z), self.drift)

    def __reduce__(self):
        return type(self), ()


class Averages(Broadcasts):
    """Moves towards every teammate that it hears."""

    def fuse(self, s, z, mail):
        offset = mail.packets - s.x[:, None, :2]
        return nudge(s, 1e-2 * np.where(mail.heard[..., None], offset, 0.0).sum(1))


class Addressed(Averages):
    """The same with a packet to each teammate."""

    def send(self, s, z):
        return np.repeat(s.x[:, None, :2], s.world.robots, axis=1)


@dataclass(frozen=True)
class HonestTeam(EkfJoint):
    """Not centralised: robots are independent but for a sequential exchange over links that hold in both directions."""

    centralised: ClassVar[bool] = False
    uses: tuple[str, ...] = ("odometry", "anchor_rssi|landmark")

    def exchange(self, s, z, air):
        x = s.x.copy()
        messages = np.zeros(s.x.shape[:2])
        for i in range(x.shape[1]):
            for j in range(i):
                both = air.heard[:, i, j] & air.heard[:, j, i]
                step = np.where(both[:, None], 1e-2 * (x[:, j, :2] - x[:, i, :2]), 0.0)
                x[:, i, :2] += step
                x[:, j, :2] -= step
                messages[:, i] += 1
                messages[:, j] += air.heard[:, j, i]
        return s._replace(x=x), Traffic(messages, 8 * messages)


class Asymmetric(DeadReckoning):
    def estimate(self, s):
        x, P = super().estimate(s)
        P = P.copy()
        P[:, 0, 1] += 0.01
        return Belief(x, P)


class NegativeVariance(DeadReckoning):
    """Subtracts a covariance that was never added."""

    def estimate(self, s):
        x, P = super().estimate(s)
        return Belief(x, P - 10 * np.eye(x.shape[-1]))


class IgnoresOdometry(DeadReckoning):
    """Reads odometry and does not move."""

    def predict(self, s, z):
        return super().predict(s, z)._replace(x=s.x + 1e-9 * np.nan_to_num(z.odometry[:, :1]))


class StaysAtRandom(Resampled):
    """Reads odometry and does not move, but for what drawing particles again does."""

    def predict(self, z):
        still = self.points.copy()
        super().predict(z)
        self.points = still[self.rng.integers(100, size=100)] + 1e-9 * (self.points - still)


@dataclass(frozen=True)
class DeclaresTooMuch(DeadReckoning):
    uses: tuple[str, ...] = ("odometry", "anchor_rssi?", "landmark?")


class MessagesWithoutBytes(HonestTeam):
    """Sends messages without bytes."""

    def exchange(self, s, z, air):
        s, traffic = super().exchange(s, z, air)
        return s, traffic._replace(bytes=0 * traffic.bytes)

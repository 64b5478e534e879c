"""What robots send each other: of own positions to the teammate's factors, and from own factors to its positions."""

from collections.abc import Iterator
from typing import NamedTuple, Self

import numpy as np

from cooploc.estimators.gbp.chain import State
from cooploc.estimators.gbp.factors import Gaussian, Information
from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.models.angles import wrap_heading

NUMBERS = 5  # of a position's mean and covariance, or of its information


class Packet(NamedTuple):
    """Messages of one robot to each teammate, or to one robot from each; nan where there is none."""

    mine: Gaussian  # (r, l, n, 2)  the sender's positions, without what the receiver's factors say of them
    yours: Information  # (r, l, n, 2)  of the receiver's positions, from the sender's factors

    def pack(self, window: int) -> Array:
        """(r, n, 10 window) numbers; nan before the first tick."""
        numbers = np.concatenate([_listed(*self.mine), _listed(*self.yours)], -1)  # (r, l, n, 10)
        r, length, n, m = numbers.shape
        before = np.full((r, window - length, n, m), np.nan)
        return np.concatenate([before, numbers], 1).swapaxes(1, 2).reshape(r, n, -1)

    @classmethod
    def unpack(cls, packets: Array, length: int) -> Self:
        """The messages about the last `length` ticks in packets (r, n, m)."""
        numbers = packets.reshape(*packets.shape[:2], -1, 2 * NUMBERS)[:, :, -length:].swapaxes(1, 2)
        mine, yours = np.split(numbers, 2, -1)
        return cls(Gaussian(*_parts(mine)), Information(*_parts(yours)))


def outgoing(s: State, huber: float) -> Packet:
    """What to send to each teammate.

    Of an own position: the belief without the information that came from the teammate's factor; of the newest to all,
    of older ones to those that are known to have read it. Of a teammate's position: what the own factor says of it,
    given the own pose without that factor.
    """
    x, P = s.x, s.P
    n, newest = s.world.robots, np.arange(x.shape[1]) == x.shape[1] - 1
    told = Information(*(np.nan_to_num(a) for a in s.told))
    position = Gaussian(*(np.repeat(a[:, :, None], n, 2) for a in (x[..., :2], P[..., :2, :2])))
    mine = told.taken_from(position)
    asked = ~np.isnan(s.told.eta[..., 0]) | newest[:, None]
    factors = s.factors(huber)
    message = factors.onto_self(s.theirs)
    off = Gaussian(np.repeat(wrap_heading(x - s.at)[:, :, None], n, 2), np.repeat(P[:, :, None], n, 2))
    yours = factors.onto_teammate(message.taken_from(off))
    made = factors.H_j.any((-2, -1))
    other = np.arange(n) != s.robot[:, None, None]
    return Packet(Gaussian(*_where(np.asarray(asked & other), *mine)), Information(*_where(made & other, *yours)))


def received(s: State, reading: Array, packet: Packet) -> State:
    """Messages that came replace those before them; a reading (r, n, k) of who was heard becomes a factor."""
    readings = s.reading.copy()
    readings[:, -1] = np.where(np.isnan(packet.mine.x[:, -1, :, :1]), np.nan, reading)
    wanted = np.asarray(~np.isnan(readings).any(-1))
    theirs = Gaussian(*_newer(s.theirs, _where(wanted, *packet.mine)))
    told = Information(*_newer(s.told, packet.yours))
    seen = np.where(np.isnan(s.seen), theirs.x, s.seen)
    return s._replace(reading=readings, theirs=theirs, told=told, seen=seen)


def _newer(old: tuple[Array, Array], new: tuple[Array, Array]) -> Iterator[Array]:
    return (np.where(np.isnan(b), a, b) for a, b in zip(old, new, strict=True))


def _where(use: Mask, vector: Array, matrix: Array) -> tuple[Array, Array]:
    return np.where(use[..., None], vector, np.nan), np.where(use[..., None, None], matrix, np.nan)


def _listed(vector: Array, matrix: Array) -> Array:
    return np.concatenate([vector, matrix[..., [0, 0, 1], [0, 1, 1]]], -1)


def _parts(numbers: Array) -> tuple[Array, Array]:
    a, b, c = np.moveaxis(numbers[..., 2:], -1, 0)
    return numbers[..., :2], np.stack([np.stack([a, b], -1), np.stack([b, c], -1)], -2)

"""CTRN's parameters, what a robot remembers, and the readings that it fuses."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Belief, Indices, Mail, Senses, Sensor
from cooploc.estimators.particle import own_filter
from cooploc.estimators.particle.packet import unpack
from cooploc.estimators.plugins.bounds import require
from cooploc.estimators.plugins.tunable import tunable


@dataclass(frozen=True)
class Settings(own_filter.Settings):
    """Parameters of CTRN: those of a robot's own filter, and those of the fusion."""

    reading: Literal["rssi", "range"] = "range"
    fusion: Literal["moments", "message", "received"] = "moments"
    weights: Literal["cvxpy", "exact"] = "cvxpy"
    criterion: Literal["trace", "det"] = tunable("trace", choices=("trace", "det"))
    audit: float = 1e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, audit=(0, 1))


class Counts(NamedTuple):
    """The fusions of each robot, counted (r,)."""

    fusions: Array
    fallbacks: Array  # cvxpy failed and the exact weight was used


class Sample(NamedTuple):
    """Fusions that were recorded, to be solved again by another method."""

    row: Indices  # (k,)
    w: Array  # (k,)
    P: Array  # (k, d, d)  own
    P_j: Array  # (k, 2, 2)  the sender's
    H: Array  # (k, 1, d)
    H_j: Array  # (k, 1, 2)
    R: Array  # (k, 1, 1)

    def take(self, which: Any) -> "Sample":
        """Some of them."""
        return Sample(*(each[which] for each in self))

    def joined(self, more: "Sample") -> "Sample":
        """These, then more."""
        return Sample(*(np.concatenate(both) for both in zip(self, more, strict=True))) if len(more.row) else self


def empty_sample(k: int, d: int) -> Sample:
    """Arrays for k fusions of a state of width d."""
    shapes = (d, d), (2, 2), (1, d), (1, 2), (1, 1)
    return Sample(np.zeros(k, np.int64), np.zeros(k), *(np.zeros((k, *shape)) for shape in shapes))


class State(NamedTuple):
    """What one robot remembers."""

    own: own_filter.FilterState
    solver_group: (
        Indices  # (r,)  rows are solved separately, so that no result depends on another robot in its last bits
    )
    received: Belief  # x (r, n, 2), P (r, n, 2, 2)  own position by each sender's packets alone, nan before the first
    belief: Belief
    counts: Counts
    sample: Sample  # exact fusions that cvxpy solves again for the notes


class Reading(NamedTuple):
    """A reading of one sender, and the belief that the sender transmitted."""

    sensor: Sensor
    sender: int
    z: Array  # (r, 1)  nan where nothing was heard
    x_j: Array  # (r, 2)  the sender's position
    P_j: Array  # (r, 2, 2)  its covariance


def readings(s: State, z: Senses, mail: Mail) -> Iterator[Reading]:
    """The readings of all senders, one after the other."""
    for sensor, sender, reading in s.own.world.relative(z, mail):
        yield Reading(sensor, sender, reading, *unpack(mail.packets[:, sender]))

"""Dead reckoning that knows its tick, its trials and its key: what estimators of tests are made of, honest itself."""

import inspect
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from broken import nudge

from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.estimators.interface import Array
from cooploc.scenarios.stream import Stream

LATE = 30  # ticks: longer than the small streams
# What cheats leave for each other is of this process and of those that it starts: other tests may run beside it.
FILE = Path(tempfile.gettempdir()) / os.environ.setdefault("COOPLOC_CHEATS", f"cooploc-cheats-{os.getpid()}-left")


class Counting(NamedTuple):
    x: Array
    P: Array
    world: object
    trial: Array
    key: Array
    tick: int


@dataclass(frozen=True)
class Counts(DeadReckoning):
    """Adds to every position what `extra` says: nothing."""

    def init(self, prior, world, rows):
        return Counting(prior.x, prior.P, world, rows.trial, rows.key, 0)

    def predict(self, s, z):
        moved = super().predict(s._replace(tick=s.tick + 1), z)
        return nudge(moved, 1e-3 * self.extra(moved, z))

    def extra(self, s, z):
        return 0.0


def others(s):
    """For each row the position in the next row of the array."""
    return np.roll(s.x[:, :2], 1, axis=0)


def found_stream():
    """The largest stream among the callers."""
    frame, found = inspect.currentframe(), []
    while frame := frame.f_back:
        for value in frame.f_locals.values():
            value = getattr(value, "stream", value)
            found += [value] if isinstance(value, Stream) else []
    return max(found, key=lambda one: sum(a.size for a in one.arrays().values()))


def callers():
    """Files and names of the functions that called."""
    frame, found = inspect.currentframe(), []
    while frame := frame.f_back:
        found.append(f"{frame.f_code.co_filename}:{frame.f_code.co_name}")
    return found

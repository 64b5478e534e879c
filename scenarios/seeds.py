"""The seeds of all random numbers: SeedSequence(seed, spawn_key=(trial, purpose)), so streams never overlap.

Estimators draw from keys of their own, a cryptographic hash of the same numbers: a key does not lead back to the seed
that made the truth, unless that seed is guessed.
"""

import hashlib
from enum import IntEnum
from functools import lru_cache

import numpy as np

from cooploc.estimators.interface import Indices, Keys, Rows


class Purpose(IntEnum):
    """The purposes of a trial's random numbers."""

    TRUTH = 0
    SENSORS = 1
    NETWORK = 2
    OBSTACLES = 4
    WHEELS = 5
    UWB = 6
    OWN = 7  # of what a world of somebody else adds to one of ours


def generator(seed: int, trial: int, purpose: Purpose) -> np.random.Generator:
    """Return the generator of one trial and purpose, which no estimator may have."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(trial, int(purpose)))))


def rows(seed: int, trial: Indices, robots: int) -> Rows:
    """Return identity and key of each (trial, robot) row, trial-major; the same for every estimator."""
    key = _keys(seed, tuple(trial.tolist()), robots)
    return Rows(np.repeat(trial, robots), np.tile(np.arange(robots), len(trial)), key)


@lru_cache(maxsize=16)
def _keys(seed: int, trials: tuple[int, ...], robots: int) -> Keys:
    names = (f"{seed}/{k}/{i}".encode() for k in trials for i in range(robots))
    digests = (hashlib.blake2b(name, digest_size=8, person=b"cooploc keys").digest() for name in names)
    keys = np.frombuffer(b"".join(digests), "<u4").astype(np.uint32).reshape(-1, 2)
    keys.flags.writeable = False
    return keys

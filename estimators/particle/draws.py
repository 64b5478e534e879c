"""Random numbers of what filters exchange: a further stream of each row, apart from its own filter's.

So a robot that hears nobody draws the same numbers as one that runs alone.
"""

import numpy as np

from cooploc.estimators.compiled import random_numbers
from cooploc.estimators.interface import Array, Keys

SHARE, SENDER, PLACE, NOISE, ANCESTOR, SAMPLE = range(6)  # what is drawn
STREAM = np.array([0, 0x6A09E667], np.uint32)  # turns a row's key into that of its further stream


def uniforms(key: Keys, tick: int, purpose: int, n: int) -> Array:
    """Uniform pairs (r, n, 2) in (0, 1)."""
    return random_numbers.uniforms(key ^ STREAM, tick, purpose, n)


def normals(key: Keys, tick: int, purpose: int, n: int) -> Array:
    """Standard normal pairs (r, n, 2)."""
    return random_numbers.normals(key ^ STREAM, tick, purpose, n)

"""Random numbers for libraries that draw from the global state of `random` or `numpy.random`, as filterpy's EnKF does.

While a block runs, both states are seeded by a robot's key and the place of the call, so the same call draws the same
numbers in any order, process and company; afterwards they are as they were.
"""

import random
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from cooploc.estimators.interface import Keys


@contextmanager
def keyed(key: Keys, *place: int) -> Iterator[None]:
    """Seed the global generators for a block by a key (k,) and whole numbers of 0 or more; then restore them."""
    seeds = np.random.SeedSequence((*key.tolist(), *place))
    state: Any = np.random.MT19937(seeds).state
    before = random.getstate(), np.random.get_state()  # noqa: NPY002
    try:
        random.setstate(random.Random(int(seeds.generate_state(1, np.uint64)[0])).getstate())
        np.random.set_state(state)  # noqa: NPY002
        yield
    finally:
        random.setstate(before[0])
        np.random.set_state(before[1])  # noqa: NPY002

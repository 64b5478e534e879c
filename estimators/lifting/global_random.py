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

numpy_random: Any = np.random  # its stubs lack the bit generator of the global state


@contextmanager
def keyed(key: Keys, *place: int) -> Iterator[None]:
    """Seed the global generators for a block by a key (k,) and whole numbers of 0 or more; then restore them."""
    seeds = np.random.SeedSequence((*key.tolist(), *place))
    before, state, generator = random.getstate(), _state(), numpy_random.get_bit_generator()
    try:
        random.seed(int(seeds.generate_state(1, np.uint64)[0]))
        numpy_random.set_bit_generator(np.random.MT19937(seeds))  # a tenth of the time of setting its state
        yield
    finally:
        random.setstate(before)
        numpy_random.set_bit_generator(generator)
        if state["has_gauss"]:  # the second of two normal numbers, which is not the bit generator's
            np.random.set_state(state)  # noqa: NPY002


def _state() -> Any:
    return np.random.get_state(legacy=False)  # noqa: NPY002

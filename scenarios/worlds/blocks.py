"""What pairs of robots hear of each other, drawn some ticks at a time, so that a large team fits into memory."""

from collections.abc import Sequence
from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import NDArray

PAIRS = 4_000_000  # of robots, times ticks, at a time


def ticks(total: int, robots: int) -> int:
    """How many ticks are drawn at a time: all of a small team, at least one."""
    return min(total, max(1, PAIRS // robots**2))


def apart(rng: np.random.Generator, count: int, streams: int) -> list[np.random.Generator]:
    """Generators that stand where `rng` does, after `count` normal numbers, after twice as many, and so on."""
    made = [rng]
    for _ in range(streams - 1):
        later = deepcopy(made[-1])
        for start in range(0, count, PAIRS):
            later.standard_normal(min(PAIRS, count - start))
        made.append(later)
    return made


def stack(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """The parts along a new first axis; of one part no copy."""
    return np.stack(parts) if len(parts) > 1 else parts[0][None]

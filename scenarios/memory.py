"""The memory that a simulated scenario needs, estimated before anything is drawn."""

import os
from contextlib import suppress
from pathlib import Path

from cooploc.estimators.errors import BadInput

# Bytes per tick and pair of robots (measured): of every trial, of one trial alone, which is not copied, and more while
# one is drawn.
KEPT, ALONE, DRAWN = 34, 28, 80


def require_memory(label: str, robots: int, ticks: int, trials: int, at_once: int | None = None) -> None:
    """Refuse what this machine, or this container, could not simulate at once; `at_once` ticks are drawn together.

    Raises:
        BadInput: so many trials of a scenario take more memory than there is.

    """
    kept = ALONE if trials == 1 and at_once else KEPT * trials
    needed = robots**2 * (ticks * kept + (at_once or ticks) * DRAWN)  # what pairs of robots hear of each other
    there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with suppress(OSError, ValueError):  # no container, or one without a limit
        there = min(there, int(Path("/sys/fs/cgroup/memory.max").read_text()))
    if needed > there:
        raise BadInput(
            f"scenario {label!r} takes about {needed / 1e9:.3g} GB of memory ({trials} trials of {ticks} ticks and "
            f"{robots} robots), and this machine has {there / 1e9:.3g} GB: take fewer"
        )

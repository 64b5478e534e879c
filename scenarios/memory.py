"""How much memory a simulated scenario needs, estimated before anything is drawn."""

import os
from pathlib import Path

from cooploc.estimators.errors import BadInput

KEPT, DRAWN = 34, 80  # bytes per tick and pair of robots: of every trial, and more while one is drawn (measured)
ONE = 28  # in place of KEPT where there is one trial, which is not copied; hashing takes half of it


def needed(robots: int, ticks: int, trials: int, at_once: int | None = None) -> int:
    """Estimate the bytes that pairs of robots take in so many trials; `at_once` of the ticks are drawn together."""
    kept = ONE if trials == 1 and at_once else KEPT * trials
    return robots**2 * (ticks * kept + (at_once or ticks) * DRAWN)


def demand(label: str, robots: int, ticks: int, trials: int, at_once: int | None = None) -> None:
    """Refuse what this machine could not simulate at once.

    Raises:
        BadInput: so many trials of a scenario take more memory than there is.

    """
    wanted, there = needed(robots, ticks, trials, at_once), available()
    if wanted > there:
        raise BadInput(
            f"scenario {label!r} takes about {gigabytes(wanted)} of memory ({trials} trials of {ticks} ticks and "
            f"{robots} robots), and this machine has {gigabytes(there)}: take fewer"
        )


def available() -> int:
    """Return the bytes of memory that this machine, or this container, has."""
    whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    try:
        return min(whole, int(Path("/sys/fs/cgroup/memory.max").read_text()))
    except (OSError, ValueError):  # no container, or one without a limit
        return whole


def gigabytes(count: float) -> str:
    """Return bytes as people write them."""
    return f"{count / 1e9:.3g} GB"

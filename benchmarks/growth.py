"""How seconds and memory grow with robots, ticks, trials and particles: slopes on logarithmic axes, in one figure.

Run: python benchmarks/growth.py [figure.png] [rounds]. Robots spread over an area that grows with the team, so that
each hears about eight others however many there are: what grows faster than the team does so because of the team, not
of its neighbours. Seconds are the processor's, of one estimator on a stream that is there already (`estimate`) and of
making that stream (`simulate`), in each round; memory is what numpy has allocated at most, by tracemalloc, for both,
once. A slope is fitted to the larger half; 1 is linear.
"""

import sys
import tracemalloc
from collections.abc import Iterator
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import linregress

import cooploc as cl
from cooploc.scenarios.runner.trace import trace, warm_up

ESTIMATOR = "mrsl-distance[anchor_reading=rssi,particles={particles}]"
BASE = {"robots": 10, "ticks": 20, "trials": 4, "particles": 200}
SIZES = {
    "robots": (1, 3, 10, 30, 100, 300, 1000),
    "ticks": (20, 60, 200, 600, 2000),
    "trials": (3, 10, 30, 100),
    "particles": (100, 300, 1000, 3000, 10_000, 30_000),
}
SPACING, HEARS = 6.0, 10.0  # [m] between robots, about; and how far they hear


class Cost(NamedTuple):
    """What one size of a study costs, in each round."""

    simulate: Any  # (rounds,) [s]
    estimate: Any  # (rounds,) [s]
    memory: Any  # (1,) [MB]


def once(size: dict[str, int], measured: bool) -> tuple[float, float, float]:
    """One run; its memory is only `measured` on request, as that takes time."""
    estimator = cl.make(ESTIMATOR.format(**size))
    world = {"robots": size["robots"], "ticks": size["ticks"], "side": SPACING * size["robots"] ** 0.5}
    tracemalloc.start() if measured else None
    start = process_time()
    _, stream = cl.simulate("trajectory", trials=size["trials"], seed=1, radio_range=HEARS, **world)
    made = process_time() - start
    estimate = trace("growth", estimator, stream).seconds
    memory = tracemalloc.get_traced_memory()[1] / 1e6 if measured else np.nan
    tracemalloc.stop() if measured else None
    return made, estimate, memory


def grown(what: str, rounds: int) -> list[Cost]:
    """The cost of every size of what grows."""
    costs = []
    for value in SIZES[what]:
        size = {**BASE, **({"trials": 1} if what == "robots" else {}), what: value}
        times = np.array([once(size, measured=False)[:2] for _ in range(rounds)])
        costs.append(Cost(*times.T, np.array([once(size, measured=True)[2]])))
    return costs


def slopes(what: str, values: Any) -> Any:
    """Of the larger half of the sizes, in each round (rounds,), of values (sizes, rounds)."""
    half, rounds = len(values) // 2, np.array(values).T
    return np.array([linregress(np.log(SIZES[what][half:]), np.log(one[half:])).slope for one in rounds])


def all_grown(rounds: int) -> Iterator[tuple[str, list[Cost]]]:
    """What grows, and the costs of its sizes."""
    _, stream = cl.simulate("trajectory", trials=1, seed=1, ticks=2)
    warm_up("growth", cl.make(ESTIMATOR.format(particles=200)), stream)
    yield from ((what, grown(what, rounds)) for what in SIZES)


def draw(found: dict[str, list[Cost]], path: str) -> None:
    """One column for each thing that grows: seconds above, memory below."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, len(found), figsize=(12, 6), sharex="col", sharey="row", layout="constrained")
    for (what, costs), (above, below) in zip(found.items(), axes.T, strict=True):
        for name, axis in (("simulate", above), ("estimate", above), ("memory", below)):
            values = [getattr(cost, name) for cost in costs]
            label = f"{name}, slope {np.median(slopes(what, values)):.2f}"
            axis.loglog(SIZES[what], np.median(values, 1), "o-", label=label)
        for axis in (above, below):
            axis.legend(frameon=False)
            axis.spines[["top", "right"]].set_visible(False)
        below.set_xlabel(what)
    axes[0, 0].set_ylabel("processor seconds")
    axes[1, 0].set_ylabel("memory [MB]")
    others = ", ".join(f"{value} {name}" for name, value in BASE.items())
    figure.suptitle(f"mrsl-distance, eight neighbours; where not on the axis: {others} (one trial on the first)")
    figure.savefig(path, dpi=110)


def main(path: str = "", rounds: int = 3) -> None:
    found = {}
    for what, costs in all_grown(rounds):
        found[what] = costs
        print(f"{what:>10}{'simulate [s]':>16}{'estimate [s]':>16}{'memory [MB]':>16}")
        for value, cost in zip(SIZES[what], costs, strict=True):
            print(f"{value:>10}" + "".join(f"{np.median(part):>16.3f}" for part in cost), flush=True)
        fitted = (np.median(slopes(what, values)) for values in zip(*costs, strict=True))
        print("     slope" + "".join(f"{one:>16.2f}" for one in fitted))
    if path:
        draw(found, path)


if __name__ == "__main__":
    main(*sys.argv[1:2], *map(int, sys.argv[2:]))

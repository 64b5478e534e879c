"""The worked examples, one filter written four ways: µs per robot and tick, and how often faster than the loop.

Run: python benchmarks/examples.py [rounds]. Prints the table of `examples/README.md`. All get the same stream, the loop
fewer of its trials; they take turns in one process and one thread, and a ratio is of processor seconds in one round.
"""

import sys
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import cooploc as cl
from cooploc.analysis.execution.provenance import provenance

FOLDER = Path(__file__).resolve().parent.parent / "examples"
NAMES = ["filterpy_loop.py:loop", "batched_numpy.py:Batched", "numba_kernel.py:Compiled"]
NAMES += ["jax_traced.py:Traced"] * (find_spec("jax") is not None)
TEAMS = {3: 100, 10: 30}  # robots: trials
LOOP_TRIALS, TICKS = 1, 40


def microseconds(estimator: Any, stream: Any) -> float:
    """Processor time per robot and tick."""
    began = process_time()
    cl.run(estimator, stream, isolate=False)  # in this process, whose time is taken
    return 1e6 * (process_time() - began) / stream.senses.dt.size


def rows(robots: int, rounds: int) -> list[str]:
    """A line of the table for each example."""
    _, stream = cl.simulate(f"scalability/n={robots}", trials=TEAMS[robots], ticks=TICKS)
    few = stream.select(slice(0, LOOP_TRIALS))
    made = {name: cl.make(f"{FOLDER}/{name}") for name in NAMES}
    given = {name: few if name == NAMES[0] else stream for name in NAMES}
    for name in NAMES:
        cl.run(made[name], given[name].first_ticks(2), isolate=False)  # import, compile
    taken = [{name: microseconds(made[name], given[name]) for name in NAMES} for _ in range(rounds)]
    lines = []
    for name in NAMES:
        ratios = [each[NAMES[0]] / each[name] for each in taken]
        each = median(one[name] for one in taken)
        lines.append(
            f"| `{name}` | {robots} | {len(given[name].trial)} | {each:.3g} | {median(ratios):.3g} "
            f"| {min(ratios):.3g} to {max(ratios):.3g} |"
        )
    return lines


def main(rounds: int = 5) -> None:
    """Print the table."""
    made = provenance()
    versions = ", ".join(f"{name} {made['versions'][name]}" for name in ("python", "numpy", "numba", "filterpy"))
    print("| | robots | trials | µs per robot and tick | times the loop | range |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    for robots in TEAMS:
        print("\n".join(rows(robots, rounds)), flush=True)
    print(f"\n{made['cpu']}; {versions}; medians of {rounds} rounds, {TICKS} ticks")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

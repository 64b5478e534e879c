"""The particle filter in double and in single precision: beside the leanest loop, beside each other, and their errors.

Run: python benchmarks/precision.py [rounds]. The work, the teams and the streams are those of `particle_filter.py`; the
loop is that of `lean_filter.py`, and beside it is the older one of `particle_filter.py`. All take turns in one process;
processor time.

Particles that resampling chooses differently after a rounding part two runs of one filter as another seed would, so
that errors differ by chance; the interval says how much is chance.
"""

import sys
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from lean_filter import lean_loop
from particle_filter import CASES, OURS, Case, filterpy_loop, seconds, world

import cooploc as cl

AIMS = {3: (25, 40), 10: (30, 40), 100: (40, 50)}  # times the loop, in double and in single precision, by robots
TWICE, LARGE = 1.8, 10  # single over double, in teams this large
TRIALS, SAME = 1500, 0.1  # [%] by which errors may differ
ERRING = "mrsl-rssi[anchor_reading=rssi{}]", "mrsl-rssi[{}]", "arl[{}]"


class Ratio(NamedTuple):
    """One measured line."""

    what: str
    values: Any  # (rounds,)
    aim: float
    at_most: bool
    older: Any = None  # (rounds,)  the same against the older loop


def raced(case: Case, rounds: int) -> Iterator[Ratio]:
    """Both precisions beside the loop, and beside each other."""
    _, stream = world(case)
    ours = {kind: {"ours": cl.make(OURS[:-1] + f",precision={kind}]")} for kind in ("double", "single")}
    trials, ticks = case.filterpy
    taken: dict[str, list[float]] = {"double": [], "single": [], "lean": [], "older": []}
    loops = {"lean": lean_loop, "older": filterpy_loop}
    for one in ours.values():
        cl.run(one, stream)
    for _ in range(rounds):
        for kind, one in ours.items():
            spent, _ = seconds(lambda one=one: cl.run(one, stream, jobs=1))  # type: ignore[misc]
            taken[kind].append(spent / (case.trials * case.ticks))
        for name, loop in loops.items():
            spent, _ = seconds(lambda loop=loop: loop(stream, trials, ticks))  # type: ignore[misc]
            taken[name].append(spent / (trials * ticks))
    double, single, lean, older = (np.array(each) for each in taken.values())
    team = f"{case.robots} robots"
    for kind, mine, aim in zip(ours, (double, single), AIMS[case.robots], strict=True):
        what = f"lean filterpy loop / mrsl-rssi in {kind} precision, {team}"
        yield Ratio(what, lean / mine, aim, False, older / mine)
    if case.robots >= LARGE:
        yield Ratio(f"double / single precision, {team}", double / single, TWICE, False)


def erring() -> Iterator[Ratio]:
    """By how much the RMSE of single precision is larger, in percent: the lower end, the mean, the upper end."""
    truth, stream = cl.simulate("trajectory", trials=TRIALS, seed=1)
    for name in ERRING:
        kinds = {kind: name.format(f"{',' * (name[-3] != '[')}precision={kind}") for kind in ("double", "single")}
        run = cl.run({kind: cl.make(label) for kind, label in kinds.items()}, stream)
        rmse = {kind: np.sqrt(((t.x - truth.x) ** 2).sum(-1).mean((1, 2))) for kind, t in run.traces.items()}
        apart, scale = rmse["single"] - rmse["double"], rmse["double"].mean() / 100
        half = 1.96 * apart.std(ddof=1) / np.sqrt(TRIALS)
        what = f"RMSE of {name.format('').replace('[]', '')}, single less double [%], 95 % interval"
        yield Ratio(what, (apart.mean() + half * np.array([-1, 0, 1])) / scale, SAME, True)


def ratios(rounds: int = 3) -> Iterator[Ratio]:
    """Every line."""
    for case in CASES:
        yield from raced(case, rounds)
    yield from erring()


def main(rounds: int = 3) -> None:
    for ratio in ratios(rounds):
        low, middle, high = np.quantile(ratio.values, [0, 0.5, 1])
        print(f"{ratio.what:<78}{middle:>8.3g}{f'{low:.3g} to {high:.3g}':>20}{ratio.aim:>8g}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

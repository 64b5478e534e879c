"""What an EKF costs on a recording: one trial, five robots, thousands of ticks, few readings in each.

Run: python benchmarks/recording.py [rounds]. MRCLAM 6 where COOPLOC_DATA (or ../shared/data) has it, else a simulated
camera world of five robots. Every filter and its engine="filterpy" twin run on the same ticks, turn by turn, in
processor time. The twin shares our runner, and our motion and sensor models, so that a ratio is of the filter's own
steps and of what both wait for; `nothing` is an estimator that computes nothing: the runner's own time.
"""

import os
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from commands import spent

import cooploc as cl
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.scenarios.runner.trace import trace, warm_up
from cooploc.scenarios.stream import Stream

DATA = Path(os.environ.get("COOPLOC_DATA", Path(__file__).parents[2] / "shared" / "data")) / "mrclam6"
FILTERS = ("local", "naive", "ci", "split-ci", "luft", "interim", "joint")
TICKS, FEW = 1500, 300  # the filters', and the twins'
EQUAL = 1e-7  # [m] within which both engines must agree


class Cost(NamedTuple):
    """One estimator: processor time per robot and tick, and by how much its twin takes longer."""

    name: str
    microseconds: Any  # (rounds,)
    times: Any  # (rounds,)
    twin: Any  # (rounds,)  microseconds of the twin


class Nothing(DeadReckoning):
    """Stays where it started."""

    def predict(self, s: Any, z: Any) -> Any:
        return s


def recorded() -> tuple[str, Stream]:
    if DATA.is_dir():
        return "MRCLAM 6", cl.simulate("mrclam/all", data=str(DATA))[1]
    return "camera/n=5", cl.simulate("camera/n=5", trials=1, seed=1, ticks=TICKS)[1]


def costs(stream: Stream, rounds: int) -> list[Cost]:
    ours: dict[str, Any] = {"nothing": Nothing(), **{f"ekf-{name}": cl.make(f"ekf-{name}") for name in FILTERS}}
    twins = {name: cl.make(name, engine="filterpy") for name in ours if name != "nothing"}
    long, short = stream.first_ticks(TICKS), stream.first_ticks(FEW)
    for estimator in (*ours.values(), *twins.values()):
        warm_up("warm", estimator, stream)
    taken: dict[str, list[float]] = {name: [] for name in ours}
    times: dict[str, list[float]] = {name: [] for name in ours}
    slower: dict[str, list[float]] = {name: [] for name in ours}
    for _ in range(rounds):
        for name, estimator in ours.items():
            mine = trace(name, estimator, long)
            taken[name].append(1e6 * mine.seconds / (TICKS * stream.robots))
            if name in twins:
                brief, theirs = trace(name, estimator, short), trace(name, twins[name], short)
                times[name].append(theirs.seconds / brief.seconds)
                slower[name].append(1e6 * theirs.seconds / (FEW * stream.robots))
                if (off := float(np.abs(theirs.x[..., :2] - brief.x[..., :2]).max())) > EQUAL:
                    raise RuntimeError(f"the engines of {name} differ by {off:.1e} m")
    return [Cost(name, *(np.array(found[name]) for found in (taken, times, slower))) for name in ours]


def command_seconds() -> float:
    """Processor seconds of `cooploc run mrclam` of the seven filters: three scenarios of all ticks, one process."""
    names = ",".join(f"ekf-{name}" for name in FILTERS)
    return spent("run", "mrclam", "--estimators", names, "--data", str(DATA), "--jobs", "1").processor


def main(rounds: int = 5) -> None:
    what, stream = recorded()
    print(f"{what}, {stream.robots} robots, {TICKS} ticks: microseconds per robot and tick, times filterpy's")
    for cost in costs(stream, rounds):
        us = f"{np.median(cost.microseconds):.1f} ({cost.microseconds.min():.1f} to {cost.microseconds.max():.1f})"
        times = (
            f"{np.median(cost.times):.1f} ({cost.times.min():.1f} to {cost.times.max():.1f})" if cost.times.size else ""
        )
        print(f"{cost.name:<14}{us:>24}{times:>24}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

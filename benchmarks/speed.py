"""What speed was aimed at and what is reached: `reports/speed.md`, every line with its median, range and aim.

Run: python benchmarks/speed.py [report] [rounds]. Processor time; what is compared is measured turn by turn in one
process, so that others on the machine slow both. Every part is a program of its own, too: `ls benchmarks`.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import commands
import growth
import intersection
import joint_ekf
import numpy as np
import precision
import recording
import scaling

from cooploc.analysis.execution.provenance import provenance
from cooploc.estimators.covariance_intersection.weights import relative_weights, weights

FIRST_AND_SECOND = """
import json, cooploc as cl
_, stream = cl.simulate("trajectory", trials=5, seed=1, ticks=50)
print(json.dumps([cl.run("ekf-local", stream).traces["ekf-local"].seconds for _ in range(2)]))
"""

NOTES = "<!-- speed-notes: "  # what reports/page.py writes from here on
NO_NOTES = "python reports/page.py speed-notes RUNS reports/speed.md -->\n\n<!-- end of speed-notes -->\n"
HEAD = """# Speed

What `make bench` measured, in processor time, each ratio of two things that ran turn by turn in one process. "short by"
is how far the median is from the aim, as a factor; empty where the aim is met. "older" is the median of the same
against the reference that was used before; of cvxpy, that of `Problem.solve`; of a recording's filter, that of its twin
with `engine="filterpy"`.

{machine}

| | median | range | aim | short by | older |
| --- | ---: | ---: | ---: | ---: | ---: |
"""

STRAIGHT = 1.1  # a slope that counts as linear
GROWTH = Path(__file__).parents[1] / "reports" / "speed" / "growth.png"


class Line(NamedTuple):
    """One measured number."""

    what: str
    values: Any  # (rounds,)
    aim: float
    at_most: bool  # else at least
    older: Any = None  # (rounds,)  against an older reference

    def row(self) -> str:
        """The line as a row of the table."""
        median = float(np.median(self.values))
        short = median / self.aim if self.at_most else self.aim / median
        aim = f"{'at most' if self.at_most else 'at least'} {self.aim:g}"
        spread = f"{np.min(self.values):.3g} to {np.max(self.values):.3g}"
        older = "" if self.older is None or np.size(self.older) == 0 else f"{np.median(self.older):.3g}"
        by = f"{short:.2f} x" if short > 1 else ""
        return f"| {self.what} | {median:.3g} | {spread} | {aim} | {by} | {older} |\n"


def particles(rounds: int) -> Iterator[Line]:
    """Particle filters in both precisions."""
    yield from (Line(*ratio) for ratio in precision.ratios(rounds))


def weighing(rounds: int) -> Iterator[Line]:
    """The weights of covariance intersection by cvxpy, each fusion a program of its own, as CTRN takes them."""
    for m in (2, 5):
        a = np.random.default_rng(1).normal(size=(intersection.FUSIONS, m, 2, 2))
        P, ask = a @ a.mT + 0.1 * np.eye(2), intersection.asker(m, "trace")
        contenders: dict[str, Any] = {
            "asked": (lambda P=P, ask=ask: [ask(p) for p in P[: intersection.FRESH]], intersection.FRESH, 1),
            "alone": (lambda P=P: weights(P, "trace", "cvxpy", intersection.ALONE), intersection.FUSIONS, 3),
        }
        times = intersection.race(contenders, rounds)
        yield Line(f"cvxpy, {m} sources, alone [µs a fusion]", 1e6 * times["alone"], 150, True, 1e6 * times["asked"])
    rng = np.random.default_rng(2)
    P, H, groups = a[:, 0] @ a[:, 0].mT + 0.1 * np.eye(2), rng.normal(size=(len(a), 1, 2)), intersection.ALONE
    contenders = {
        "alone": (lambda: relative_weights(P, 0.05 * P, H, -H, np.eye(1), "trace", "cvxpy", 2, groups), len(P), 3)
    }
    yield Line("cvxpy, a range, alone [µs a fusion]", 1e6 * intersection.race(contenders, rounds)["alone"], 150, True)


def recorded(rounds: int) -> Iterator[Line]:
    """Every EKF on a recording, alone and by the command."""
    what, stream = recording.recorded()
    costs = recording.costs(stream, rounds)
    for cost in costs:
        yield Line(f"{what}, {cost.name} [µs per robot and tick]", cost.microseconds, 20, True, cost.twin)
        if cost.times.size:
            yield Line(f"its engine=filterpy twin / {cost.name}", cost.times, 10, False)
    ours, twins = (sum(cost[k] for cost in costs if cost.times.size) for k in (1, 3))
    yield Line("all twins together / all seven filters together", twins / ours, 10, False)
    if recording.DATA.is_dir():
        seconds = np.array([recording.command_seconds() for _ in range(min(rounds, 2))])
        yield Line("`cooploc run mrclam` of the seven [s of processor time]", seconds, 60, True)


def joint(rounds: int) -> Iterator[Line]:
    """The joint EKF beside a filterpy loop."""
    for row in joint_ekf.rows(rounds):
        yield Line(row["what"], np.array([row["low"], row["ratio"], row["high"]]), row["target"], False)


def growing(rounds: int) -> Iterator[Line]:
    """Slopes of cost, on logarithmic axes."""
    found = dict(growth.all_grown(rounds))
    growth.draw(found, str(GROWTH))
    for what, costs in found.items():
        for counted, values in zip(growth.Cost._fields, zip(*costs, strict=True), strict=True):
            yield Line(f"slope of {counted} against {what}", growth.slopes(what, values), STRAIGHT, True)
    for row in scaling.rows(rounds):
        yield Line(row["what"], np.array([row["low"], row["ratio"], row["high"]]), STRAIGHT, True)


def first(rounds: int) -> Iterator[Line]:
    """What a user waits for before anything is computed, and what `cl.run` says of a first and of a second run."""
    yield Line("`cooploc --help` [s]", np.array([commands.spent("--help").processor for _ in range(rounds)]), 0.5, True)
    quick = np.array([commands.spent("run", "quick", "--jobs", "2") for _ in range(rounds)])
    yield Line("`cooploc run quick`, kernels compiled [s on two processors]", quick[:, 1] / 2, 10, True)
    compiling = np.array([commands.compiling()])
    yield Line("compiling what `quick` needs [s on two processors]", compiling[:, 1] / 2, 8, True)
    ratios = []
    for _ in range(min(rounds, 2)):  # each compiles everything again
        with tempfile.TemporaryDirectory() as empty:
            alone = {**os.environ, "NUMBA_CACHE_DIR": empty}
            told = subprocess.run(
                [sys.executable, "-c", FIRST_AND_SECOND], env=alone, stdout=subprocess.PIPE, check=True
            )
        one, two = json.loads(told.stdout)
        ratios.append(one / two)
    yield Line("time of a first `cl.run` of ekf-local, nothing compiled / a second", np.array(ratios), 2, True)


def main(report: str = "", rounds: int = 3) -> None:
    """Print each line as soon as it is measured, and write the report."""
    made = provenance()
    versions = ", ".join(
        f"{name} {made['versions'][name]}" for name in ("python", "numpy", "numba", "scipy", "filterpy")
    )
    busy = f"{os.getloadavg()[0]:.0f} processes wanted its {os.cpu_count()} processors when this began"
    text = HEAD.format(machine=f"{made['cpu']}; {versions}; {rounds} rounds; {busy}.")
    print(text, end="")
    for part in (particles, weighing, recorded, joint, growing, first):
        for line in part(rounds):
            text += line.row()
            print(line.row(), end="", flush=True)
    if report:
        page = Path(report)
        _, mark, rest = (page.read_text(encoding="utf-8") if page.exists() else "").partition(NOTES)
        page.write_text(f"{text}\n{NOTES}{rest if mark else NO_NOTES}", encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:2], *map(int, sys.argv[2:]))

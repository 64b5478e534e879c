"""What breaks, and what it costs: the sections of reports/reliability.md, each replaced by what measures it.

Run: python benchmarks/reliability.py REPORT ["jobs 1" "jobs 2" Dask], all where none is named; or
python benchmarks/reliability.py REPORT reproduced RUNS DATA.

Crashes: every way to end a process, in every place where a plug-in's code runs, for every kind of worker. Each cell is
a plug-in of its own that does one bad thing in one place, in trial 1 of 2, or whenever it is imported or made. All of
them run in one study, beside a built-in estimator.

Reproduced: some trials of every run behind the reports, run again; exit code 1 where a result is not bit-equal.
"""

import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from fcntl import LOCK_EX, flock
from pathlib import Path
from typing import NamedTuple

import pandas as pd

import cooploc as cl

HEAD = """# Reliability

Made by `python reports/make_all.py --only reliability,reproduced`: every section by `benchmarks/reliability.py`.
"""
KINDS = {
    "segfault": "import ctypes; ctypes.string_at(0)",
    "os._exit": "import os; os._exit(0)",
    "hang": "import time; time.sleep(1e6)",
    "memory": "import resource, numpy\n    resource.setrlimit(resource.RLIMIT_AS, (2**33, -1))\n    numpy.ones(2**31)",
    "recursion": "import sys; sys.setrecursionlimit(10**7); list(map(lambda _: trouble(), [0]))",
}
METHODS = "init", "predict", "fuse", "estimate"
PLACES = "import", "__init__", *METHODS, "simulate"
MODES = "jobs 1", "jobs 2", "Dask"
LIMIT = 2.0  # [s] of the study
ESTIMATOR = """
from cooploc.estimators.dead_reckoning import DeadReckoning

def trouble():
    {does}

PLACE = "{place}"
if PLACE == "import":
    trouble()

class Cell(DeadReckoning):
    bad = False

    def __init__(self):
        if PLACE == "__init__":
            trouble()
        super().__init__()

    def init(self, prior, world, rows):
        object.__setattr__(self, "bad", bool((rows.trial == 1).any()))
        return super().init(prior, world, rows)

def perhaps(method):
    own = getattr(Cell, method)
    def call(self, *arguments):
        found = own(self, *arguments)
        if self.bad and PLACE == method:
            trouble()
        return found
    return call

for method in {METHODS}:
    setattr(Cell, method, perhaps(method))
"""
SCENARIO = """
from cooploc.scenarios import Family
from cooploc.scenarios.worlds.radio import Paper

def trouble():
    {does}

class Model(Paper):
    def simulate(self, label, trials, seed, world):
        if 1 in trials:
            trouble()
        return super().simulate(label, trials, seed, world)

Cell = Family("ends its process", Model)
"""
EXPLAINED = """A cell holds (✓) where the bad trial failed with a line that says why, the other trial and all trials of
a built-in estimator in the same study have a result, and the command ended with exit code 1."""
BUILTIN, WORLD = "dead-reckoning", "robots-1-3/n=1[ticks=4]"


class Cell(NamedTuple):
    """One way to end a process, in one place."""

    kind: str
    place: str

    @property
    def label(self) -> str:
        place = "made" if self.place == "__init__" else self.place  # not the file of `init`
        return f"{re.sub(r'[^a-z]', '', self.kind)}_{place}.py:Cell"

    @property
    def pair(self) -> tuple[str, str]:
        """The scenario and the estimator whose rows tell."""
        return (f"{self.label}[ticks=4]", BUILTIN) if self.place == "simulate" else (WORLD, self.label)

    def write(self, folder: Path) -> None:
        source = SCENARIO if self.place == "simulate" else ESTIMATOR
        text = source.format(does=KINDS[self.kind], place=self.place, METHODS=METHODS)
        (folder / self.label.partition(":")[0]).write_text(text)


Outcome = tuple[bool, str]  # whether a cell held, and the bad trial's failure


def main(report: str, *modes: str) -> int:
    """Measure and write what is asked for; 1 where something does not hold."""
    if modes[:1] == ("reproduced",):
        return reproduced(Path(report), *modes[1:])
    lost = 0
    for mode in modes or MODES:
        cells = [Cell(kind, place) for kind in KINDS for place in PLACES]
        with tempfile.TemporaryDirectory() as folder:
            outcomes, seconds = run(cells, mode, Path(folder))
        put(Path(report), mode, section(mode, outcomes, seconds))
        lost += sum(not held for held, _ in outcomes.values())
    return min(lost, 1)


def put(report: Path, name: str, text: str) -> None:
    """Write a section in place of the one of this name, or behind the last one; one process at a time."""
    start, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    with report.open("a+", encoding="utf-8") as file:
        flock(file, LOCK_EX)
        file.seek(0)
        before, _, rest = (file.read() or HEAD).partition(start)
        after = rest.partition(end)[2].strip()
        file.truncate(0)
        file.write(f"{before.rstrip()}\n\n{start}\n{text.strip()}\n{end}\n" + (f"\n{after}\n" if after else ""))


def run(cells: list[Cell], mode: str, folder: Path) -> tuple[dict[Cell, Outcome], float]:
    """One study of all cells; what became of each, and how long it took [s]."""
    for cell in cells:
        cell.write(folder)
    estimators = [BUILTIN, *(cell.label for cell in cells if cell.place != "simulate")]
    scenarios = [cell.pair[0] for cell in cells if cell.place == "simulate"]
    lines = [f"trials = 2\ntime_limit = {LIMIT}\nbaseline = '{BUILTIN}'\nscenarios = ['{WORLD}']"]
    lines += [f"estimators = {estimators}", f"[[also]]\nscenarios = {scenarios}\nestimators = ['{BUILTIN}']"]
    (folder / "cells.toml").write_text("\n".join(lines))
    out = folder / mode.replace(" ", "")
    command = [sys.executable, "-m", "cooploc", "run", "cells.toml", "--no-check", "--out", str(out)]
    began = time.monotonic()
    with chdir(folder), started(mode) as asked:  # a worker looks for plug-ins where it was started
        ended = subprocess.run([*command, *asked], cwd=folder, stdout=subprocess.DEVNULL)
    rows = pd.concat(pd.read_parquet(file) for file in sorted((out / "parts").glob("*.parquet")))
    print(f"{mode}: exit code {ended.returncode}, {time.monotonic() - began:.0f} s", file=sys.stderr)
    healthy = rows[(rows["scenario"] == WORLD) & (rows["estimator"] == BUILTIN)]
    sound = ended.returncode == 1 and len(healthy) == 2 and healthy["failure"].isna().all()
    return {cell: outcome(cell, rows, sound) for cell in cells}, time.monotonic() - began


def outcome(cell: Cell, rows: pd.DataFrame, sound: bool) -> Outcome:
    """Trial 1 must have failed, and trial 0 too where import or `__init__` is at fault; else it has a result."""
    scenario, estimator = cell.pair
    mine = rows[(rows["scenario"] == scenario) & (rows["estimator"] == estimator)].groupby("trial")["failure"].first()
    always = cell.place in ("import", "__init__")
    held = sound and list(mine.index) == [0, 1] and isinstance(mine[1], str) and isinstance(mine[0], str) == always
    return held, str(mine.get(1, "no row"))


@contextmanager
def started(mode: str) -> Iterator[list[str]]:
    """Start what a mode needs, and yield the command's options for it."""
    if mode != "Dask":
        yield ["--jobs", mode[-1]]
        return
    from distributed import LocalCluster

    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        yield ["--scheduler", cluster.scheduler_address]


def section(mode: str, outcomes: dict[Cell, Outcome], seconds: float) -> str:
    good = sum(held for held, _ in outcomes.values())
    lines = [f"## Crashes with {mode}: {good} of {len(outcomes)} hold, {seconds:.0f} s", "", EXPLAINED, ""]
    lines += [f"| | {' | '.join(f'`{place}`' for place in PLACES)} |", "| --- |" + " --- |" * len(PLACES)]
    for kind in KINDS:
        row = [outcomes[Cell(kind, place)] for place in PLACES]
        lines.append(f"| {kind} | {' | '.join('✓' if held else f'✗ {text}' for held, text in row)} |")
    said: dict[str, list[str]] = {}
    for cell, (_, text) in outcomes.items():
        said.setdefault(re.sub(r" \(\w+\.py:\d+\)$", "", text), []).append(f"{cell.kind} in `{cell.place}`")
    told = [f"- {line}: {', '.join(where)}" for line, where in said.items()]
    return "\n".join([*lines, "", "What the failed trials say:", "", *told])


TRIALS = 6
RECORDED = {"mrclam": "mrclam6", "wifi-priors": "wifi-rssi"}  # runs on recordings, and the folder of these


def reproduced(report: Path, runs: str, data: str) -> int:
    """Run trials of every run again and write the section; 1 where a result came out otherwise."""
    rows = []
    for folder in sorted(path.parent for path in Path(runs).glob("*/parts")):
        recordings = Path(data) / RECORDED[folder.name] if folder.name in RECORDED else None
        if recordings and not recordings.exists():
            print(f"{folder.name}: {recordings} is not there", file=sys.stderr)
            continue
        found = cl.reproduce(folder, TRIALS, recordings).table
        unlike = found[~found["equal"]]
        first = "; ".join(f"{one.estimator} in {one.scenario}: {one.remark}" for one in unlike.head(2).itertuples())
        rows.append((folder.name, len(found), found["equal"].sum(), first.replace("|", r"\|")))
    text = f"""## Every report's runs, run again

Of each run {TRIALS} trials, each of another scenario where there are as many, with all estimators that ran there.
`cooploc reproduce RUN_DIR` lists the results one by one.

| run | results | bit-equal | not equal |
| :-- | --: | --: | :-- |
"""
    put(report, "reproduced", text + "".join(f"| {' | '.join(map(str, row))} |\n" for row in rows))
    return int(any(equal < results for _, results, equal, _ in rows))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

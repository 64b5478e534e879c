"""Every way to end a process, in every place where a plug-in's code runs, for every kind of worker: what is lost?

Run: python benchmarks/reliability/crash_matrix.py reports/reliability.md ["jobs 1" "jobs 2" Dask]. Puts a table for
each kind of worker into the report, as soon as it is measured; `make reliability` makes the whole report. Each cell is
a plug-in of its own that does one bad thing in one place, in trial 1 of 2, or whenever it is imported or made. All of
them run in one study, beside a built-in estimator. A cell holds where the bad trial failed, the other trial and every
trial of the built-in estimator have a result, and the command ended with exit code 1.
"""

import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from sections import put

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
        self.perhaps("init")
        return super().init(prior, world, rows)

    def predict(self, s, z):
        self.perhaps("predict")
        return super().predict(s, z)

    def fuse(self, s, z, mail):
        self.perhaps("fuse")
        return super().fuse(s, z, mail)

    def estimate(self, s):
        self.perhaps("estimate")
        return super().estimate(s)

    def perhaps(self, method):
        if self.bad and PLACE == method:
            trouble()
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
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


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
        text = source.format(does=KINDS[self.kind], place=self.place)
        (folder / self.label.partition(":")[0]).write_text(text)


class Outcome(NamedTuple):
    """What became of one cell."""

    held: bool
    said: str  # the bad trial's failure


def main(report: Path, *modes: str) -> None:
    cells = [Cell(kind, place) for kind in KINDS for place in PLACES]
    lost = 0
    for mode in modes or MODES:
        with tempfile.TemporaryDirectory() as folder:
            outcomes, seconds = run(cells, mode, Path(folder))
        put(report, mode, section(mode, outcomes, seconds))
        lost += sum(not one.held for one in outcomes.values())
    sys.exit(min(lost, 1))


def run(cells: list[Cell], mode: str, folder: Path) -> tuple[dict[Cell, Outcome], float]:
    """One study of all cells; what became of each, and how long it took [s]."""
    for cell in cells:
        cell.write(folder)
    study(cells, folder)
    out = folder / mode.replace(" ", "")
    command = [sys.executable, "-m", "cooploc", "run", "cells.toml", "--no-check", "--out", str(out)]
    began = time.monotonic()
    with Cluster(folder, mode == "Dask") as cluster:
        asked = ["--scheduler", cluster.address] if mode == "Dask" else ["--jobs", mode[-1]]
        ended = subprocess.run([*command, *asked], cwd=folder, stdout=subprocess.DEVNULL, env=environment(folder))
    rows = pd.concat(pd.read_parquet(file) for file in sorted((out / "parts").glob("*.parquet")))
    print(f"{mode}: exit code {ended.returncode}, {time.monotonic() - began:.0f} s", file=sys.stderr)
    healthy = rows[(rows["scenario"] == WORLD) & (rows["estimator"] == BUILTIN)]
    sound = ended.returncode == 1 and len(healthy) == 2 and healthy["failure"].isna().all()
    return {cell: outcome(cell, rows, sound) for cell in cells}, time.monotonic() - began


def study(cells: list[Cell], folder: Path) -> None:
    estimators = [BUILTIN, *(cell.label for cell in cells if cell.place != "simulate")]
    scenarios = [cell.pair[0] for cell in cells if cell.place == "simulate"]
    lines = [f"trials = 2\ntime_limit = {LIMIT}\nbaseline = '{BUILTIN}'\nscenarios = ['{WORLD}']"]
    lines += [f"estimators = {estimators}", f"[[also]]\nscenarios = {scenarios}\nestimators = ['{BUILTIN}']"]
    (folder / "cells.toml").write_text("\n".join(lines))


def outcome(cell: Cell, rows: pd.DataFrame, sound: bool) -> Outcome:
    """Trial 1 must have failed, and trial 0 too where import or `__init__` is at fault; else it has a result."""
    scenario, estimator = cell.pair
    mine = rows[(rows["scenario"] == scenario) & (rows["estimator"] == estimator)].groupby("trial")["failure"].first()
    always = cell.place in ("import", "__init__")
    held = sound and list(mine.index) == [0, 1] and isinstance(mine[1], str) and isinstance(mine[0], str) == always
    return Outcome(held, str(mine.get(1, "no row")))


def environment(folder: Path) -> dict[str, str]:
    """Commands find this clone, and stay off the terminal."""
    found = [os.getcwd(), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, found))}


class Cluster:
    """A Dask scheduler with one worker, where it is wanted."""

    def __init__(self, folder: Path, wanted: bool) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.folder, self.wanted, self.begun = folder, wanted, []
        self.address = f"tcp://127.0.0.1:{self.port}"

    def __enter__(self) -> "Cluster":
        if self.wanted:
            options = {"cwd": self.folder, "env": environment(self.folder), **QUIET}
            dask = [sys.executable, "-m", "dask"]
            scheduler = ["scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard"]
            worker = ["worker", self.address, "--nthreads", "1", "--no-dashboard"]
            self.begun = [subprocess.Popen([*dask, *one], **options) for one in (scheduler, worker)]
            wait_for_worker(self.address)
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.begun[::-1]:
            process.terminate()
            process.wait()


def wait_for_worker(address: str, seconds: float = 120) -> None:
    from distributed import Client

    with Client(address, timeout=seconds, set_as_default=False) as client:
        client.wait_for_workers(1, timeout=seconds)


def section(mode: str, outcomes: dict[Cell, Outcome], seconds: float) -> str:
    good = sum(one.held for one in outcomes.values())
    lines = [f"## Crashes with {mode}: {good} of {len(outcomes)} hold, {seconds:.0f} s", "", EXPLAINED, ""]
    lines += [f"| | {' | '.join(f'`{place}`' for place in PLACES)} |", "| --- |" + " --- |" * len(PLACES)]
    for kind in KINDS:
        row = [outcomes[Cell(kind, place)] for place in PLACES]
        lines.append(f"| {kind} | {' | '.join('✓' if one.held else f'✗ {one.said}' for one in row)} |")
    said: dict[str, list[str]] = {}
    for cell, one in outcomes.items():
        said.setdefault(re.sub(r" \(\w+\.py:\d+\)$", "", one.said), []).append(f"{cell.kind} in `{cell.place}`")
    told = [f"- {line}: {', '.join(where)}" for line, where in said.items()]
    return "\n".join([*lines, "", "What the failed trials say:", "", *told])


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])

"""Computes again what the repository says about the world: runs the studies, then writes every page and figure.

Run: python reports/make_all.py [--runs DIR] [--data DIR] [--jobs N] [--only NAME,NAME], or `make reports`.
Runs are kept in `--runs` and go on where they were ended, as many side by side as there are jobs; pages are written
again. What needs recordings is left out where there are none. Ends with a table; exit code 1 where a step failed.
"""

import os
import subprocess
import sys
import time
from argparse import ArgumentParser, Namespace
from concurrent.futures import ThreadPoolExecutor
from itertools import groupby, repeat
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

HERE = Path(__file__).resolve().parent
BENCH = HERE.parent / "benchmarks"
PYTHON, COOPLOC = sys.executable, (sys.executable, "-m", "cooploc")


class Step(NamedTuple):
    """A command that makes a run or a page; {runs}, {data} and {jobs} stand for what is asked for."""

    name: str
    command: tuple[str, ...]
    recordings: tuple[str, ...] = ()  # folders or files below the data that it needs


def study(name: str, *options: str, data: str = "", file: str = "", command: str = "run") -> Step:
    """Return a run, or a tuning, of a study in the folder of its name."""
    recordings = ("--data", f"{{data}}/{data}") if data else ()
    out = ("--jobs", "{jobs}", "--out", f"{{runs}}/{name}")
    return Step(name, (*COOPLOC, command, file or name, *out, *recordings, *options), (data,) * bool(data))


def benchmark(name: str, script: str, page: str, *more: str) -> Step:
    """Return a page, or a section of one, that a script in benchmarks measures."""
    return Step(name, (PYTHON, str(BENCH / script), str(HERE / page), *more))


def page(name: str, out: str, *recordings: str) -> Step:
    """Return a page that is made of a text, or the part of a page that is."""
    command = (PYTHON, str(HERE / "page.py"), name, "{runs}", str(HERE / out), "--data", "{data}")
    return Step(f"{name} in {out}", command, recordings)


BUDGET, SIDE_BY_SIDE = ("--budget", "120"), {"{jobs}", str(HERE / "statistics.md")}  # in commands that measure no time
STEPS = (  # speed first, on an idle machine; then runs, long ones first, and pages after what they show
    benchmark("speed", "speed.py", "speed.md"),
    study("paper"), study("readings", "--trials", "24"),
    study("without-scalability", "--until-decided", "--max-trials", "320", file=f"{BENCH}/without-scalability.toml"),
    study("paper-fair", *BUDGET, command="tune"), study("fusion"), study("three-readings"), study("gbp"),
    study("paper-fair-mrclam", *BUDGET, command="tune", data="mrclam6"), study("information"), study("reasons"),
    study("sensitivity"), study("mrclam", data="mrclam6"), study("fusion-worlds"), study("uwb"), study("sightings"),
    study("fixed-weights", "--seed", "7"), study("vague-start"), study("wifi-priors", data="wifi-rssi"),
    study("own-filter"), study("quick"), benchmark("rates", "statistics/rates.py", "statistics.md"),
    benchmark("stopping", "statistics/stopping.py", "statistics.md"),
    benchmark("reliability", "reliability.py", "reliability.md"),
    page("fusion", "fusion.md", "mrclam6"),
    page("information", "information.md"),
    page("readings", "readings/README.md"),
    page("three-readings", "readings/three-readings.md"),
    page("tuned", "tuned.md"),
    page("real-robots", "real-robots.md", "mrclam6", "wifi-rssi", "uwb-tiers"),
    benchmark("peers", "peers/table.py", "peers.md"),
    Step("quick.png", ("cp", "{runs}/quick/rmse.png", str(HERE / "quick.png"))),
    benchmark("reproduced", "reliability.py", "reliability.md", "reproduced", "{runs}", "{data}"),
    page("paper", "paper/README.md"),
    page("summary.tex.j2", "paper/summary.pdf"),
    page("speed-notes", "speed.md"),
)  # fmt: skip


def main() -> int:
    """Make everything, or what is asked for, in this order."""
    parser = ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=Path, default=HERE.parent / "build" / "reports", help="folder of the runs")
    recordings = os.environ.get("COOPLOC_DATA", "../shared/data")
    parser.add_argument("--data", type=Path, default=recordings, help="folder of the recordings")
    parser.add_argument("--jobs", type=int, default=2, help="number of processes of a run")
    parser.add_argument("--only", default="", help="names of steps, separated by commas")
    asked = parser.parse_args()
    wanted = set(asked.only.split(",")) if asked.only else {step.name for step in STEPS}
    if unknown := wanted - {step.name for step in STEPS}:
        parser.error(f"no step {sorted(unknown)[0]!r}; there are {', '.join(step.name for step in STEPS)}")
    table, chosen = Table("step", "minutes", "", title="What was made"), [one for one in STEPS if one.name in wanted]
    for together, group in groupby(chosen, lambda step: not SIDE_BY_SIDE.isdisjoint(step.command)):
        steps = list(group)
        each = max(1, asked.jobs // len(steps))  # processes: a run with one keeps none waiting for its last tasks
        with ThreadPoolExecutor(asked.jobs if together else 1) as pool:
            places = [f" ({chosen.index(step) + 1} of {len(chosen)})" for step in steps]
            for row in pool.map(run_step, steps, repeat(asked), repeat(each), places):
                table.add_row(*row)
    Console().print(table)
    return int("failed" in table.columns[-1].cells)


def run_step(step: Step, asked: Namespace, jobs: int = 1, place: str = "") -> tuple[str, str, str]:
    """Run a step, and return its name, the minutes that it took, and how it ended."""
    absent = [name for name in step.recordings if not (asked.data / name).exists()]
    if absent:
        return step.name, "", f"left out: {asked.data / absent[0]} is not there"
    log = asked.runs / "logs" / f"{step.name.replace('/', '-')}.txt"
    log.parent.mkdir(parents=True, exist_ok=True)
    print(f"{time.strftime('%H:%M')} {step.name}{place} begins; it prints into {log}", file=sys.stderr, flush=True)
    command = [part.format(runs=asked.runs, data=asked.data, jobs=jobs) for part in step.command]
    began, at = time.monotonic(), time.time()
    with log.open("w", encoding="utf-8") as out:
        code = subprocess.call(command, env=os.environ | {"PYTHONWARNINGS": "ignore"}, stdout=out, stderr=out)
    ended = "failed" if code else ""
    last = asked.runs / step.name / "table.csv"  # that a run writes; a crash ends with the same code and without it
    if code == 1 and "run" in step.command and last.exists() and last.stat().st_mtime >= at:
        ended = "with trials that failed"
    minutes = f"{(time.monotonic() - began) / 60:.1f}"
    print(f"{time.strftime('%H:%M')} {step.name}{place} {ended or 'done'}, {minutes} min", file=sys.stderr, flush=True)
    return step.name, minutes, ended


if __name__ == "__main__":
    sys.exit(main())

"""Computes again what the repository says about the world: runs the studies, then writes every page and figure.

Run: python reports/make_all.py [--runs DIR] [--data DIR] [--jobs N] [--only NAME,NAME] [--trials N], or `make reports`.
Runs are kept in `--runs` and go on where they were ended; pages are always written again. What needs recordings is left
out where there are none. Speed is measured first, alone; then two runs or pages at a time share the processes; then
what takes numbers from other pages is made. What a step prints is kept in `--runs`/logs. Ends with a table of what
was made, in which time; exit code 1 where a step failed.
"""

import os
import subprocess
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

HERE = Path(__file__).resolve().parent
BENCHMARKS = HERE.parent / "benchmarks"
PYTHON, COOPLOC = sys.executable, (sys.executable, "-m", "cooploc")


class Step(NamedTuple):
    """A command that makes a run or a page; {runs}, {data}, {jobs} and {trials} stand for what is asked for."""

    name: str
    command: tuple[str, ...]
    recordings: tuple[str, ...] = ()  # folders or files below the data that it needs
    after: tuple[str, ...] = ()  # steps that it waits for


def study(name: str, *options: str, data: str = "", file: str = "") -> Step:
    """Return a run of a study, in the folder of its name."""
    recordings = ("--data", f"{{data}}/{data}") if data else ()
    out = ("--jobs", "{jobs}", "--out", f"{{runs}}/{name}")
    return Step(name, (*COOPLOC, "run", file or name, *out, *recordings, *options, "{trials}"), (data,) * bool(data))


def tuning(name: str, data: str = "") -> Step:
    """Return a tuning of a study, in the folder of its name."""
    recordings = ("--data", f"{{data}}/{data}") if data else ()
    command = (*COOPLOC, "tune", name, "--budget", "120", "--jobs", "{jobs}", "--out", f"{{runs}}/{name}", *recordings)
    return Step(name, command, (data,) * bool(data))


def benchmark(name: str, script: str, page: str, *more: str, after: tuple[str, ...] = ()) -> Step:
    """Return a page, or a section of one, that a script in benchmarks measures."""
    return Step(name, (PYTHON, str(BENCHMARKS / script), str(HERE / page), *more), (), after)


def page(name: str, out: str, after: tuple[str, ...] = (), recordings: tuple[str, ...] = ()) -> Step:
    """Return a page that is made of a text, or the part of a page that is; it waits for the runs that it shows."""
    command = (PYTHON, str(HERE / "page.py"), name, "{runs}", str(HERE / out), "--data", "{data}")
    return Step(f"{name} in {out}", command, recordings, after)


ALONE = (benchmark("speed", "speed.py", "speed.md"),)  # on an idle machine
RUNS = (  # the longest first
    study("paper"),
    study("without-scalability", "--until-decided", "--max-trials", "320", file=f"{HERE}/without-scalability.toml"),
    study("readings", "--trials", "24"), study("fusion"), tuning("paper-fair"), tuning("paper-fair-mrclam", "mrclam6"),
    benchmark("rates", "statistics/rates.py", "statistics.md"), study("reasons"), study("information"),
    study("sensitivity"), study("gbp"), study("mrclam", data="mrclam6"), study("sightings"),
    study("fixed-weights", "--seed", "7"), study("vague-start"), study("uwb"), study("wifi-priors", data="wifi-rssi"),
    study("own-filter"), study("quick"),
)  # fmt: skip
PAGES = (
    benchmark("reliability", "reliability.py", "reliability.md"),
    page("fusion", "fusion.md", ("fusion", "fixed-weights", "vague-start", "gbp"), ("mrclam6",)),
    benchmark("stopping", "statistics/stopping.py", "statistics.md", after=("rates",)),
    page("information", "information.md", ("information", "sensitivity", "sightings")),
    page("readings", "readings/README.md", ("readings",)),
    page("tuned", "tuned.md", ("paper-fair", "paper-fair-mrclam")),
    page("real-robots", "real-robots.md", ("uwb", "mrclam", "wifi-priors"), ("mrclam6", "wifi-rssi", "uwb-tiers")),
    benchmark("peers", "peers/table.py", "peers.md"),
    Step("quick.png", ("cp", "{runs}/quick/rmse.png", str(HERE / "quick.png")), after=("quick",)),
)  # fmt: skip
EVERY_RUN = tuple(step.name for step in RUNS)
LAST = (  # with numbers and figures of other pages
    benchmark("reproduced", "reliability.py", "reliability.md", "reproduced", "{runs}", "{data}", after=EVERY_RUN),
    page(
        "paper",
        "paper/README.md",
        ("paper", "reasons", "readings", "own-filter", "without-scalability", "information", "fusion", "paper-fair"),
    ),
    page("summary.tex.j2", "paper/summary.pdf", ("information", "fusion", "reasons", "paper-fair")),
    page("speed-notes", "speed.md"),
)
STEPS = (*ALONE, *RUNS, *PAGES, *LAST)


def main() -> int:
    """Make everything, or what is asked for."""
    parser = ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=Path, default=HERE.parent / "build" / "reports", help="folder of the runs")
    recordings = os.environ.get("COOPLOC_DATA", "../shared/data")
    parser.add_argument("--data", type=Path, default=recordings, help="folder of the recordings")
    parser.add_argument("--jobs", type=int, default=2, help="number of processes of a run")
    parser.add_argument("--only", default="", help="names of steps, separated by commas")
    parser.add_argument("--trials", default="", help="of every run, for a try")
    asked = parser.parse_args()
    if asked.jobs < 1:
        parser.error(f"--jobs is {asked.jobs}; it must be at least 1")
    wanted = set(asked.only.split(",")) if asked.only else {step.name for step in STEPS}
    if unknown := wanted - {step.name for step in STEPS}:
        parser.error(f"no step {sorted(unknown)[0]!r}; there are {', '.join(step.name for step in STEPS)}")
    asked.runs.mkdir(parents=True, exist_ok=True)
    table = Table("step", "minutes", "", title="What was made")
    lanes = min(2, asked.jobs)
    for steps, at_once in ((ALONE, 1), ((*RUNS, *PAGES), lanes), (LAST, 1)):
        begun: dict[str, Future[tuple[str, str, str]]] = {}
        with ThreadPoolExecutor(at_once) as pool:
            for step in (one for one in steps if one.name in wanted):
                before = [begun[name] for name in step.after if name in begun]
                begun[step.name] = pool.submit(run_step, step, asked, asked.jobs // at_once, before)
        for row in begun.values():
            table.add_row(*row.result())
    Console().print(table)
    return int("failed" in table.columns[-1].cells)


def run_step(step: Step, asked: Namespace, jobs: int, before: Sequence["Future[Any]"] = ()) -> tuple[str, str, str]:
    """Run a step after others, and return its name, the minutes that it took, and how it ended.

    The steps that it waits for stand before it in the list, so that no two wait for each other.
    """
    wait(before)
    absent = [name for name in step.recordings if not (asked.data / name).exists()]
    if absent:
        return step.name, "", f"left out: {asked.data / absent[0]} is not there"
    log = asked.runs / "logs" / f"{step.name.replace('/', '-')}.txt"
    log.parent.mkdir(parents=True, exist_ok=True)
    log_line(f"{step.name} begins; what it prints is in {log}")
    began, at = time.monotonic(), time.time()
    with log.open("w", encoding="utf-8") as out:
        command, quiet = filled(step, asked, jobs), {**os.environ, "PYTHONWARNINGS": "ignore"}
        code = subprocess.run(command, check=False, env=quiet, stdout=out, stderr=out).returncode
    ended = "failed" if code else ""
    last = asked.runs / step.name / "table.csv"  # that a run writes; a crash ends with the same code and without it
    if code == 1 and "run" in step.command and last.exists() and last.stat().st_mtime >= at:
        ended = "with trials that failed"
    minutes = f"{(time.monotonic() - began) / 60:.1f}"
    log_line(f"{step.name} took {minutes} minutes" + (f" and ended: {ended}, see {log}" if ended else ""))
    return step.name, minutes, ended


def log_line(what: str) -> None:
    """Print a line with the time."""
    print(f"{time.strftime('%H:%M')} {what}", file=sys.stderr, flush=True)


def filled(step: Step, asked: Namespace, jobs: int) -> list[str]:
    """Return the command with what is asked for in its places."""
    places = {"runs": asked.runs, "data": asked.data, "jobs": jobs}
    command = [part.format(**places) for part in step.command if part != "{trials}"]
    return [*command, "--trials", asked.trials] if asked.trials and "{trials}" in step.command else command


if __name__ == "__main__":
    sys.exit(main())

"""Computes again what the repository says about the world: runs the studies, then writes every page and figure.

Run: python reports/make_all.py [--runs DIR] [--data DIR] [--jobs N] [--only NAME,NAME] [--trials N], or `make reports`.
Runs are kept in `--runs` and go on where they were ended; pages are always written again. What needs recordings is left
out where there are none. A run has all processes; then pages are made, as many at a time as there are processes. Ends
with a table of what was made, in which time; exit code 1 where a step failed.
"""

import os
import subprocess
import sys
import time
from argparse import ArgumentParser, Namespace
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

HERE = Path(__file__).resolve().parent
PYTHON, COOPLOC = sys.executable, (sys.executable, "-m", "cooploc")


class Step(NamedTuple):
    """A command that makes a run or a page; {runs}, {data}, {jobs} and {trials} stand for what is asked for."""

    name: str
    command: tuple[str, ...]
    recordings: tuple[str, ...] = ()  # folders or files below the data that it needs


def study(name: str, *options: str, data: str = "") -> Step:
    """A run of a study, in the folder of its name."""
    given = ("--data", f"{{data}}/{data}") if data else ()
    command = (*COOPLOC, "run", name, "--jobs", "{jobs}", "--out", f"{{runs}}/{name}", *given, *options, "{trials}")
    return Step(name, command, (data,) if data else ())


def tuning(name: str, budget: str, data: str = "") -> Step:
    """A tuning of a study, in the folder of its name."""
    given = ("--data", f"{{data}}/{data}") if data else ()
    command = (*COOPLOC, "tune", name, "--budget", budget, "--jobs", "{jobs}", "--out", f"{{runs}}/{name}", *given)
    return Step(name, command, (data,) if data else ())


def script(name: str, *arguments: str, recordings: tuple[str, ...] = ()) -> Step:
    """A page with a script of its own."""
    return Step(f"{name}.md", (PYTHON, str(HERE / f"{name}.py"), *arguments), recordings)


def simulated(name: str, page: str) -> Step:
    """A proof by simulation, with a script in benchmarks/statistics."""
    return Step(name, (PYTHON, str(HERE.parent / "benchmarks" / "statistics" / f"{name}.py"), str(HERE / page)))


def page(name: str, out: str = "", recordings: tuple[str, ...] = ()) -> Step:
    """A page made of a text."""
    out = out or f"{name}.md"
    return Step(out, (PYTHON, str(HERE / "page.py"), name, "{runs}", str(HERE / out)), recordings)


RUNS = (  # with all processes
    study("quick"), study("own-filter"), study("information"), study("sensitivity"), study("reasons"), study("gbp"),
    study("sightings"), study("fixed-weights", "--seed", "7"), study("vague-start"), study("uwb"),
    study("mrclam", data="mrclam6"), study("wifi-priors", data="wifi-rssi"), study("fusion"),
    study("readings", "--trials", "24"), study("paper"),
    Step("without-scalability", (*COOPLOC, "run", str(HERE / "without-scalability.toml"), "--until-decided", "--jobs",
                                 "{jobs}", "--out", "{runs}/without-scalability")),
    tuning("paper-fair", "120"), tuning("paper-fair-mrclam", "120", data="mrclam6"),
    simulated("rates", "statistics.md"), simulated("stopping", "statistics.md"),
)  # fmt: skip
PAGES = (  # the longest first
    script("reproduced", "{runs}", "{data}"),
    script("paper_figures", "{runs}/paper"),
    Step("paper", (*COOPLOC, "report", "{runs}/paper", "-o", str(HERE / "paper"))),
    script("fusion", "{runs}/fusion", "{data}/mrclam6", recordings=("mrclam6",)),
    script("until_decided", "{runs}/without-scalability", str(HERE)),
    script("readings", "{runs}/readings"),
    script("information", "{runs}/information"), script("sensitivity", "{runs}/sensitivity"), script("audit", "40"),
    script("tuned", "{runs}/paper-fair", "{runs}/paper-fair-mrclam"),
    script("real_robots", "{data}", "{runs}/uwb", "{runs}/mrclam", recordings=("mrclam6", "wifi-rssi")),
    simulated("truth", "truth.md"),
    page("own-filter"), page("gbp"), page("sightings"), page("vague-start"), page("fixed-weights"),
    page("wifi", recordings=("wifi-rssi",)),
    Step("figures", (PYTHON, str(HERE / "small_figures.py"), "{runs}", str(HERE))),
)  # fmt: skip
LAST = (  # with numbers and a figure of other pages
    page("paper", "paper/README.md"),
    Step("summary.pdf", (PYTHON, str(HERE / "summary.py"), "{runs}", str(HERE / "paper"))),
    page("first-sentences", "../README.md"),
)
STEPS = (*RUNS, *PAGES, *LAST)


def main() -> int:
    """Everything, or what is asked for."""
    parser = ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=Path, default=HERE.parent / "build" / "reports", help="folder of the runs")
    recordings = os.environ.get("COOPLOC_DATA", "../shared/data")
    parser.add_argument("--data", type=Path, default=recordings, help="folder of the recordings")
    parser.add_argument("--jobs", type=int, default=2, help="number of processes of a run")
    parser.add_argument("--only", default="", help="names of steps, separated by commas")
    parser.add_argument("--trials", default="", help="of every run, for a try")
    asked = parser.parse_args()
    wanted = set(asked.only.split(",")) if asked.only else {step.name for step in STEPS}
    if unknown := wanted - {step.name for step in STEPS}:
        parser.error(f"no step {sorted(unknown)[0]!r}; there are {', '.join(step.name for step in STEPS)}")
    asked.runs.mkdir(parents=True, exist_ok=True)
    table = Table("step", "minutes", "", title="What was made")
    for steps, at_once in ((RUNS, 1), (PAGES, asked.jobs), (LAST, asked.jobs)):
        with ThreadPoolExecutor(at_once) as pool:
            for row in pool.map(lambda step: _made(step, asked), (step for step in steps if step.name in wanted)):
                table.add_row(*row)
    Console().print(table)
    return int("failed" in table.columns[-1].cells)


def _made(step: Step, asked: Namespace) -> tuple[str, str, str]:
    """Run a step: its name, the minutes that it took, and how it ended."""
    absent = [name for name in step.recordings if not (asked.data / name).exists()]
    if absent:
        return step.name, "", f"left out: {asked.data / absent[0]} is not there"
    print(f"== {step.name}", file=sys.stderr, flush=True)
    began, at = time.monotonic(), time.time()
    code = subprocess.run(_command(step, asked), check=False, env={**os.environ, "PYTHONWARNINGS": "ignore"}).returncode
    ended = "failed" if code else ""
    last = asked.runs / step.name / "table.csv"  # that a run writes; a crash ends with the same code and without it
    if code == 1 and "run" in step.command and last.exists() and last.stat().st_mtime >= at:
        ended = "with trials that failed"
    return step.name, f"{(time.monotonic() - began) / 60:.1f}", ended


def _command(step: Step, asked: Namespace) -> list[str]:
    """With what is asked for in its places."""
    places = {"runs": asked.runs, "data": asked.data, "jobs": asked.jobs}
    command = [part.format(**places) for part in step.command if part != "{trials}"]
    return [*command, "--trials", asked.trials] if asked.trials and "{trials}" in step.command else command


if __name__ == "__main__":
    sys.exit(main())

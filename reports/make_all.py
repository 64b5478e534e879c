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
    after: tuple[str, ...] = ()  # steps that it waits for, beside the runs that its command names

    def waits_for(self) -> set[str]:
        """Names of the steps that are to be made before it."""
        if "{runs}" in self.command:
            return {step.name for step in RUNS}
        named = {part.removeprefix("{runs}/") for part in self.command if part.startswith("{runs}/")}
        return {*named, *self.after} - {self.name}


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
    return Step(name, (PYTHON, str(BENCHMARKS / "statistics" / f"{name}.py"), str(HERE / page)))


def reliability(name: str, *arguments: str) -> Step:
    """A section of the page on reliability, with a script in benchmarks/reliability."""
    script = str(BENCHMARKS / "reliability" / f"{name}.py")
    return Step(" ".join((name, *arguments)), (PYTHON, script, str(HERE / "reliability.md"), *arguments))


def page(name: str, out: str = "", recordings: tuple[str, ...] = ()) -> Step:
    """A page made of a text, or the part of the README that is."""
    out = out or f"{name}.md"
    command = (PYTHON, str(HERE / "page.py"), name, "{runs}", str(HERE / out))
    return Step(name if out == "../README.md" else out, command, recordings)


ALONE = (Step("speed.md", (PYTHON, str(BENCHMARKS / "speed.py"), str(HERE / "speed.md"))),)  # on an idle machine
RUNS = (  # the longest first
    study("paper"),
    Step("without-scalability", (*COOPLOC, "run", str(HERE / "without-scalability.toml"), "--until-decided",
                                 "--max-trials", "320", "--jobs", "{jobs}", "--out", "{runs}/without-scalability")),
    study("readings", "--trials", "24"), study("fusion"),
    tuning("paper-fair", "120"), tuning("paper-fair-mrclam", "120", data="mrclam6"),
    simulated("rates", "statistics.md"), study("reasons"), study("information"), study("sensitivity"), study("gbp"),
    study("mrclam", data="mrclam6"), study("sightings"), study("fixed-weights", "--seed", "7"), study("vague-start"),
    study("uwb"), study("wifi-priors", data="wifi-rssi"), study("own-filter"), study("quick"),
)  # fmt: skip
PAGES = (  # those that wait for the study `paper` last; of the others the longest first
    reliability("crash_matrix", "jobs 2"), reliability("crash_matrix", "Dask"), reliability("crash_matrix", "jobs 1"),
    script("fusion", "{runs}/fusion", "{data}/mrclam6", recordings=("mrclam6",)),
    reliability("damage"), reliability("isolation_price"), reliability("report_size"),
    simulated("truth", "truth.md"), simulated("stopping", "statistics.md")._replace(after=("rates",)),
    script("until_decided", "{runs}/without-scalability", str(HERE)),
    script("readings", "{runs}/readings"),
    script("information", "{runs}/information"), script("sensitivity", "{runs}/sensitivity"), script("audit", "40"),
    script("tuned", "{runs}/paper-fair", "{runs}/paper-fair-mrclam"),
    script("real_robots", "{data}", "{runs}/uwb", "{runs}/mrclam", recordings=("mrclam6", "wifi-rssi")),
    page("own-filter"), page("gbp"), page("sightings"), page("vague-start"), page("fixed-weights"),
    page("wifi", recordings=("wifi-rssi",)),
    Step("figures", (PYTHON, str(HERE / "small_figures.py"), "{runs}", str(HERE))),
    script("reproduced", "{runs}", "{data}"), script("paper_figures", "{runs}/paper"),
    Step("paper/index.html", (*COOPLOC, "report", "{runs}/paper", "-o", str(HERE / "paper"))),
)  # fmt: skip
LAST = (  # with numbers and a figure of other pages
    page("paper", "paper/README.md"),
    Step("summary.pdf", (PYTHON, str(HERE / "summary.py"), "{runs}", str(HERE / "paper"))),
    page("first-sentences", "../README.md"),
    page("speeds", "../README.md"),
    Step("speed-notes", (PYTHON, str(HERE / "page.py"), "speed-notes", "{runs}", str(HERE / "speed.md"))),
)
STEPS = (*ALONE, *RUNS, *PAGES, *LAST)


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
                before = [begun[name] for name in step.waits_for() if name in begun]
                begun[step.name] = pool.submit(_made, step, asked, asked.jobs // at_once, before)
        for row in begun.values():
            table.add_row(*row.result())
    Console().print(table)
    return int("failed" in table.columns[-1].cells)


def _made(step: Step, asked: Namespace, jobs: int, before: Sequence["Future[Any]"] = ()) -> tuple[str, str, str]:
    """Run a step with so many processes after others: its name, the minutes that it took, and how it ended.

    What it waits for was begun before it, so that no two wait for each other.
    """
    wait(before)
    absent = [name for name in step.recordings if not (asked.data / name).exists()]
    if absent:
        return step.name, "", f"left out: {asked.data / absent[0]} is not there"
    log = asked.runs / "logs" / f"{step.name.replace('/', '-')}.txt"
    log.parent.mkdir(parents=True, exist_ok=True)
    _say(f"{step.name} begins; what it prints is in {log}")
    began, at = time.monotonic(), time.time()
    with log.open("w", encoding="utf-8") as out:
        command, quiet = _command(step, asked, jobs), {**os.environ, "PYTHONWARNINGS": "ignore"}
        code = subprocess.run(command, check=False, env=quiet, stdout=out, stderr=out).returncode
    ended = "failed" if code else ""
    last = asked.runs / step.name / "table.csv"  # that a run writes; a crash ends with the same code and without it
    if code == 1 and "run" in step.command and last.exists() and last.stat().st_mtime >= at:
        ended = "with trials that failed"
    minutes = f"{(time.monotonic() - began) / 60:.1f}"
    _say(f"{step.name} took {minutes} minutes" + (f" and ended: {ended}, see {log}" if ended else ""))
    return step.name, minutes, ended


def _say(what: str) -> None:
    print(f"{time.strftime('%H:%M')} {what}", file=sys.stderr, flush=True)


def _command(step: Step, asked: Namespace, jobs: int) -> list[str]:
    """With what is asked for in its places."""
    places = {"runs": asked.runs, "data": asked.data, "jobs": jobs}
    command = [part.format(**places) for part in step.command if part != "{trials}"]
    return [*command, "--trials", asked.trials] if asked.trials and "{trials}" in step.command else command


if __name__ == "__main__":
    sys.exit(main())

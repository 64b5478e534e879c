"""Is `cooploc report` linear in the number of trials, and bounded in memory?

Run: python benchmarks/reliability/report_size.py [reports/reliability.md]. Prints its section of the report, or puts it
there. Three estimators in a short scenario; each report is made by a process of its own, whose memory is its largest.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from sections import put

TRIALS = 1000, 3000, 10_000
STUDY = """
trials = {trials}
scenarios = ["robots-1-3/n=2[ticks=3]"]
estimators = ["dead-reckoning", "ekf-local", "ekf-ci"]
"""


class Took(NamedTuple):
    """What a command took."""

    seconds: float  # of the processor
    memory: float  # [MB] at its largest


def main(report: str = "") -> None:
    with tempfile.TemporaryDirectory() as folder:
        found = {trials: measured(Path(folder), trials) for trials in TRIALS}
    lines = ["## Reports of many trials", "", "Seconds are those of the processor.", ""]
    lines += ["| trials | report [s] | memory [MB] |", "| ---: | ---: | ---: |"]
    lines += [f"| {trials} | {took.seconds:.1f} | {took.memory:.0f} |" for trials, took in found.items()]
    put(Path(report), "report", "\n".join(lines)) if report else print("\n".join(lines))


def measured(folder: Path, trials: int) -> Took:
    """What the report of a run with so many trials takes."""
    (folder / "many.toml").write_text(STUDY.format(trials=trials))
    command(folder, "run", "many.toml", "--out", f"run{trials}")
    return command(folder, "report", f"run{trials}")


def command(folder: Path, *arguments: str) -> Took:
    path = os.pathsep.join(filter(None, (os.getcwd(), os.environ.get("PYTHONPATH", ""))))
    started = subprocess.Popen(
        [sys.executable, "-m", "cooploc", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, used = os.wait4(started.pid, 0)
    started.returncode = os.waitstatus_to_exitcode(status)
    if started.returncode:
        sys.exit(f"cooploc {' '.join(arguments)} ended with exit code {started.returncode}")
    return Took(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)


if __name__ == "__main__":
    main(*sys.argv[1:])

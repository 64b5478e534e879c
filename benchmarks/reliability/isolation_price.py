"""What it costs that a plug-in has processes of its own, as a ratio to the same run in one process.

Run: python benchmarks/reliability/isolation_price.py [reports/reliability.md [rounds]]. Prints its section of the
report, or puts it there. The study is `quick` with one more estimator, which is the built-in `arl` under a plug-in's
name. Both kinds of run take turns, each in a new process that has imported and compiled everything. What a run of one
trial takes more is the start of the plug-in's process, and is given apart. A ratio of 1.1 is ten percent. Seconds are
those of the processor, of all processes together: one waits for the other, and what else the machine does counts for
nothing.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from sections import put

PLUGIN = "from cooploc.estimators.arl import Arl\n\nclass Mine(Arl):\n    pass\n"
MEASURE = """
import sys
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
import cooploc as cl
from cooploc.scenarios.processes.workers import end_all
names = "arl,mrsl-rssi,ekf-joint,mine.py:Mine"
run = lambda out, **options: cl.run_study("quick", estimators=names, out=out, check=False, **options)
def took(what):
    before = spent(); what(); end_all(); return spent() - before
def spent():
    return sum(each.ru_utime + each.ru_stime for each in map(getrusage, (RUSAGE_SELF, RUSAGE_CHILDREN)))
run("warm", trials=1, isolate=False)
isolate = sys.argv[1] == "isolated"
print(*(took(lambda: run(str(trials), trials=trials, isolate=isolate)) for trials in (1, 20)), file=sys.stderr)
"""


def main(report: str = "", rounds: str = "3") -> None:
    found: dict[str, list[tuple[float, float]]] = {"isolated": [], "together": []}
    for _ in range(int(rounds)):
        for mode, took in found.items():
            took.append(measured(mode))
    (start, apart), (begun, together) = (map(median, zip(*took, strict=True)) for took in found.values())
    start -= begun  # what one trial takes more
    text = "\n".join(
        [
            "## The price of isolation",
            "",
            f"`quick` with one plug-in, medians of {rounds} runs of each kind, in seconds of the processor,",
            "all processes together. The start is what a run of one trial takes more when it is isolated.",
            "",
            "| | |",
            "| --- | ---: |",
            f"| in one process [s] | {together:.2f} |",
            f"| isolated [s] | {apart:.2f} |",
            f"| of that, the start [s] | {start:.2f} |",
            f"| ratio | {apart / together:.2f} |",
            f"| ratio without the start | {(apart - start) / together:.2f} |",
        ]
    )
    put(Path(report), "price", text) if report else print(text)


def measured(mode: str) -> tuple[float, float]:
    """Seconds of the processor of a run of one trial, and of twenty."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "mine.py").write_text(PLUGIN)
        path = os.pathsep.join(filter(None, (os.getcwd(), os.environ.get("PYTHONPATH", ""))))
        command = [sys.executable, "-c", MEASURE, mode]
        env = {**os.environ, "PYTHONPATH": path}
        ended = subprocess.run(command, cwd=folder, env=env, stderr=subprocess.PIPE, text=True, check=True)
    one, twenty = ended.stderr.split()[-2:]
    return float(one), float(twenty)


if __name__ == "__main__":
    main(*sys.argv[1:])

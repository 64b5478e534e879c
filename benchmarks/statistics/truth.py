"""What was tried to get past the checks, what caught it, what is known to pass and why.

Run: python benchmarks/statistics/truth.py REPORT. Exit code 1 where something is not caught that should be, or where
the comparison of seeds accuses more honest estimators than it may.
"""

import inspect
import re
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from cooploc.analysis.execution import secret_seed
from cooploc.analysis.execution.provenance import provenance
from cooploc.estimators import make
from cooploc.scenarios import simulate
from cooploc.scenarios.processes.workers import end_all
from cooploc.scenarios.runner.run import run

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "helpers"))
catching, cheats = map(import_module, ("catching", "cheats"))
HONEST = "dead-reckoning", "ekf-local", "ekf-naive", "mrsl-rssi[particles=50]"
POOL, DRAWS = 200, 20_000  # trials of each honest estimator, and certificates drawn from them
PASSES = (
    ("Native code that scans memory", "a compiled extension can read what Python does not show, of its own process; the"
     " truth and rivals are in other processes, its own readings of later ticks are not"),
    ("Reading later ticks, or undeclared channels, in most trials but not in those that are drawn", "the stream lies in"
     " the estimator's process as a whole; only the random trials and ticks of a certificate look"),
    ("Attacks on other processes of the same user", "reading /proc, tracing the parent, or writing into the run"
     " directory: processes are separate, but not users; no sandbox of the operating system is used"),
    ("A result that travels back as crafted bytes", "what a worker returns is read with pickle; one that replaces the"
     " library's own pickling there can run code in the measuring process"),
    ("A table of the truth of a recording, made before and kept beside the plug-in", "files of its own may be read;"
     " their hashes stand in the certificate. Of a simulated world the secret seed shows it"),
    ("Undoing the guard, or asking from another thread, process or native library", "the audit hook sees what Python"
     " does in the thread that runs the estimator; its own variables are Python's, too"),
    ("Knowing the seed and gaining little by it", "the comparison of seeds sees what a dozen trials each can show:"
     " errors that are slightly smaller pass"),
    ("The team's own bytes", "where one object holds the whole team, the runner carries no packets; tables say that"
     " bytes are as declared"),
    ("A plug-in scenario, a recording, --no-isolate, --no-check", "its code makes the truth in the estimator's process;"
     " a recording has no other seed; the others are asked for, and said"),
    ("A result that depends on the hash seed in two ways only", "a certificate and the trials that run again see few"
     " hash seeds: one bit of dependence passes each of them in half of the cases"),
    ("Data on the network", "only files that Python opens are noted, no sockets and no files that native code opens"),
)  # fmt: skip


def main(out: str) -> int:
    """Try everything, write the report."""
    began = time.perf_counter()
    found = {name: catching.caught(name) for name in catching.GALLERY}
    end_all()
    falsely = {name: accusations(name) for name in HONEST}
    text = report(found, falsely)
    Path(out).write_text(text, encoding="utf-8")
    print(f"{time.perf_counter() - began:.0f} s", file=sys.stderr)
    return int(not all(one.caught for one in found.values()) or max(falsely.values()) > secret_seed.LEVEL)


def accusations(name: str) -> float:
    """The share of honest certificates of two worlds in which some comparison of seeds accuses, by simulation."""
    truth, stream = simulate(catching.WORLD, trials=POOL, seed=12345)
    traced = run({name: make(name)}, stream).traces[name]
    rmse = np.sqrt(((traced.x[..., :2] - truth.x[..., :2]) ** 2).sum(-1).mean((1, 2)))
    rng = np.random.default_rng(1)
    k = secret_seed.TRIALS
    drawn = np.stack([rng.permutation(rmse)[: 2 * k] for _ in range(2 * DRAWS)])
    tested = stats.mannwhitneyu(drawn[:, :k], drawn[:, k:], alternative="less", method="exact", axis=1)
    return float((tested.pvalue.reshape(DRAWS, 2) < secret_seed.LEVEL / 2).any(1).mean())


def report(found: dict[str, Any], falsely: dict[str, float]) -> str:
    """The tables."""
    made, caught = provenance(), sum(one.caught for one in found.values())
    lines = [
        "# What was tried, what caught it, and what is known to pass",
        "",
        "Accidents and cheap deceptions (tests/helpers/cheats) that small streams do not show, each against the",
        "check that is meant for it. Those that small streams do show are in tests/helpers/broken.py.",
        "Made by `make truth`.",
        "",
        f"{made['cpu']}; cooploc {made['versions']['cooploc']}, numpy {made['versions']['numpy']}.",
        "",
        f"{caught} of {len(found)} were caught.",
        "",
        "| tried | what it does | what catches it | caught | what was said |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, one in found.items():
        about = (inspect.getdoc(cheats.cheat(name)) or "").partition("\n\n")[0].replace("\n", " ")
        meant = catching.GALLERY[name]
        lines.append(f"| `{name}` | {about} | {meant} | {'yes' if one.caught else 'no'} | {_cell(one.said)} |")
    lines += ["", "## Are honest estimators accused of knowing the seed?", ""]
    lines += [
        f"{DRAWS} certificates of two worlds each, {secret_seed.TRIALS} trials against {secret_seed.TRIALS}, drawn",
        f"from {POOL} trials of `{catching.WORLD}`. The test is exact: in theory the share is at most",
        f"{secret_seed.LEVEL:g}.",
        "",
        "| estimator | accused |",
        "| --- | ---: |",
        *(f"| `{name}` | {share:.5f} |" for name, share in falsely.items()),
    ]
    lines += ["", "## What is known to pass, and why", "", "| what | why |", "| --- | --- |"]
    return "\n".join([*lines, *(f"| {what} | {why} |" for what, why in PASSES)]) + "\n"


def _cell(said: str) -> str:
    """One line without paths of this machine."""
    return re.sub(r"/\S+/", "", said.replace("|", "/").replace("\n", " "))[:160]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))

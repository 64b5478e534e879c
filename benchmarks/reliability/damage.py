"""Harm to files, death at every file operation, and requests beyond all bounds: what is lost, what is said?

Run: python benchmarks/reliability/damage.py [reports/reliability.md]. Prints its section of the report, or puts it into
the report in place of the one that is there; `make reliability` makes the whole report. Commands run in
processes that are forked once everything is imported.
"""

import os
import random
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from resource import RUSAGE_SELF, getrusage

from matplotlib import use
from sections import put

import cooploc.runs
import cooploc.terminal.finished_runs
from cooploc.__main__ import main
from cooploc.analysis.execution.execute import execute
from cooploc.analysis.execution.stored_run import read
from cooploc.analysis.metrics.statistics import change_bca
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios import simulate
from cooploc.scenarios.stream import Stream
from cooploc.scenarios.studies.study import load

FLIPS, GARBAGE = 400, 60
TINY = 'trials = 2\nscenarios = ["robots-1-3/n=2[ticks=3]"]\nestimators = ["dead-reckoning", "ekf-local"]\n'
WATCHED = {"open", "os.mkdir", "os.rename", "os.remove", "os.listdir", "os.scandir"}
BOUNDS = {
    "`robots-1-3/n={1..1e9}`": ('scenarios = ["robots-1-3/n={1..1e9}"]', ()),
    "`arena-60m/sd={nan..3}`": ('scenarios = ["arena-60m/sd={nan..3}"]', ()),
    "`scalability/n=100000`": ('scenarios = ["scalability/n=100000"]', ()),
    "`scalability/n=9999`": ('scenarios = ["scalability/n=9999"]', ()),
    "`trajectory[side=1e308]`": ('scenarios = ["trajectory[side=1e308]"]', ()),
    "`trials = 10**12`": ("trials = 1000000000000", ()),
    "`time_limit = true`": ("time_limit = true", ()),
    "`--estimators ekf-local[gate=nan]`": ("", ("--estimators", "ekf-local[gate=nan]")),
    "`--estimators ekf-local[gate=-1]`": ("", ("--estimators", "ekf-local[gate=-1]")),
    "`--estimators ekf-local[gate=1,gate=2]`": ("", ("--estimators", "ekf-local[gate=1,gate=2]")),
    '`--estimators ""`': ("", ("--estimators", "")),
    "`--jobs 1000000000`": ("", ("--jobs", "1000000000")),
}


def forked(work: Callable[[], object], folder: Path) -> tuple[int, str, str]:
    """Exit code and output of something done in a process of its own."""
    child = os.fork()
    if not child:
        code = 70
        try:
            for number, name in ((1, "stdout"), (2, "stderr")):
                os.dup2(os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
            sys.stdout, sys.stderr = (open(number, "w", closefd=False) for number in (1, 2))  # noqa: SIM115
            work()
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
        except BaseException as e:
            print(f"Traceback: {type(e).__name__}: {e}", file=sys.stderr)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status), (folder / "stdout").read_text(), (folder / "stderr").read_text()


def command(folder: Path, *arguments: str, before: Callable[[], object] = lambda: None) -> tuple[int, str, str]:
    def work() -> None:
        before()
        os.chdir(folder)
        sys.argv = ["cooploc", *arguments]
        main()

    return forked(work, folder)


def flipped(file: Path, rng: random.Random) -> None:
    content = bytearray(file.read_bytes())
    content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    file.write_bytes(content)


def numbers(folder: Path) -> tuple[set[str], bool]:
    """Every row of a run, exactly, and whether some are missing."""
    kept = read(folder / "run")
    rows = kept.rows.drop(columns=["failure", "traceback"]).map(repr)
    return set(rows.to_csv(index=False).splitlines()), bool(kept.gaps)


def read_again(folder: Path, honest: set[str]) -> str:
    """What came of reading a run that was harmed."""
    try:
        rows, gaps = numbers(folder)
    except BadInput:
        return "one line"
    except Exception as e:
        return f"traceback: {type(e).__name__}"
    if not rows <= honest:
        return "OTHER NUMBERS"
    return "the same numbers" if rows == honest else "fewer, and said so" if gaps else "FEWER, UNSAID"


def shown(code: int, _: str, said: str) -> str:
    """What came of a command."""
    one = "one line" if said.count("\n") == 1 else "several lines"
    return "traceback" if "Traceback" in said or code not in (0, 1, 2) else one if code == 2 else "read"


def flips(whole: Path, folder: Path) -> list[str]:
    """A bit of a manifest, of a receipt, of a part; then of a stream's file."""
    honest, _ = numbers(whole)
    rows = []
    for kind in ("manifest.json", "receipts/*", "parts/*"):
        rng, found = random.Random(kind), Counter[str]()
        for _ in range(FLIPS):
            shutil.rmtree(folder / "run", ignore_errors=True)
            shutil.copytree(whole / "run", folder / "run")
            flipped(rng.choice(sorted((folder / "run").glob(kind))), rng)
            found[read_again(folder, honest)] += 1
        rows.append(f"| a bit of {kind} | {FLIPS} | {_counted(found)} |")
    return [*rows, _stream_flips(folder)]


def _stream_flips(folder: Path) -> str:
    _, stream = simulate("trajectory", trials=2, seed=1, ticks=3)
    file, rng, found = folder / "s.npz", random.Random(4), Counter[str]()
    stream.save(file)
    content = file.read_bytes()
    for _ in range(FLIPS):
        file.write_bytes(content)
        flipped(file, rng)
        try:
            loaded = Stream.load(file)
            same = loaded.hash == stream.hash and repr(loaded.world) == repr(stream.world)
            found["the same numbers" if same else "OTHER NUMBERS"] += 1
        except BadInput:
            found["one line"] += 1
        except Exception as e:
            found[f"traceback: {type(e).__name__}"] += 1
    return f"| a bit of a stream's file | {FLIPS} | {_counted(found)} |"


def garbage(folder: Path) -> str:
    """Directories of files with the right names and any content."""
    rng, found = random.Random(5), Counter[str]()
    for k in range(GARBAGE):
        place = folder / f"garbage{k}"
        (place / "parts").mkdir(parents=True)
        for name in ("manifest.json", "parts/a--b--00000000--00000-00001.parquet", "parts/x (1).parquet"):
            content = rng.choice(
                [b"", b"{}", b"[]", b'{"format": 1}', b'{"format": 2, "cells": []}', rng.randbytes(50)]
            )
            (place / name).write_bytes(content)
        found[shown(*command(folder, rng.choice(["show", "verdicts", "report"]), place.name))] += 1
    return f"| a directory of garbage | {GARBAGE} | {_counted(found)} |"


def deaths(folder: Path) -> str:
    """Kill a run just before each of its file operations; then go on."""
    went_on = 0
    for number in range(1, 1000):
        out = f"killed-{number}-"
        code, _, _ = command(folder, "run", "tiny.toml", "--out", out, before=lambda n=number, o=out: die_at(n, o))
        done = any((folder / out).glob("parts/*.parquet"))
        again, _, said = command(folder, "run", "tiny.toml", "--out", out)
        clean = not list((folder / out).rglob("*.tmp"))
        went_on += again == 0 and clean
        if again or not clean:
            print(f"operation {number}: {said}", file=sys.stderr)
        if done or code == 0:
            break
    return (
        f"killed before each of the {number} file operations up to the first part, {went_on} runs went on when they "
        "were started again, and left nothing behind"
    )


def die_at(number: int, folder: str) -> None:
    seen = 0

    def watch(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal seen
        seen += event in WATCHED and any(folder in str(each) for each in arguments[:2])
        if seen == number:
            os._exit(77)

    sys.addaudithook(watch)


def bounds(folder: Path) -> list[str]:
    rows = []
    for what, (line, arguments) in BOUNDS.items():
        key = line.partition(" ")[0]
        kept = [each for each in TINY.splitlines() if not key or not each.startswith(f"{key} ")]
        (folder / "large.toml").write_text("\n".join([line, *kept]))
        began = time.perf_counter()
        code, _, said = command(folder, "run", "large.toml", "--out", "large", *arguments)
        took = time.perf_counter() - began
        rows.append(f"| {what} | {code} | {took:.2f} | {said.strip().removeprefix('cooploc: ')} |")
    return rows


def bootstrap(folder: Path) -> list[str]:
    """Time and memory of the one interval that held trials x trials."""
    rows = []
    for trials in (1000, 10_000, 20_000):

        def work(n: int = trials) -> None:
            rng = random.Random(n)
            import numpy as np

            a, b = (np.array([rng.gammavariate(2, 1) for _ in range(n)]) for _ in range(2))
            before, began = getrusage(RUSAGE_SELF).ru_maxrss, time.perf_counter()
            change_bca(a, b)
            took, more = time.perf_counter() - began, getrusage(RUSAGE_SELF).ru_maxrss - before
            print(f"| {n} | {took:.1f} | {more / 1024:.0f} |")

        rows.append(forked(work, folder)[1].strip())
    return rows


def fuzzed() -> str:
    tests = sorted((Path(__file__).parents[2] / "tests" / "fuzzing").glob("test_*.py"))
    counts = {file.stem[5:].replace("_", " "): re.findall(r"@cases\((\d+)\)", file.read_text()) for file in tests}
    each = ", ".join(f"{name} {sum(map(int, found))}" for name, found in counts.items() if found)
    total = sum(int(n) for found in counts.values() for n in found)
    return f"{total} cases in `tests/fuzzing`, every time the same: {each}"


def _counted(found: Counter[str]) -> str:
    return ", ".join(f"{what} {count}" for what, count in found.most_common())


def part(folder: Path) -> str:
    (folder / "tiny.toml").write_text(TINY)
    whole = folder / "whole"
    whole.mkdir()
    forked(lambda: execute(load(str(folder / "tiny.toml")), whole / "run"), folder)
    killed, refused, resampled, junk = deaths(folder), bounds(folder), bootstrap(folder), garbage(folder)
    harmed = flips(whole, folder)  # in this process, whose threads no fork would survive
    lines = [
        "## Damage, death and bounds",
        "",
        "| harmed | cases | what came of it |",
        "| --- | ---: | --- |",
        *harmed,
        junk,
    ]
    lines += ["", f"Death: {killed}.", "", f"Fuzzing: {fuzzed()}.", ""]
    lines += ["| asked for | exit code | seconds | said |", "| --- | ---: | ---: | --- |", *refused, ""]
    head = ["| trials | seconds | more memory [MB] |", "| ---: | ---: | ---: |"]
    return "\n".join([*lines, "The bootstrap of one pair of estimators:", "", *head, *resampled]) + "\n"


if __name__ == "__main__":
    use("agg")
    _ = cooploc.runs, cooploc.terminal.finished_runs  # imported before the first fork
    with tempfile.TemporaryDirectory() as place:
        found = part(Path(place))
    put(Path(sys.argv[1]), "damage", found) if len(sys.argv) > 1 else print(found)
    sys.exit(any(bad in found for bad in ("OTHER NUMBERS", "UNSAID", "traceback")))

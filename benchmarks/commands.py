"""What a user waits for before anything is computed: `cooploc --help`, a warm `quick`, and what is compiled once.

Run: python benchmarks/commands.py [rounds]. Each command is a process of its own, with a new directory for its run; the
processor's seconds are those of all its processes, the clock's tell nothing where others use the machine.
"""

import os
import resource
import subprocess
import sys
import tempfile
from time import perf_counter
from typing import NamedTuple

import numpy as np


class Spent(NamedTuple):
    """By one command."""

    clock: float  # [s]
    processor: float  # [s]


def spent(*arguments: str, cache: str = "") -> Spent:
    """By `cooploc` with these arguments; a run's directory is thrown away; kernels are kept in `cache`."""
    with tempfile.TemporaryDirectory() as folder:
        place = ["--out", f"{folder}/run"] if arguments[0] == "run" else []
        before, start = _processor(), perf_counter()
        command = [sys.executable, "-m", "cooploc", *arguments, *place]
        kept = {"NUMBA_CACHE_DIR": cache} if cache else {}
        subprocess.run(command, check=True, capture_output=True, env={**os.environ, **kept})
        return Spent(perf_counter() - start, _processor() - before)


def compiling() -> Spent:
    """What `cooploc run quick` spends on two processes where nothing is compiled, beyond what a second one does."""
    with tempfile.TemporaryDirectory() as empty:
        cold, warm = (spent("run", "quick", "--jobs", "2", cache=empty) for _ in range(2))
    return Spent(*np.subtract(cold, warm).tolist())


def _processor() -> float:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return children.ru_utime + children.ru_stime


def main(rounds: int = 3) -> None:
    for _ in range(rounds):
        print("--help", spent("--help"), "quick", spent("run", "quick", "--jobs", "2"), "compiling", compiling())


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

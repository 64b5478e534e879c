"""How long a user waits: `cooploc --help`, and a warm `quick` study, by the clock.

Run: python benchmarks/commands.py [rounds]. Medians and ranges over the rounds, in seconds, each a process of its own.
"""

import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

COMMANDS = (
    ("cooploc --help [s] (at most)", ("--help",), 0.5),
    ("cooploc run quick --jobs 2, kernels cached [s] (at most)", ("run", "quick", "--jobs", "2", "--out"), 10.0),
)


def seconds(arguments: tuple[str, ...]) -> float:
    """Of one process; `--out` gets a new directory."""
    with tempfile.TemporaryDirectory() as folder:
        place = (str(Path(folder) / "run"),) if arguments[-1] == "--out" else ()
        start = perf_counter()
        subprocess.run([sys.executable, "-m", "cooploc", *arguments, *place], check=True, capture_output=True)
        return perf_counter() - start


def rows(rounds: int = 3) -> list[dict[str, Any]]:
    """Every row: what, ratio (seconds), low, high, target (at most)."""
    found = []
    for what, arguments, target in COMMANDS:
        seconds(arguments)  # warm
        taken = [seconds(arguments) for _ in range(rounds)]
        found.append({"what": what, "ratio": np.median(taken), "low": min(taken), "high": max(taken), "target": target})
    return found


if __name__ == "__main__":
    for row in rows(*map(int, sys.argv[1:])):
        print(f"{row['what']}: {row['ratio']:.2f} ({row['low']:.2f} to {row['high']:.2f}), target {row['target']:g}")

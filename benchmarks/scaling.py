"""How the cost of a robot and tick grows with its number of neighbours: seconds, and links evaluated.

Run: python benchmarks/scaling.py [rounds]. Every robot hears every other. `links` counts the readings of teammates that
are evaluated per robot and tick; `messages` what it sends. Seconds are the processor's, of `cl.run(..., jobs=1)`, the
median over the rounds. The slope is that of log seconds against log neighbours over the larger half of the teams, where
the part that does not depend on neighbours matters less, with the 95 % interval of the straight line fitted.
"""

import sys
from time import process_time
from typing import Any

import numpy as np
from scipy.stats import linregress, t

import cooploc as cl

NEIGHBOURS = (1, 2, 4, 9, 19, 39, 69, 99)
ESTIMATORS = ("arl", "mrsl-rssi", "mrsl-distance", "ctrn[weights=exact,audit=0]")
TICKS = 5
ROWS = 400  # robots times trials, about
LARGE = 4  # the teams that the slope is fitted to


def measure(name: str, neighbours: int, rounds: int) -> dict[str, Any]:
    """Per robot and tick."""
    n = neighbours + 1
    trials = max(1, ROWS // n)
    _, stream = cl.simulate(f"scalability/n={n}", trials=trials, seed=1, ticks=TICKS)
    mine, ticks = {name: cl.make(name)}, trials * n * TICKS
    cl.run(mine, stream.first_ticks(1))
    seconds = []
    for _ in range(rounds):
        start = process_time()
        trace = cl.run(mine, stream, jobs=1).traces[name]
        seconds.append((process_time() - start) / ticks)
    heard = stream.air.link.sum() if trace.messages.any() else 0
    return {"seconds": float(np.median(seconds)), "messages": trace.messages.sum() / ticks, "links": heard / ticks}


def rows(rounds: int = 3) -> list[dict[str, Any]]:
    """Every row: what, ratio (the slope), low, high, target (at most)."""
    found = []
    for name in ESTIMATORS:
        table = [measure(name, k, rounds) for k in NEIGHBOURS]
        found.append(slope(name, "seconds", table) | {"table": table})
        if table[-1]["links"]:
            found.append(slope(name, "links", table))
    return found


def slope(name: str, counted: str, table: list[dict[str, Any]]) -> dict[str, Any]:
    """The row of what was `counted`, fitted to the larger teams."""
    fit = linregress(np.log(NEIGHBOURS[-LARGE:]), np.log([each[counted] for each in table[-LARGE:]]))
    half = t.ppf(0.975, LARGE - 2) * fit.stderr
    what = f"slope of {counted}, {name}, {NEIGHBOURS[-LARGE]} to {NEIGHBOURS[-1]} neighbours (at most)"
    return {"what": what, "ratio": fit.slope, "low": fit.slope - half, "high": fit.slope + half, "target": 1.0}


def main(rounds: int = 3) -> None:
    for found in rows(rounds):
        print(f"{found['what']}: {found['ratio']:.2f} ({found['low']:.2f} to {found['high']:.2f})")
        if "table" not in found:
            continue
        print(f"{'neighbours':>12}{'microseconds':>14}{'links':>8}{'messages':>10}")
        for k, each in zip(NEIGHBOURS, found["table"], strict=True):
            print(f"{k:>12}{1e6 * each['seconds']:>14.1f}{each['links']:>8.1f}{each['messages']:>10.1f}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

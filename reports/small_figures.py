"""Draws the figures of the pages that are made of texts.

Run: python reports/small_figures.py RUNS [OUT], where RUNS is the folder of the run directories. What was not run is
left out, and said.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pandas as pd
from matplotlib.axes import Axes

import cooploc as cl

mpl.use("agg")
FIGURES: dict[str, tuple[str, Callable[[pd.DataFrame], Axes]]] = {
    "quick.png": ("quick", cl.plot.rmse),
    "own-filter.png": ("own-filter", cl.plot.tradeoff),
    "wifi.png": ("wifi-priors", cl.plot.rmse),
}


def main(runs: str, out: str = "reports") -> None:
    """Draw what there are runs for."""
    for name, (study, draw) in FIGURES.items():
        if not (Path(runs) / study).exists():
            print(f"{name}: {Path(runs) / study} is not there; cooploc run {study} --out {Path(runs) / study}")
            continue
        figure: Any = draw(cl.load_run(Path(runs) / study).rows).figure
        figure.savefig(Path(out) / name, dpi=160)


if __name__ == "__main__":
    main(*sys.argv[1:])

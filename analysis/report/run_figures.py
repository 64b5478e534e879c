"""The figures of a run's experiment, for its page and for a paper: sweeps, scenarios, and accuracy against cost."""

from collections.abc import Iterator
from typing import NamedTuple

import pandas as pd
from matplotlib.figure import Figure

from cooploc.analysis.plot import results, style
from cooploc.analysis.report.run_numbers import Labels, group_by_sweep

HOLLOW = "Hollow: over-confident; grey: centralised"
OVER = "Position RMSE over {} in {}; bands: 95 % intervals over trials. {}; broken lines: over-confident mostly."
DOTS = f"Position RMSE with 95 % intervals over trials. {HOLLOW}; dotted: the floor."
AGAINST = "Position RMSE against {} in {}, with 95 % intervals over trials. {}."
OTHERS = {
    "anees": "ANEES (grey band: consistent)",
    "bytes": "bytes (broken: the Pareto front)",
    "seconds": "time (broken: the Pareto front)",
}


class RunFigure(NamedTuple):
    """A figure of some rows of `compare`."""

    figure: Figure
    words: list[str]  # of its file's name
    caption: str
    rows: pd.DataFrame


def draw_experiment(
    rows: pd.DataFrame,
    drawn: list[str],
    costly: list[str],
    names: Labels,
    pens: results.Pens,
    medium: style.Style,
    kind: str = "",
) -> Iterator[RunFigure]:
    """Draw rows of `compare` with floors: every sweep, the scenarios `drawn` side by side, and those `costly` by cost.

    A `kind` of figure is drawn alone: "rmse", or one of `OTHERS`.
    """
    ended = dict(list(rows[rows["rmse"].notna()].groupby("scenario", sort=False)))
    labels, several = list(dict.fromkeys(rows["scenario"])), medium.width > 4
    for (family, parameter), group in group_by_sweep(labels).items() if kind in ("", "rmse") else ():
        part = rows[rows["scenario"].isin(group)]
        if parameter and part["rmse"].notna().any():
            figure = results.sweep_panels(part, pens, names.shorten, medium)
            yield RunFigure(figure, [family, parameter], OVER.format(parameter, family, HOLLOW), part)
    shown, across = [label for label in drawn if label in ended], 3 if several else 1
    for i in range(0, len(shown), across) if kind in ("", "rmse") else ():
        parts = [ended[label] for label in shown[i : i + across]]
        yield RunFigure(results.ranking(parts, pens, names.shorten, medium), ["rmse", shown[i]], DOTS, pd.concat(parts))
    for label in filter(ended.__contains__, costly if kind != "rmse" else ()):
        for others in [(kind,)] if kind else [tuple(OTHERS)] if several else [(other,) for other in OTHERS]:
            figure = results.scatter(ended[label], others, pens, names.shorten, medium)
            caption = AGAINST.format(", ".join(OTHERS[other] for other in others), label, HOLLOW)
            yield RunFigure(figure, ["-".join(others), label], caption, ended[label])

"""How a row of results is drawn: its marker with intervals, its curve, and its name in the legend.

Rows are those of `compare`, or of `summarize` with `consistency`, `centralised` and `bound`.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb

from cooploc.analysis.metrics.compare import summarize
from cooploc.analysis.metrics.consistency import consistency
from cooploc.analysis.metrics.errors import is_offline
from cooploc.analysis.metrics.ranking import is_refused
from cooploc.analysis.plot.style import BROKEN, DOTTED, GREY, OFFLINE, Look, band

Row = Mapping[Any, Any] | pd.Series
UNRANKED = " (failed a check)"


def drawable(errors: pd.DataFrame) -> pd.DataFrame:
    """The table of `summarize` with what decides how a row is drawn: `consistency`, `centralised` and `bound`."""
    standing = (
        errors.assign(offline=is_offline(errors))
        .groupby(["scenario", "estimator"], sort=False)[["centralised", "bound", "offline"]]
        .any()
    )
    table = summarize(errors)
    return table.assign(
        offline=standing["offline"].to_numpy(),
        consistency=consistency(table),
        centralised=standing["centralised"].to_numpy(),
        bound=standing["bound"].to_numpy(),
    )


def name_of(row: Row, name: str = "") -> str:
    """An estimator's name, or another one, and what keeps it from being ranked."""
    name = (name or str(row["estimator"])) + _standing(row)
    return name + UNRANKED * is_refused(row["certificate"])


def _standing(row: Row) -> str:
    if row.get("offline", False):
        return " (offline)"
    return " (bound)" if row["bound"] else " (centralised)" * bool(row["centralised"])


def colour_of(row: Row, look: Look) -> Any:
    """Centralised estimators are grey, in the shade that is theirs, and so are those that are offline."""
    return GREY if row["centralised"] and len(set(to_rgb(look.colour))) > 1 else look.colour


def _unlike_filters(row: Row) -> Any:
    """The line of what no robot could run: dotted where it is centralised, dots and dashes where it is offline."""
    return OFFLINE if row.get("offline", False) else DOTTED if row["centralised"] else None


def marker(ax: Axes, x: float, y: float, row: Row, look: Look, **more: Any) -> None:
    """A row's marker; hollow where it is over-confident."""
    colour = colour_of(row, look)
    face = "white" if row["consistency"] == "over-confident" else colour
    ax.plot(x, y, marker=look.marker, mfc=face, mec=colour, **{"ms": 6, "mew": 1.3, "zorder": 3, "ls": "none", **more})


def rmse_at(ax: Axes, place: float, row: Row, look: Look, vertical: bool = True) -> None:
    """A row's RMSE with its interval, at a place of the other axis."""
    ends, middle = [row["rmse_low"], row["rmse_high"]], [place, place]
    line = _unlike_filters(row) or "-"
    ax.plot(*((middle, ends) if vertical else (ends, middle)), color=colour_of(row, look), lw=1.6, ls=line)
    x, y = (place, row["rmse"]) if vertical else (row["rmse"], place)
    marker(ax, x, y, row, look)


def rmse_against(ax: Axes, other: str, row: Row, look: Look, scale: float = 1.0, label: str = "") -> None:
    """A row's RMSE over another of its numbers, each with its interval where it has one."""
    x, colour = scale * row[other], colour_of(row, look)
    ax.plot([x, x], [row["rmse_low"], row["rmse_high"]], color=colour, lw=1)
    if f"{other}_low" in row:
        ends = [scale * row[f"{other}_low"], scale * row[f"{other}_high"]]
        ax.plot(ends, [row["rmse"]] * 2, color=colour, lw=1)
    marker(ax, x, row["rmse"], row, look, label=label or None)


def curve(ax: Axes, rows: pd.DataFrame, x: str, look: Look, alpha: float = 0.15, label: str = "") -> None:
    """RMSE over `x` with its band; broken where most values are over-confident, and a marker at 25 values or so."""
    over = (rows["consistency"] == "over-confident").to_numpy()
    first = rows.iloc[0]
    colour = colour_of(first, look)
    line = _unlike_filters(first) or (BROKEN if over.mean() > 0.5 else look.line)
    band(ax, rows[x], rows["rmse_low"], rows["rmse_high"], colour, alpha)
    ax.plot(rows[x], rows["rmse"], color=colour, ls=line, lw=1.6, zorder=3)
    for row in rows.iloc[:: max(1, len(rows) // 25)].to_dict("records"):
        marker(ax, row[x], row["rmse"], row, look, ms=5, mew=1.2, zorder=4)
    face = "white" if over.all() else colour
    ax.plot([], [], color=colour, ls=line, marker=look.marker, mfc=face, label=label or name_of(first))


def span(part: pd.DataFrame, *columns: str) -> tuple[float, float]:
    """From the smallest to the largest finite value of some columns; nan where there is none."""
    values = part[list(columns)].to_numpy(float)
    values = values[np.isfinite(values)]
    return (float(values.min()), float(values.max())) if len(values) else (np.nan, np.nan)

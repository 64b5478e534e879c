"""RMSE of every estimator, and its RMSE against its consistency, with intervals over trials."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from cooploc.analysis.formats import counted
from cooploc.analysis.metrics.consistency import CONSERVATIVE, OVER_CONFIDENT
from cooploc.analysis.metrics.statistics import LEAST_TRIALS
from cooploc.analysis.plot import style
from cooploc.analysis.plot.marks import curve, drawable, marker, name_of, rmse_against, rmse_at, span
from cooploc.analysis.plot.swept import by_column, by_label
from cooploc.estimators.errors import BadInput

LETTER = 0.09  # [in] that a letter of a tick is wide
MOST_TICKS = 12  # of a sweep that are all named


def rmse(
    errors: pd.DataFrame,
    ax: Axes | None = None,
    over: str | None = None,
    floors: Mapping[str, float] | None = None,
) -> Axes:
    """Position RMSE of every estimator in every scenario, with 95 % intervals over trials; over a sweep as lines.

    Hollow markers are over-confident: their 95 % ellipses hold fewer true positions than they promise. Centralised
    estimators are grey.

    Args:
        errors: from `cl.errors`, one row per (scenario, estimator, trial, robot), or from `cl.sweep`.
        ax: where to draw; a new figure if None.
        over: the column with the swept parameter. Where not given, three labels or more such as "packet-drop/drop=0.7"
            that differ in their value alone are drawn as a sweep.
        floors: a bound below every scenario's error [m], by its label, drawn as a dotted line.

    Raises:
        BadInput: `over` is not a column of numbers, or several scenarios have the same one.

    """
    table = drawable(errors)
    table["floor"] = table["scenario"].map(dict(floors or {}))
    along = by_column(errors, table, over) if over else by_label(table)
    if along is not None:
        return _lines(along, ax)
    scenarios, estimators = (list(dict.fromkeys(table[column])) for column in ("scenario", "estimator"))
    width = min(14.0, max(6.5, 2.5 + 0.2 * len(scenarios) * (len(estimators) + 2)))
    upright = _upright(scenarios, (width - 3.0) / len(scenarios))
    longest = max(map(len, scenarios)) * 0.8 * LETTER if upright else 0.0
    ax = ax or style.new_axes(width, _height(len(estimators)) + longest)
    place = dict(
        zip(estimators, np.linspace(-0.3, 0.3, len(estimators)) if len(estimators) > 1 else [0.0], strict=True)
    )
    looks = style.session_looks(estimators)
    for row in table[table["rmse"].notna()].to_dict("records"):
        name = str(row["estimator"])
        rmse_at(ax, scenarios.index(row["scenario"]) + place[name], row, looks[name])
    for row in table.drop_duplicates("estimator").to_dict("records"):
        solid = {**row, "consistency": ""}
        marker(ax, np.nan, np.nan, solid, looks[str(row["estimator"])], label=name_of(row))
    if upright:
        ax.set_xticks(range(len(scenarios)), scenarios, rotation=90, fontsize="small")
    else:
        ax.set_xticks(range(len(scenarios)), [_over_lines(label) for label in scenarios])
    ax.set_xlim(-0.5, len(scenarios) - 0.5)
    lowest = table.groupby("scenario")["floor"].first().reindex(scenarios).to_numpy(float)
    ax.hlines(lowest, np.arange(len(scenarios)) - 0.4, np.arange(len(scenarios)) + 0.4, color="black", ls=style.DOTTED)
    for edge in range(1, len(scenarios)):
        ax.axvline(edge - 0.5, color=style.GRID, lw=1, zorder=0)
    style.logarithmic(ax.yaxis, *span(table, "rmse", "floor"))
    hollow = "; hollow: over-confident" * bool((table["consistency"] == "over-confident").any())
    style.finish(ax, "", "position RMSE [m]", _trials(table) + hollow, grid="y")
    style.legend(ax)
    return ax


def tradeoff(errors: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Accuracy against consistency: position RMSE over ANEES, each with its 95 % interval over trials.

    One scenario. In the grey band an estimator is neither over-confident nor conservative; right of it, its covariance
    is too small.

    Args:
        errors: from `cl.errors`, one row per (scenario, estimator, trial, robot).
        ax: where to draw; a new figure if None.

    Raises:
        BadInput: the errors are of more than one scenario.

    """
    table = drawable(errors)
    if table["scenario"].nunique() > 1:
        raise BadInput(f"a tradeoff shows one scenario, these errors have {table['scenario'].nunique()}: select one")
    ax = ax or style.new_axes(8.0, 0.9 + 0.27 * max(len(table), 10))
    looks = style.session_looks(table["estimator"])
    ax.axvspan(CONSERVATIVE, OVER_CONFIDENT, color=style.BAND, zorder=0)
    for row in table.to_dict("records"):
        rmse_against(ax, "anees", row, looks[str(row["estimator"])], label=name_of(row))
    style.logarithmic(ax.xaxis, *span(table, "anees", "anees_low", "anees_high"))
    xlabel = "ANEES (1 is consistent; grey: neither over-confident nor conservative)"
    style.finish(ax, xlabel, "position RMSE [m]", f"{table['scenario'].iloc[0]}, {_trials(table)}", grid="both")
    style.legend(ax)
    return ax


def _lines(table: pd.DataFrame, ax: Axes | None) -> Axes:
    """RMSE over the value of a sweep, with bands."""
    looks = style.session_looks(table["estimator"])
    ax = ax or style.new_axes(6.5, _height(len(looks)))
    for name, look in looks.items():
        rows = table[(table["estimator"] == name) & table["rmse"].notna()].sort_values("value", kind="stable")
        if len(rows):
            curve(ax, rows, "value", look, 0.15, name_of(rows.iloc[0]))
    if table["floor"].notna().any():
        floor = table.groupby("value")["floor"].first()
        ax.plot(floor.index, floor, color="black", ls=style.DOTTED, lw=1.2, label="floor")
    style.logarithmic(ax.yaxis, *span(table, "rmse", "floor"))
    values = sorted(set(table["value"]))
    if len(values) <= MOST_TICKS:
        ax.set_xticks(values, [f"{value:g}" for value in values])
    broken = "; broken: over-confident" * bool((table["consistency"] == "over-confident").any())
    above = f"{table['family'].iloc[0]}, {_trials(table)}{broken}"
    style.finish(ax, table["parameter"].iloc[0], "position RMSE [m]", above, grid="both")
    style.legend(ax)
    return ax


def _height(estimators: int) -> float:
    """Of a figure [in] beside which a legend of so many entries stands."""
    return max(4.0, 0.6 + 0.2 * estimators)


def _upright(scenarios: list[str], room: float) -> bool:
    """Whether the labels of scenarios are wider than their `room` [in], so that they would overlap."""
    widest = max((len(line) for label in scenarios for line in _over_lines(label).split("\n")), default=0)
    return widest * LETTER > room


def _trials(table: pd.DataFrame) -> str:
    trials = int(table["trials"].min())
    few = f", no intervals below {LEAST_TRIALS}"
    return counted(trials, "trial") + (few if trials < LEAST_TRIALS else ", 95 % intervals")


def _over_lines(label: str) -> str:
    """A scenario's label over several lines."""
    path, bracket, options = label.partition("[")
    return path.replace("/", "\n", 1) + (bracket and "\n[" + options.replace(",", ",\n"))

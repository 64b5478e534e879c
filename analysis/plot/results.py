"""Results of a study: RMSE by scenario, over a sweep, against consistency and cost, and relative to the baseline.

`rmse`, `tradeoff` and `pareto` take errors, for a screen. The others take a table of `compare` with a column `floor`,
in the style of a report's page or of a paper.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import groupby
from math import ceil
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from cooploc.analysis.metrics.consistency import CONSERVATIVE, OVER_CONFIDENT
from cooploc.analysis.metrics.ranking import is_refused
from cooploc.analysis.metrics.statistics import LEAST_TRIALS
from cooploc.analysis.metrics.sweeps import add_sweep
from cooploc.analysis.plot import style
from cooploc.analysis.plot.style import DOTTED, PAGE, Pen, Row, Style, draw_marker, name_of, set_log_scale, span
from cooploc.estimators.errors import BadInput, count_of
from cooploc.estimators.interface import Array

Pens = Mapping[str, Pen]
Short = Callable[[str], str]  # from an estimator's label to its name in a figure
RMSE = "position RMSE [m]"
SWEPT = {  # parameter -> what stands below its axis, where that is plainer
    "n": "robots",
    "a": "anchors",
    "drop": "share of packets that are lost",
    "r": "radio range [m]",
    "radio_range": "radio range [m]",
    "eta": "path-loss exponent",
    "assumed.eta": "assumed path-loss exponent",
    "shadowing": "sd of shadowing [dB]",
    "prior_sigma": "sd of the prior position [m]",
    "odometry_sigma": "sd of odometry per axis and step [m]",
    "ticks": "duration [ticks]",
    "prior_heading": "no compass: sd of the prior heading [rad]",
}
NAMES = {"anees": "ANEES (1 is consistent)", "bytes": "bytes per robot and tick", "seconds": "µs per robot and tick"}
LEAST = 3  # values from which a sweep is drawn as lines without being asked for
MOST_PANELS = 6  # of sweeps
TOGETHER = 6  # estimators that can still be distinguished in one panel
MOST = 24  # estimators of an overview
FIT = 48  # estimators on a page or in a legend; of more, those with the smallest errors and the baselines are drawn
LETTER = 0.09  # [in] that a letter of a tick is wide
KEY, KEY_LETTER = 0.45, 0.05  # [in] that a marker of a legend and a letter beside it are wide


# ------------------------------------------------------------------------------------------------ on a screen


def rmse(errors: pd.DataFrame, ax: Axes | None = None, floors: Mapping[str, float] | None = None) -> Axes:
    """Draw the position RMSE of every estimator in every scenario, with 95 % intervals over trials.

    Hollow markers are over-confident: their 95 % ellipses hold fewer true positions than they promise. Centralised
    estimators are grey. In a new figure many estimators in few scenarios are rows with their names. Three labels or
    more such as "packet-drop/drop=0.7" or "mrsl-rssi[particles=50]", that differ in their value alone, are drawn as a
    sweep, with lines; a new figure has a panel for each of up to six such sweeps.

    Args:
        errors: from `cl.errors` or `cl.sweep`.
        ax: where to draw; a new figure if None.
        floors: a bound below every scenario's error [m], by its label, drawn as a dotted line.

    """
    table = style.summarize_for_figures(errors)
    table["floor"] = table["scenario"].map(dict(floors or {}))
    along = _sweep(table, 1 if ax else MOST_PANELS)
    names = list(dict.fromkeys((table if along is None else along)["estimator"]))
    pens, height = style.session_pens(names), max(4.0, 0.6 + 0.2 * len(names))
    over_confident = bool((table["consistency"] == "over-confident").any())
    if along is not None:
        return _draw_sweeps(ax, along, pens, height, _about_trials(table) + "; broken: over-confident" * over_confident)
    above = _about_trials(table) + "; hollow: over-confident" * over_confident
    if ax is None and len(names) > TOGETHER and table["scenario"].nunique() <= LEAST:
        return _draw_in_rows(table, pens, above)
    ax = _draw_side_by_side(ax, table, pens, height, above)
    style.add_legend(ax)
    return ax


def _draw_sweeps(ax: Axes | None, along: pd.DataFrame, pens: Pens, height: float, about: str) -> Axes:
    """Draw curves over what is swept, a panel for each family."""
    families, name = along["family"].unique(), str(along["parameter"].iloc[0])
    across, size = min(len(families), 3), (6.5, height) if len(families) == 1 else (4.0, 3.2)
    axes = [ax] if ax else style.new_panels(len(families), across, size, sharey=True)
    for k, (one, family) in enumerate(zip(axes, families, strict=True)):
        draw_curves(one, along[along["family"] == family], pens)
        above = f"{family}, {about}" if len(families) == 1 else str(family)
        style.finish(one, SWEPT.get(name, name), RMSE * (k % across == 0), above)
    low, high = span(along, "rmse", "floor")
    if low > 0:
        axes[0].set_ylim(0.8 * low, 1.25 * high)
    if len(families) > 1:
        _add_note(axes[0], about)
    style.add_legend(axes[across - 1])
    return axes[0]


def _add_note(ax: Axes, text: str) -> None:
    """Write above all panels of a figure what holds for each."""
    figure: Any = ax.figure
    figure.suptitle(text, x=0.01, ha="left", fontsize="small", color="0.35")


def _draw_in_rows(table: pd.DataFrame, pens: Pens, above: str) -> Axes:
    """Draw many estimators as rows with their names, best on top, a panel for each of a few scenarios."""
    named = {str(row["estimator"]): name_of(row) for row in table.sort_values("failed").to_dict("records")}
    errors = np.log(table["rmse"]).groupby(table["estimator"]).mean().sort_values(ascending=False, na_position="first")
    rows = [wrap_label(named[str(name)], 55) for name in errors.index]
    parts = [part for _, part in table.groupby("scenario", sort=False)]
    size = max(3.5, 9.0 / len(parts)), 1.1 + (0.26 if any("\n" in row for row in rows) else 0.22) * len(rows)
    axes = style.new_panels(len(parts), len(parts), size, sharex=True, sharey=True)
    for ax, part in zip(axes, parts, strict=True):
        _draw_rows(ax, part, list(errors.index), pens)
        style.finish(ax, RMSE, above=str(part["scenario"].iloc[0]), grid="both")
    axes[0].set_yticks(range(len(rows)), rows, fontsize="small")
    set_log_scale(axes[0].xaxis, *span(table, "rmse", "floor"))
    _add_note(axes[0], above)
    return axes[0]


def _draw_rows(ax: Axes, part: pd.DataFrame, order: Sequence[str], pens: Pens) -> None:
    for row in part.to_dict("records"):
        style.draw_rmse(ax, order.index(row["estimator"]), row, pens[row["estimator"]], vertical=False)
    ax.axvline(part["floor"].iloc[0], color="black", lw=1.0, ls=DOTTED)
    ax.set_ylim(-0.6, len(order) - 0.4)


def _draw_side_by_side(ax: Axes | None, table: pd.DataFrame, pens: Pens, height: float, above: str) -> Axes:
    """Draw the estimators of every scenario in a column of their own, or in rows where names of columns overlap."""
    labels = list(dict.fromkeys(table["scenario"]))
    lines = [wrap_label(label) for label in labels]
    named = 3.0 + len(labels) * LETTER * max(len(line) for label in lines for line in label.split("\n"))
    width, rows = min(14.0, max(6.5, named, 2.5 + 0.2 * len(labels) * (len(pens) + 2))), named > 14.0
    size = (8.0, 1.0 + 0.1 * len(labels) * (len(pens) + 2)) if rows else (width, height)
    ax = ax or style.new_axes(*size)
    shift = dict(zip(pens, np.linspace(-0.3, 0.3, len(pens)) if len(pens) > 1 else [0.0], strict=True))
    for row in table[table["rmse"].notna()].to_dict("records"):
        place = labels.index(row["scenario"]) + shift[row["estimator"]]
        style.draw_rmse(ax, place, row, pens[row["estimator"]], vertical=not rows)
    _add_keys(ax, table, pens, name_of)
    for place, floor in enumerate(table.groupby("scenario", sort=False)["floor"].first()):
        (ax.vlines if rows else ax.hlines)(floor, place - 0.4, place + 0.4, color="black", ls=DOTTED)
        (ax.axhline if rows else ax.axvline)(place + 0.5, color=style.GRID, lw=1, zorder=0)
    if rows:
        ax.set_yticks(range(len(labels)), labels, fontsize="small")
        ax.set_ylim(len(labels) - 0.5, -0.5)
    else:
        ax.set_xticks(range(len(labels)), lines)
        ax.set_xlim(-0.5, len(labels) - 0.5)
    set_log_scale(ax.xaxis if rows else ax.yaxis, *span(table, "rmse", "floor"))
    style.finish(ax, *((RMSE, "") if rows else ("", RMSE)), above, grid="x" if rows else "y")
    return ax


def tradeoff(errors: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Draw position RMSE over ANEES in one scenario, each with its 95 % interval over trials.

    In the grey band an estimator is neither over-confident nor conservative; right of it, its covariance is too small.
    """
    table = style.summarize_for_figures(errors).assign(floor=np.nan)
    if table["scenario"].nunique() > 1:
        raise BadInput(f"a tradeoff shows one scenario, these errors have {table['scenario'].nunique()}: select one")
    ax = ax or style.new_axes(8.0, 0.9 + 0.27 * max(len(table), 10))
    pens = style.session_pens(table["estimator"])
    draw_against(ax, table, "anees", pens)
    _add_keys(ax, table, pens, name_of)
    xlabel = "ANEES (grey: neither over-confident nor conservative)"
    style.finish(ax, xlabel, RMSE, f"{table['scenario'].iloc[0]}, {_about_trials(table)}", grid="both")
    style.add_legend(ax)
    return ax


def pareto(errors: pd.DataFrame) -> Axes:
    """Draw position RMSE over the bytes that a robot sends in a tick, a panel for each scenario, and the frontier.

    The frontier joins the estimators that no other one beats in both error and bytes, of those that are neither
    over-confident (hollow) nor centralised (grey). The axes of the first scenario are returned.
    """
    table = style.summarize_for_figures(errors)
    table = table[table["rmse"].notna()].assign(floor=np.nan)
    parts = [part for _, part in table.groupby("scenario", sort=False)]
    pens, columns = style.session_pens(table["estimator"]), 2 if len(parts) == 1 else 3
    axes = style.new_panels(len(parts), 2, (3.6, 2.5), 0.2 * (ceil(len(pens) / columns) + 2), sharex=True)
    for ax, part in zip(axes, parts, strict=True):
        draw_against(ax, part, "bytes", pens)
        trials = count_of(int(part["trials"].min()), "trial")
        style.finish(ax, NAMES["bytes"], "RMSE [m]", f"{part['scenario'].iloc[0]}, {trials}", grid="both")
    _add_keys(axes[0], table, pens, name_of)
    if any(len(frontier(part)) > 1 for part in parts):
        axes[0].plot([], [], color="0.3", lw=1, ls=style.BROKEN, label="frontier")
    axes[0].plot([], [], "o", mfc="white", mec=style.DARK, label="hollow: over-confident")
    style.add_legend_below(axes, columns)
    return axes[0]


def frontier(table: pd.DataFrame, cost: str = "bytes") -> pd.DataFrame:
    """Return the rows that none beats in both cost and RMSE, by cost; what is not honest does not count."""
    dishonest = table["consistency"].isin(["over-confident", "over-wide"]) | table["certificate"].map(is_refused)
    able = table[~(dishonest | table["centralised"]).astype(bool)].sort_values([cost, "rmse"])
    return able[able["rmse"] < able["rmse"].cummin().shift(fill_value=np.inf)]


# ------------------------------------------------------------------------------------------------ on a page, in a paper


def _height(medium: Style) -> float:
    """Return the height [in] of a row of panels."""
    return max(2.1, 0.29 * medium.width)


def sweep_panels(part: pd.DataFrame, pens: Pens, short: Short, medium: Style = PAGE) -> Figure:
    """Draw RMSE over what rows of `add_sweep` sweep; of many estimators a panel for each method, the others in grey."""
    part = part.sort_values("value", kind="stable")
    names = [name for name in pens if name in set(part["estimator"])]
    methods = [list(mine) for _, mine in groupby(sorted(names, key=_method), _method)]
    methods.sort(key=lambda mine: names.index(mine[0]))
    shown = [mine[i : i + TOGETHER] for mine in methods for i in range(0, len(mine), TOGETHER)]
    shown = shown if len(names) > TOGETHER else [names]

    def draw(ax: Axes, mine: list[str]) -> None:
        single = len(mine) == 1 and len(shown) > 1  # its title is its name

        def name(row: Row) -> str:
            return "_" if single else short(row["estimator"])

        draw_curves(ax, part, {one: pens[one] for one in mine}, name, 0.22 if len(mine) == 1 else 0.1)
        if len(shown) > 1:
            ax.set_title(wrap_label(short(mine[0] if single else _method(mine[0])), 44))

    height = _height(medium) if len(shown) == 1 else max(1.15, 0.7 * medium.width / medium.across)
    entries = sum(len(mine) for mine in shown if len(shown) == 1 or len(mine) > 1)
    parameter = part["parameter"].iloc[0]
    labels = SWEPT.get(parameter, parameter), RMSE
    draws = [partial(draw, mine=mine) for mine in shown]
    return compose(draws, medium, (medium.width, height), labels, shared=True, entries=entries)


def _method(label: str) -> str:
    return label.partition("[")[0]


def ranking(parts: Sequence[pd.DataFrame], pens: Pens, short: Short, medium: Style = PAGE) -> Figure:
    """Draw RMSE of estimators with its interval, a panel for each scenario; smallest in the first on top.

    Of many estimators those with the smallest errors, and the baselines.
    """
    parts = [part[part["rmse"].notna()] for part in parts]
    every = list(dict.fromkeys(name for part in parts for name in part.sort_values("rmse")["estimator"]))
    kept = {*every[:FIT], *(name for part in parts for name in part["baseline"])}
    parts = [part[part["estimator"].isin(kept)] for part in parts]
    order = [name for name in every if name in kept][::-1]
    few = f", {len(order)} of {len(every)} estimators" * (len(order) < len(every))
    rows = [row for part in parts for row in part.to_dict("records")]
    unranked = {row["estimator"]: why for row in rows if (why := style.why_unranked(row))}
    titles = [wrap_label(str(part["scenario"].iloc[0]), int(18 * (medium.width - 1.4) / len(parts))) for part in parts]
    height = 0.55 + 0.17 * len(order) + 0.14 * (1 + max(title.count("\n") for title in titles))

    def draw(ax: Axes, part: pd.DataFrame, title: str) -> None:
        _draw_rows(ax, part, order, pens)
        set_log_scale(ax.xaxis, *span(part, "rmse", "floor"))
        ax.set_yticks(range(len(order)), [short(name) + unranked.get(name, "") for name in order])
        ax.set_title(title)

    draws = [partial(draw, part=part, title=title) for part, title in zip(parts, titles, strict=True)]
    return compose(draws, medium, (medium.width, height), (RMSE + few, ""), across=len(parts))


def scatter(part: pd.DataFrame, others: Sequence[str], pens: Pens, short: Short, medium: Style = PAGE) -> Figure:
    """Draw RMSE of estimators in one scenario against ANEES, bytes or seconds, a panel for each of `others`.

    Of many estimators those with the smallest errors, and the baseline.
    """
    part = part[part["rmse"].notna()]
    part = part[(part["rmse"].rank(method="first") <= FIT) | (part["estimator"] == part["baseline"])]

    def draw(ax: Axes, other: str) -> None:
        draw_against(ax, part[part[other].notna()], other, pens)
        ax.set(xlabel=NAMES[other].partition(" (")[0])
        if other == others[0]:
            _add_keys(ax, part, pens, lambda row: short(row["estimator"]))

    draws, size = [partial(draw, other=other) for other in others], (medium.width, _height(medium))
    entries = part["estimator"].nunique()
    return compose(draws, medium, size, ("", RMSE), shared=True, across=len(others), entries=entries)


def overview(table: pd.DataFrame, pens: Pens, short: Short) -> Figure:
    """Draw RMSE of every estimator relative to the baseline's, a mark for each scenario; the median smallest on top.

    Of many estimators those that ran in the most scenarios.
    """
    part = table[table["rmse"].notna() & (1 + table["change"] > 0) & (table["estimator"] != table["baseline"])]
    most = part["estimator"].value_counts().index[:MOST]
    part = part[part["estimator"].isin(most)].assign(ratio=1 + part["change"])
    ordered = part.groupby("estimator", sort=False)["ratio"].median().sort_values(ascending=False)

    def draw(ax: Axes) -> None:
        for y, (name, median) in enumerate(ordered.items()):
            for row in part[part["estimator"] == name].to_dict("records"):
                draw_marker(ax, row["ratio"], y, row, pens[str(name)], ms=5, mew=1)
            ax.plot([median, median], [y - 0.32, y + 0.32], color=style.DARK, lw=1.6, zorder=4)
        ax.axvline(1, color="black", lw=1.1, ls=DOTTED)
        first = part.drop_duplicates("estimator").set_index("estimator", drop=False)
        ax.set_yticks(range(len(ordered)), [name_of(first.loc[n], short(str(n))) for n in ordered.index])
        ax.set_ylim(-0.6, len(ordered) - 0.4)
        set_log_scale(ax.xaxis, *span(part, "ratio"))

    return compose([draw], PAGE, (PAGE.width, 0.8 + 0.17 * len(ordered)), ("position RMSE / that of the baseline", ""))


def compose(
    draws: Sequence[Callable[[Axes], None]],
    medium: Style,
    size: tuple[float, float],
    labels: tuple[str, str] = ("", ""),
    shared: bool = False,
    across: int = 0,
    entries: int = 0,
) -> Figure:
    """Draw panels into one figure, in a style.

    `size` [in] is the width of the figure and the height of a row of panels, `labels` are those of the axes, which
    panels have in common where `shared`; `across` panels stand side by side (as many as the style has where 0), above
    a legend of `entries`.
    """
    across = min(len(draws), across or medium.across)
    down = ceil(len(draws) / across)
    height = size[1] * down + 0.3 * (down > 1)
    with mpl.rc_context(medium.rc):
        figure = Figure(figsize=(size[0], height), layout="constrained")
        axes: Any = figure.subplots(down, across, sharey=True, sharex=shared and down > 1, squeeze=False)
        for k, (ax, draw) in enumerate(zip(axes.flat, draws, strict=False)):
            draw(ax)
            below, beside = k + across >= len(draws), ax in axes[:, 0]
            style.finish(ax, (ax.get_xlabel() or labels[0]) * below, labels[1] * beside, grid="both")
            ax.minorticks_off()  # a sixth of the time and of the page
            ax.tick_params(labelbottom=below)
            for line in ax.lines:
                line.set_markersize(min(line.get_markersize(), 4.5 if len(draws) <= 3 else 3.0))
        for ax in axes.flat[len(draws) :]:
            ax.remove()
        if entries:
            tight = {"fontsize": style.TEXT, "handlelength": 2.2, "columnspacing": 1.0, "labelspacing": 0.2}
            panels = axes.flat[: len(draws)]
            longest = max((len(label) for ax in panels for label in ax.get_legend_handles_labels()[1]), default=0)
            keys = max(1, min(entries, medium.keys, int(size[0] / (KEY + KEY_LETTER * longest))))
            style.add_legend_below(panels, keys, **tight)
            height += 0.15 * ceil(entries / keys)
        figure.set_size_inches(size[0], min(height, style.TALLEST))
    return figure


# ------------------------------------------------------------------------------------------------ panels


def draw_curves(
    ax: Axes, part: pd.DataFrame, pens: Pens, name: Callable[[Row], str] = name_of, alpha: float = 0.15
) -> None:
    """Draw the estimators that have a pen over the swept value with the floor; all others in light grey."""
    part, names = part.sort_values("value", kind="stable"), list(pens)
    for _, rows in part[~part["estimator"].isin(names)].groupby("estimator", sort=False):
        ax.plot(rows["value"], rows["rmse"], color=style.FAINT, lw=1, zorder=1)
    for one in names:
        rows = part[part["estimator"] == one]
        if len(rows):
            style.draw_curve(ax, rows, "value", pens[one], alpha, name(rows.iloc[0]))
    floor = part.groupby("value")["floor"].first().dropna()
    if len(floor):
        ax.plot(floor.index, floor, color="black", lw=1.1, ls=DOTTED, label="floor")
    low, high = span(part, "rmse", "floor")
    set_log_scale(ax.yaxis, low, high)
    if low > 0:  # the same for every panel, though a band may reach beyond
        ax.set_ylim(0.8 * low, 1.25 * high)
    values = places = np.unique(part["value"])
    if values[0] > 0 and len(values) > 2 and _evenness(np.log(values)) > _evenness(values):
        places = np.log(values)
        ax.set_xscale("log")
        ax.xaxis.set_minor_locator(NullLocator())
    if len(values) <= 8:
        apart = np.diff(places, append=np.inf) >= 0.07 * np.ptp(places)  # others would be written over each other
        ax.set_xticks(values, [f"{value:g}" * bool(far) for value, far in zip(values, apart, strict=True)])


def _evenness(values: Array) -> float:
    """Return the smallest distance of neighbours as a share of the whole range."""
    return float(np.diff(values).min() / np.ptp(values))


MOST_ANEES = 1e4  # beyond it a mark stands at the edge, with its number


def draw_against(ax: Axes, part: pd.DataFrame, other: str, pens: Pens) -> None:
    """Draw RMSE against ANEES, with the band of consistency, or against a cost with the frontier."""
    scale = 1e6 if other == "seconds" else 1.0
    low, high = (scale * end for end in span(part, other))
    if other == "anees":
        ax.axvspan(CONSERVATIVE, OVER_CONFIDENT, color=style.BAND, zorder=0)
    elif len(front := frontier(part, other)):
        ax.step(scale * front[other], front["rmse"], where="post", color="0.3", lw=1, ls=style.BROKEN, zorder=1)
    for row in part.to_dict("records"):
        pen, x = pens[row["estimator"]], scale * row[other]
        if other == "anees" and x > MOST_ANEES:
            far, x = f"{x:.0e}".replace("e+0", "e").replace("e+", "e"), MOST_ANEES
            ax.annotate(f"{far} →", (x, row["rmse"]), (-6, 2), textcoords="offset points", ha="right")
        bar: Any = {"color": style.colour_of(row, pen), "lw": 1}
        ax.plot([x, x], [row["rmse_low"], row["rmse_high"]], **bar)
        if f"{other}_low" in row:
            ax.plot([scale * row[f"{other}_low"], scale * row[f"{other}_high"]], [row["rmse"]] * 2, **bar)
        draw_marker(ax, x, row["rmse"], row, pen)
    if other == "bytes":  # some send nothing
        high = 1.6 * max(10.0, high)
        ax.set_xscale("symlog", linthresh=10)
        among = (1, 2, 5) if high < 1000 else (1,)
        ax.set_xticks([0, *(v for k in range(1, 9) for m in among if (v := m * 10**k) < high)])
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        ax.set_xlim(-2, high)
    else:
        set_log_scale(ax.xaxis, low, high)
        if other == "anees" and low > 0:  # intervals of heavy tails span many powers of ten
            ax.set_xlim(min(low / 1.4, 0.5), min(max(1.4 * high, 2.0), 1.4 * MOST_ANEES))
    set_log_scale(ax.yaxis, *span(part, "rmse", "floor"))


def _add_keys(ax: Axes, table: pd.DataFrame, pens: Pens, name: Callable[[Any], str]) -> None:
    """Add an entry of the legend for each estimator, with a full marker."""
    rows = table.drop_duplicates("estimator").set_index("estimator", drop=False)
    for row in (rows.loc[one].to_dict() for one in pens if one in rows.index):
        draw_marker(ax, np.nan, np.nan, {**row, "consistency": ""}, pens[row["estimator"]], label=name(row))


def _sweep(table: pd.DataFrame, most: int) -> pd.DataFrame | None:
    """Return the table with `family`, `parameter` and `value` where its labels sweep one parameter; else None.

    Of a sweep of estimators, each has the name that its family has. There are at `most` so many families.
    """
    estimators = add_sweep(table, "estimator")
    for read in (add_sweep(table), estimators.assign(estimator=estimators["family"], family=table["scenario"])):
        lengths = read.groupby("family")["value"].nunique()
        if read["parameter"].nunique() == 1 and lengths.min() >= LEAST and len(lengths) <= most:
            return read
    return None


def _about_trials(table: pd.DataFrame) -> str:
    trials = int(table["trials"].min())
    few = f", no intervals below {LEAST_TRIALS}"
    return count_of(trials, "trial") + (few if trials < LEAST_TRIALS else ", 95 % intervals")


def wrap_label(label: str, width: int = 0) -> str:
    """Return a label in lines of so many letters, parted after its family and after commas, and before brackets."""
    lines = [""]
    for piece in re.split(r"(?<=[,/])|(?=\[)", label):
        lines = [*lines[:-1], lines[-1] + piece] if len(lines[-1] + piece) <= width else [*lines, piece]
    return "\n".join(line.removesuffix("/") if width == 0 else line for line in lines if line)

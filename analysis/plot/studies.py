"""Figures of special studies: information, sensitivity, tuning, and a ledger of claims over all its readings."""

import textwrap
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from cooploc.analysis.claims.kinds import RELATIVE
from cooploc.analysis.claims.ledger import BASE
from cooploc.analysis.plot import style
from cooploc.analysis.plot.results import SWEPT, draw_curves
from cooploc.analysis.plot.style import draw_marker, draw_rmse, set_log_scale, span
from cooploc.estimators.errors import BadInput, count_of, nearest

OWN = {"none": "none", "doa": "direction of arrival", "gradient": "gradient", "rssi": "raw RSSI"}
BETWEEN = {"none": "none", "rssi": "RSSI", "range": "range"}
RULES = {  # (fusion, filter) -> name, and the estimator whose pen it has
    ("alone", "particles"): ("alone, particles", "arl"),
    ("alone", "Kalman"): ("alone, Kalman", "ekf-local"),
    ("product", "particles"): ("product of beliefs, particles", "mrsl-rssi"),
    ("intersection", "particles"): ("covariance intersection, particles", "ctrn"),
    ("intersection", "Kalman"): ("covariance intersection, Kalman", "ekf-ci"),
    ("centralised", "Kalman"): ("centralised, Kalman", "ekf-joint"),
    ("bound", "MAP"): ("bound, maximum a posteriori", "map-joint"),
}
GAP = 0.6  # between teams, in units of the x axis


def _require_table(given: object, made_by: str, column: str) -> None:
    if not isinstance(given, pd.DataFrame) or column not in given:
        raise BadInput(f"this draws what {made_by} returns; it was given something else, a {type(given).__name__}")


def information(table: pd.DataFrame) -> Axes:
    """Draw position RMSE with 95 % intervals in every cell of `cl.information`, and the cell's floor as a dotted line.

    A row for each own reading, on the same logarithmic scale; in it, from left to right, the teams, and what they read
    of each other. Hollow markers are over-confident; centralised estimators and the bound are grey. The axes of the
    first row are returned.
    """
    _require_table(table, "cl.information", "own")
    rows = [name for name in OWN if (table["own"] == name).any()]
    axes = style.new_panels(len(rows), 1, (7.2, 1.55), 1.1, sharex=True, sharey=True)
    teams = sorted(table["robots"].unique())
    there = table[["robots", "between"]].drop_duplicates().itertuples(index=False, name=None)
    cells = sorted(there, key=lambda cell: (cell[0], list(BETWEEN).index(cell[1])))
    places = {cell: i + GAP * teams.index(cell[0]) for i, cell in enumerate(cells)}  # teams stand apart
    pens = style.pens(one for _, one in RULES.values())
    set_log_scale(axes[0].yaxis, *span(table, "rmse", "floor"))
    for ax, name in zip(axes, rows, strict=True):
        own = table[table["own"] == name]
        for (robots, between), x in places.items():
            here = own[(own["robots"] == robots) & (own["between"] == between)]
            floor = here["floor"].min()
            if np.isfinite(floor):
                ax.plot([x - 0.42, x + 0.42], [floor, floor], color="black", ls=style.DOTTED, lw=1.6, zorder=1)
            shifts = 0.15 * (np.arange(len(here)) - (len(here) - 1) / 2)
            for shift, row in zip(shifts, here.to_dict("records"), strict=True):
                draw_rmse(ax, x + shift, row, pens[RULES[row["fusion"], row["filter"]][1]])
        style.finish(ax, "", "RMSE [m]", f"own reading: {OWN[name]}", grid="y")
    last, below = axes[-1], {"textcoords": "offset points", "va": "top"}
    last.set_xticks(list(places.values()), [BETWEEN[between] for _, between in places])
    last.tick_params(axis="x", length=0)
    corner: Any = {"xycoords": "axes fraction", "ha": "right", "fontsize": 8, **below}
    last.annotate("read of\nteammates", (0, 0), (-4, -3), **corner)
    for robots in teams:
        middle = float(np.mean([x for (n, _), x in places.items() if n == robots]))
        bold: Any = {"xycoords": ("data", "axes fraction"), "ha": "center", "weight": "bold", **below}
        last.annotate(count_of(robots, "robot"), (middle, 0), (0, -20), **bold)
    used = set(zip(table["fusion"], table["filter"], strict=True))
    for rule, (name, one) in RULES.items():
        if rule in used:
            full: dict[str, Any] = {"consistency": "", "centralised": rule[0] in ("centralised", "bound")}
            draw_marker(last, np.nan, np.nan, full, pens[one], label=name)
    last.plot([], [], color="black", ls=style.DOTTED, lw=1.6, label="floor of the readings in the cell")
    last.plot([], [], "o", mfc="white", mec=style.DARK, label="hollow: over-confident")
    style.add_legend_below(axes)
    return axes[0]


# ------------------------------------------------------------------------------------------------ sensitivity

MARGIN = 1.4  # of the scale beyond the smallest and largest error; wide bands leave the axes
WIDE = 20  # values over more than this factor have a logarithmic axis


def sensitivity(table: pd.DataFrame) -> Axes:
    """Draw position RMSE over each parameter of `cl.sensitivity`, with bands of 95 % intervals and the floor dotted.

    All panels have one logarithmic scale. A dashed vertical line is the preset's value, of an assumed parameter the
    true one. Hollow markers are over-confident, centralised estimators are grey. The first panel's axes are returned.
    """
    _require_table(table, "cl.sensitivity", "parameter")
    parameters = list(dict.fromkeys(table["parameter"]))
    axes = style.new_panels(len(parameters), 2, (3.6, 2.3), 0.5, sharey=True)
    for k, (ax, parameter) in enumerate(zip(axes, parameters, strict=True)):
        part = table[table["parameter"] == parameter]
        draw_curves(ax, part, style.session_pens(part["estimator"]), alpha=0.12)
        ax.axvline(part["preset"].iloc[0], color="0.5", ls=style.BROKEN, lw=1, zorder=0)
        ylabel = "position RMSE [m]" if k % 2 == 0 else ""
        style.finish(ax, SWEPT.get(parameter, parameter), ylabel, grid="both")
    low, high = span(table, "rmse", "floor")
    if low > 0:
        axes[0].set_ylim(low / MARGIN, high * MARGIN)
    style.add_legend_below(axes, 4)
    return axes[0]


# ------------------------------------------------------------------------------------------------ tuning

VALUE = "value: "  # before a parameter's name in the columns of `cl.tune(...).history`


def tuning(history: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Draw the gain of the best configuration so far, on training streams, against the trials that were used.

    `history` is that of `cl.tune`. The first mark of a line is the configuration as shipped, whose gain is 0. What
    is gained on training streams may be lost on fresh ones: the table of `cl.tune` has both.
    """
    _require_table(history, "cl.tune(...).history", "gain")
    ax = ax or style.new_axes(7.0, 4.0)
    for name, pen in style.session_pens(history["estimator"]).items():
        part = history[history["estimator"] == name].sort_values("spent", kind="stable")
        best = part[part["best"]]
        x, y = [*best["spent"], part["spent"].iloc[-1]], [*best["gain"], best["gain"].iloc[-1]]
        ax.plot(x, y, color=pen.colour, ls=pen.line, lw=1.4, drawstyle="steps-post", label=name)
        ax.plot(best["spent"], best["gain"], color=pen.colour, marker=pen.marker, ls="none", ms=5)
    style.finish(ax, "training trials used", "gain of the mean score", "on training streams", grid="both")
    style.add_legend(ax)
    return ax


def tuned_parameters(history: pd.DataFrame, estimator: str) -> Axes:
    """Draw the gain of every configuration of one estimator in `cl.tune(...).history`, over each of its parameters.

    Filled marks ran all rounds, hollow ones were stopped early, after fewer trials; the cross is the configuration as
    shipped, and a circle is drawn around the one that was chosen. The axes of the first panel are returned.
    """
    _require_table(history, "cl.tune(...).history", "gain")
    known = list(dict.fromkeys(history["estimator"]))
    if estimator not in known:
        raise BadInput(f"there is no estimator {estimator!r} in this tuning; {nearest(estimator, known)}")
    part = history[history["estimator"] == estimator].dropna(axis=1, how="all")
    columns = [str(name) for name in part if str(name).startswith(VALUE)]
    if not columns:
        raise BadInput(f"{estimator!r} declares no parameter that may be tuned; choose another estimator")
    axes = style.new_panels(len(columns), 3, (3.0, 2.4), sharey=True)
    for k, (ax, column) in enumerate(zip(axes, columns, strict=True)):
        _draw_gains(ax, part, column, style.session_pens([estimator])[estimator].colour)
        style.finish(ax, column.removeprefix(VALUE), "gain of the mean score" * (k % 3 == 0), grid="y")
    figure: Any = axes[0].figure
    figure.suptitle(estimator, fontsize="medium")
    return axes[0]


def _draw_gains(ax: Axes, part: pd.DataFrame, column: str, colour: str) -> None:
    """Draw the gains of one parameter's values."""
    values = pd.to_numeric(part[column], errors="coerce")
    if values.isna().any():  # words, and true and false
        words = part[column].astype(str).str.lower()
        kinds = sorted(set(words))
        values = words.map(kinds.index).astype(float)
        ax.set_xticks(range(len(kinds)), kinds)
        ax.set_xlim(-0.5, len(kinds) - 0.5)
    elif values.min() > 0 and values.max() > WIDE * values.min():
        set_log_scale(ax.xaxis, float(values.min()), float(values.max()))
    for state, face in ((part["state"] == "finished", colour), (part["state"] != "finished", "white")):
        ax.plot(values[state], part["gain"][state], "o", color=colour, mfc=face, ms=5)
    chosen = part[part["best"]].index[-1]
    ax.plot(values.iloc[:1], part["gain"].iloc[:1], "x", color="black", ms=8, mew=2)
    ax.plot(values[[chosen]], part["gain"][[chosen]], "o", mfc="none", mec="black", ms=11)


# ---- a ledger of claims: its verdicts


class Mark(NamedTuple):
    """Colour and marker of a verdict, which differ in grey print too."""

    colour: str
    marker: str
    face: str
    strip: tuple[float, float]  # the part of a row's height that its marks take in the map


VERDICTS = {
    "supported": Mark(style.GREEN, "o", style.GREEN, (0, 1)),
    "direction only": Mark(style.ORANGE, "D", "white", (0.5, 1)),
    "flat": Mark(style.PURPLE, "P", "white", (0.25, 0.75)),
    "contradicted": Mark(style.VERMILION, "X", style.VERMILION, (0, 0.5)),
    "undecided": Mark(style.BLUE, "s", "white", (0.35, 0.65)),
}
CLAIMED = style.DARK


def claims(verdicts: pd.DataFrame, variant: str = BASE, ax: Axes | None = None) -> Axes:
    """Draw the claims of `cl.verdicts` that name a change: the claimed one, and the one found in every case.

    `variant` is the reading of the paper; "paper" is the ledger's own. Intervals are of 95 %.
    """
    _require_table(verdicts, "cl.verdicts", "variant")
    drawn = verdicts[(verdicts["variant"] == variant) & verdicts["kind"].isin(RELATIVE)]
    drawn = drawn[drawn["value"].notna() & drawn["size"].notna()]
    if drawn.empty:
        raise BadInput(f"no claim of the reading {variant!r} that names a change was run: see the column `verdict`")
    blocks = list(drawn.groupby(["claim", "says"], sort=False))
    ax = ax or style.new_axes(7.4, 0.6 + 0.42 * len(blocks) + 0.21 * len(drawn))
    head: Any = {"xycoords": ("figure fraction", "data"), "annotation_clip": False, "in_layout": False}
    y, ticks = 0.0, {}
    for (claim, says), block in blocks:
        ax.annotate(f"{claim}. {says}", (0.01, y), fontsize=8, weight="bold", va="center", **head)
        first = y + 0.6
        for row in block.to_dict("records"):
            y += 1
            mark = VERDICTS[row["verdict"]]
            low, value, high = (100 * row[name] for name in ("low", "value", "high"))
            if np.isfinite([low, high]).all():
                ax.plot([low, high], [y, y], color=mark.colour, lw=1.5)
            ax.plot(value, y, mark.marker, mec=mark.colour, mfc=mark.face, ms=6)
            ticks[y] = row["of"] + (f" vs {row['than']}" if row["than"] else "") + f", {row['scenario']}"
        ax.plot([100 * block["size"].iloc[0]] * 2, [first, y + 0.4], color=CLAIMED, lw=2, solid_capstyle="butt")
        y += 1.4
    ax.set_yticks(list(ticks), list(ticks.values()), fontsize=7)
    ax.set_ylim(y - 0.6, -0.8)
    for verdict, mark in VERDICTS.items():
        if verdict in set(drawn["verdict"]):
            ax.plot([], [], mark.marker, mec=mark.colour, mfc=mark.face, ms=6, label=verdict)
    ax.plot([], [], color=CLAIMED, lw=2, label="claimed")
    ax.axvline(0, color="0.7", lw=0.8, zorder=0)
    ax.tick_params(axis="y", length=0)
    style.finish(ax, "change of the RMSE [%] with its 95 % interval", grid="x")
    ax.spines["left"].set_visible(False)
    style.add_legend(ax, fontsize=8, loc="lower right", ncols=5)
    return ax


# ------------------------------------------------------------------------------------------------ the map

NAMED = {  # reading -> marker, y, name
    "letter": ("v", 1.3, "the paper's letter"),
    "code": ("D", 1.3, "public code"),
    "preset": ("^", -0.3, "our preset"),
}
PALE = 0.25  # of readings in which the baseline is worse than dead reckoning
STRIP, LINE = 0.55, 0.42  # heights of a row's marks and of a line of text, in units of the y axis
WIDTH, LETTERS = 4.2, 52  # of the figure [in], and of a line of text
MOST = 1.5  # changes beyond are drawn at the edge


def readings(found: pd.DataFrame, ax: Axes | None = None, columns: int = 1) -> Axes:
    """Draw the claims of `cl.readings` that name a size: the claimed one, every specification's, how many support it.

    Changes of the error, in per cent; below them, where levels are claimed too, the RMSE in m in axes of their own; or
    side by side in so many `columns`, the levels in the last one. On `ax` only the changes are drawn. Pale: readings in
    which the baseline is worse than dead reckoning.
    """
    _require_table(found, "cl.readings", "size")
    sized = found[found["size"].notna() & found["value"].notna()]
    changes, levels = sized[sized["kind"].isin(RELATIVE)], sized[sized["kind"] == "level"]
    pieces = np.array_split(changes["claim"].unique(), max(columns - 1, 1))
    parts = [changes[changes["claim"].isin(piece)] for piece in pieces] + [levels] * (ax is None)
    parts = [part for part in parts if len(part)]
    if not parts:
        raise BadInput("no claim that names a size was run: see the columns `size` and `value` of cl.readings")
    named = [part.drop_duplicates("claim")[["claim", "says"]].to_numpy() for part in parts]
    heights = [sum(LINE * len(_wrap(*one)) + STRIP + 0.65 for one in ones) for ones in named]
    if columns == 1:
        shape, size = (len(parts), 1), (WIDTH, 0.5 * sum(heights) + 0.55 * len(heights) + 0.6)
    else:
        shape, size = (1, len(parts)), (0.8 * WIDTH * len(parts), 0.44 * max(heights) + 0.95)
    grid: Any = {"height_ratios": heights if columns == 1 else None, "squeeze": False, "layout": "constrained"}
    axes = [ax] if ax else list(plt.subplots(*shape, figsize=size, **grid)[1].flat)
    for each, part in zip(axes, parts, strict=True):
        _draw_map(each, part, part is levels)
    last = axes[-1]
    for verdict, mark in VERDICTS.items():
        if verdict in set(pd.concat(parts)["verdict"]):
            low, high = mark.strip
            strip, height = [(0, 2 * low - 1), (0, 2 * high - 1)], 4 if 0 < low < high < 1 else 11
            last.plot([], [], marker=strip, color=mark.colour, ls="", ms=height, mew=2, label=verdict)
    last.plot([], [], marker="|", color=CLAIMED, ls="", ms=10, mew=3, label="claimed")
    for marker, _, name in NAMED.values():
        last.plot([], [], marker, mec="0.4", mfc="0.4", ms=5, label=name)
    style.add_legend_below([last], 3 if columns == 1 else 9, fontsize=7.5, handletextpad=0.3)
    return axes[0]


def _draw_map(ax: Axes, part: pd.DataFrame, levels: bool) -> None:
    """Draw a strip per claim, from the top: its specifications, each claimed size, and the readings that have a name.

    Numbers beyond the axis stand at its edge.
    """
    unit, least = (1.0, 0.0) if levels else (100.0, -1.0)
    size = part["size"].abs().max()
    most = max(min(part["value"].max(), 4 * size if levels else MOST), 1.2 * size if levels else 0.25)
    y = 0.0
    for (claim, says), rows in part.groupby(["claim", "says"], sort=False):
        lines = _wrap(claim, says)
        y -= LINE * len(lines)
        ax.annotate("\n".join(lines), (0, y), xycoords=("axes fraction", "data"), fontsize=7.5, va="bottom")
        y -= STRIP + 0.3
        rows = rows.assign(value=unit * rows["value"].clip(least, most))
        ax.axhspan(y, y + STRIP, color="0.955", lw=0, zorder=0)
        for verdict, mark in VERDICTS.items():
            low, high = (y + STRIP * end for end in mark.strip)
            of_verdict = rows[rows["verdict"] == verdict]
            pale = of_verdict["implausible"].eq(True)
            for some, alpha in ((of_verdict[pale], PALE), (of_verdict[~pale], 0.8)):
                ax.vlines(some["value"], low, high, color=mark.colour, lw=1, alpha=alpha)
        for number in rows["size"].unique():
            ax.vlines(unit * number, y - 0.06, y + STRIP + 0.06, color=CLAIMED, lw=2.5)
        for end, (marker, height, _) in NAMED.items():
            for row in rows[rows[end].eq(True)].to_dict("records"):
                mark = VERDICTS[row["verdict"]]
                ax.plot(row["value"], y + STRIP * height, marker, mec=mark.colour, mfc=mark.face, ms=5, mew=1)
        held = f"{(rows['verdict'] == 'supported').sum()} of {len(rows)}"
        ax.annotate(held, (1.02, y + STRIP / 2), xycoords=("axes fraction", "data"), fontsize=8, va="center")
        y -= 0.35
    ax.set(ylim=(y, 0.1), xlim=(unit * least, unit * (most + 0.02 * (most - least))), yticks=[])
    if not levels:
        ax.axvline(0, color="0.6", lw=0.8, zorder=0)
    ax.tick_params(labelsize=7.5)
    style.finish(ax, grid="x")
    ax.set_xlabel("RMSE [m]" if levels else "change of the error [%]", fontsize=8)
    ax.spines["left"].set_visible(False)


def _wrap(claim: Any, says: Any) -> list[str]:
    """Return a claim in lines; a number stays with its per cent."""
    return textwrap.wrap(f"{claim}. {says}".replace(" %", "\N{NO-BREAK SPACE}%"), LETTERS)

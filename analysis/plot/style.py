"""The style of all figures: colours that colour-blind readers tell apart, markers and lines that grey print does.

A built-in estimator has its pen by its place in the registry, a variant ("arl[K=1]") its method's colour, darker or
lighter. Hollow markers are over-confident, grey and dotted estimators centralised, dots and dashes offline.
"""

import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from cooploc.analysis.metrics.compare import require_errors, summarize
from cooploc.analysis.metrics.consistency import consistency
from cooploc.analysis.metrics.errors import is_offline
from cooploc.analysis.metrics.ranking import is_refused
from cooploc.estimators import BUILTIN
from cooploc.estimators.label_syntax import drop_folders

# seaborn's palette "colorblind", which takes a second to import.
BLUE, ORANGE, GREEN, VERMILION, PURPLE, BROWN, SKY = (
    *("#0173b2", "#de8f05", "#029e73", "#d55e00", "#cc78bc", "#ca9161"),
    "#56b4e9",
)
HUES = BROWN, BLUE, SKY, VERMILION, ORANGE, GREEN, PURPLE  # of built-in estimators, in the order of the registry
OTHERS = ("#332288", "#882255", "#999933", "#44aa99")  # of estimators that are not built in; of Paul Tol's muted scheme
ROBOTS = BLUE, ORANGE, GREEN, PURPLE, BROWN, SKY
NAMED = dict(zip(("blue", "orange", "green", "purple", "brown"), ROBOTS, strict=False))
NAMED |= {"red": "#cc3311", "yellow": "#ccbb44", "black": "black"}
SHADES = (-0.4, 0.4, -0.65, 0.6)  # of variants: towards black, or towards white
# points, star, degrees
STARS = (4, 1, 0), (4, 1, 45), (6, 1, 0), (8, 1, 0), (3, 1, 0), (3, 1, 180), (5, 1, 36), (12, 1, 0), (3, 1, 90)
MARKERS: tuple[Any, ...] = (*"XosD^vP*ph<>d8H", *STARS)
SOLID, DOTTED, BROKEN, OFFLINE = "-", (0, (1, 1.5)), (0, (2, 2)), (0, (5, 1.5, 1, 1.5))
DASHES: tuple[Any, ...] = (SOLID, (0, (6, 1.5)), (0, (3, 1, 1, 1)), (0, (8, 1, 1, 1, 1, 1)))
DARK, GREY, BAND, GRID, FAINT = "0.2", to_hex("0.55"), "0.93", "0.92", "0.88"
Row = Mapping[Any, Any] | pd.Series


class Style(NamedTuple):
    """Sizes of figures and of their letters."""

    rc: Any  # settings of matplotlib
    width: float  # of a figure [in]
    across: int = 1  # panels side by side
    keys: int = 2  # entries of a legend side by side


SVG: Any = {"svg.hashsalt": "cooploc", "text.parse_math": False}  # labels are text, whatever they hold
LEFT = {**SVG, "axes.titlelocation": "left"}
PAGE = Style(  # of a report's page: text stays text
    {**LEFT, "svg.fonttype": "none", "font.sans-serif": ["DejaVu Sans"], "font.size": 9.0, "axes.titlesize": 9.0},
    width=9.2,
    across=4,
    keys=5,
)
TEXT = 8.0  # [pt] of IEEE's two-column journals
_TIMES: Any = {
    **LEFT,
    "font.family": ["STIXGeneral", "DejaVu Sans"],  # metrics of Times; the second for what the first lacks
    **dict.fromkeys(("font.size", "axes.labelsize", "axes.titlesize", "legend.fontsize", "figure.labelsize"), TEXT),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize"), TEXT),
    **dict.fromkeys(("axes.linewidth", "xtick.major.width", "ytick.major.width"), 0.6),
    **dict.fromkeys(("xtick.minor.width", "ytick.minor.width"), 0.4),
    "pdf.fonttype": 42,
    "svg.fonttype": "path",
    **dict.fromkeys(("figure.constrained_layout.w_pad", "figure.constrained_layout.h_pad"), 0.02),
}
PAPER = {1: Style(_TIMES, 3.48, 3, 3), 2: Style(_TIMES, 7.14, 5, 6)}  # by columns: IEEEtran's widths, less a hair
TALLEST = 8.6  # [in]: a page of a paper less its caption


# ------------------------------------------------------------------------------------------------ pens


class Pen(NamedTuple):
    """Colour, marker and line of an estimator."""

    colour: Any
    marker: Any
    line: Any


_SESSION: dict[str, Pen] = {}


def pens(estimators: Iterable[str], known: dict[str, Pen] | None = None) -> dict[str, Pen]:
    """Return the pen of each estimator, in the order given; those in `known` keep theirs, and new ones join it."""
    known = {} if known is None else known
    names = list(dict.fromkeys(estimators))
    for name in names:
        if name not in known:
            known[name] = _new_pen(name, known)
    return {name: known[name] for name in names}


def session_pens(estimators: Iterable[str]) -> dict[str, Pen]:
    """Return the pen of each estimator in this process, where a name once drawn keeps its pen."""
    return pens(estimators, _SESSION)


def _new_pen(name: str, known: Iterable[str]) -> Pen:
    """Return the pen of a built-in estimator, of a variant of one, or of one that is not built in."""
    method, order = name.partition("[")[0], list(BUILTIN)
    if method not in order:
        number = sum(other.partition("[")[0] not in order for other in known)
        return Pen(OTHERS[number % len(OTHERS)], MARKERS[number % len(MARKERS)], DASHES[number % len(DASHES)])
    place, joint = order.index(method), method.endswith("-joint")
    number = 0 if name == method else 1 + sum(other.partition("[")[0] == method != other for other in known)
    colour = GREY if joint else HUES[place % len(HUES)]
    if number:
        shade = SHADES[(number - 1) % len(SHADES)]
        r, g, b = (c * (1 + shade) if shade < 0 else c + (1 - c) * shade for c in to_rgb(colour))
        colour = to_hex((r, g, b))
    line = DOTTED if joint else DASHES[(place + number) % len(DASHES)]
    return Pen(colour, MARKERS[(place + max(0, number - 1)) % len(MARKERS)], line)


def colour_of(row: Row, pen: Pen) -> Any:
    """Return the colour of a row: grey where it is centralised, in the shade that is its own."""
    return GREY if row["centralised"] and len(set(to_rgb(pen.colour))) > 1 else pen.colour


def why_unranked(row: Row) -> str:
    """Return why an estimator is not ranked, to stand behind its name: what failed."""
    return (
        " (failed a check)"
        if is_refused(row["certificate"])
        else " (failed in trials)" * bool(row.get("failed", 0) > 0)
    )


def name_of(row: Row, name: str = "") -> str:
    """Return an estimator's name, or `name`, with why it is not ranked."""
    standing = " (bound)" if row["bound"] else " (centralised)" * bool(row["centralised"])
    standing = " (offline)" if row.get("offline", False) else standing
    return (name or drop_folders(str(row["estimator"]))) + standing + why_unranked(row)


def _line_of(row: Row, line: Any) -> Any:
    """Return a row's line: dots and dashes where it is offline, dotted where it is centralised, else `line`."""
    return OFFLINE if row.get("offline", False) else DOTTED if row["centralised"] else line


# ------------------------------------------------------------------------------------------------ rows


def summarize_for_figures(errors: pd.DataFrame) -> pd.DataFrame:
    """Return the table of `summarize` with `consistency`, `centralised`, `bound` and `offline` of each row."""
    errors = require_errors(errors)
    flags = errors.assign(offline=is_offline(errors)).groupby(["scenario", "estimator"], sort=False)
    standing = flags[["centralised", "bound", "offline"]].any().reset_index(drop=True)
    table = summarize(errors)
    return table.assign(consistency=consistency(table), **{str(name): standing[name].to_numpy() for name in standing})


def draw_marker(ax: Axes, x: float, y: float, row: Row, pen: Pen, **more: Any) -> None:
    """Draw a row's marker; hollow where it is over-confident."""
    colour = colour_of(row, pen)
    face = "white" if row["consistency"] == "over-confident" else colour
    ax.plot(x, y, marker=pen.marker, mfc=face, mec=colour, **{"ms": 6, "mew": 1.3, "zorder": 3, "ls": "none", **more})


def draw_rmse(ax: Axes, place: float, row: Row, pen: Pen, vertical: bool = True) -> None:
    """Draw a row's RMSE with its interval, at a place of the other axis."""
    ends, middle = [row["rmse_low"], row["rmse_high"]], [place, place]
    ax.plot(
        *((middle, ends) if vertical else (ends, middle)), color=colour_of(row, pen), lw=1.6, ls=_line_of(row, SOLID)
    )
    x, y = (place, row["rmse"]) if vertical else (row["rmse"], place)
    draw_marker(ax, x, y, row, pen)


def draw_curve(ax: Axes, rows: pd.DataFrame, x: str, pen: Pen, alpha: float = 0.15, label: str = "") -> None:
    """Draw RMSE over `x` with its band and some 25 markers; solid, or broken where most values are over-confident."""
    over = (rows["consistency"] == "over-confident").to_numpy()
    first = rows.iloc[0]
    colour, line = colour_of(first, pen), _line_of(first, BROKEN if over.mean() > 0.5 else SOLID)
    draw_band(ax, rows[x], rows["rmse_low"], rows["rmse_high"], colour, alpha)
    ax.plot(rows[x], rows["rmse"], color=colour, ls=line, lw=1.6, zorder=3)
    for row in rows.iloc[:: max(1, len(rows) // 25)].to_dict("records"):
        draw_marker(ax, row[x], row["rmse"], row, pen, ms=5, mew=1.2, zorder=4)
    face = "white" if over.all() else colour
    ax.plot([], [], color=colour, ls=line, marker=pen.marker, mfc=face, label=label or name_of(first))


def draw_band(ax: Axes, x: Any, low: Any, high: Any, colour: Any, alpha: float = 0.15) -> None:
    """Draw the intervals along a curve: a tinted band, or where the curve is grey the two edges."""
    if colour == GREY:
        ax.plot(x, low, x, high, color=colour, ls=DOTTED, lw=0.7, zorder=2)
    else:
        ax.fill_between(x, low, high, color=colour, alpha=alpha, lw=0, zorder=2)


def robot_colours(names: Sequence[str]) -> dict[str, str]:
    """Return a colour for each robot: its own where it is called red, blue, ..., else the next one."""
    own = {name: NAMED[word] for name in names for word in re.split("[^a-z]", name.lower()) if word in NAMED}
    rest = cycle([one for one in ROBOTS if one not in own.values()] or ROBOTS)
    return {name: own.get(name) or next(rest) for name in names}


def span(part: pd.DataFrame, *columns: str) -> tuple[float, float]:
    """Return the smallest and the largest finite value of some columns; nan where there is none."""
    values = part[list(columns)].to_numpy(float)
    values = values[np.isfinite(values)]
    return (float(values.min()), float(values.max())) if len(values) else (np.nan, np.nan)


# ------------------------------------------------------------------------------------------------ axes and files


def new_axes(width: float, height: float) -> Axes:
    """Return axes of a figure of that size [in]."""
    return plt.subplots(figsize=(width, height), layout="constrained")[1]


def new_panels(number: int, across: int, panel: tuple[float, float], more: float = 0.0, **sharing: Any) -> list[Axes]:
    """Return axes of so many panels of a size [in] in rows, in a figure that is `more` [in] higher."""
    across, down = min(number, across), -(-number // across)
    size = across * panel[0], down * panel[1] + more
    _, axes = plt.subplots(down, across, figsize=size, squeeze=False, layout="constrained", **sharing)
    for ax in axes.flat[number:]:
        ax.remove()
    for ax in axes.flat[max(0, number - across) : number]:
        ax.tick_params(labelbottom=True)
    return list(axes.flat[:number])


def fit_height(ax: Axes) -> None:
    """Set the height of a figure whose axes have equal scales and a legend beside, so that no space is empty."""
    (x0, x1), (y0, y1) = ax.get_xlim(), ax.get_ylim()
    figure: Any = ax.figure
    figure.set_figheight(min(9.0, max(2.6, (figure.get_figwidth() - 3.0) * (y1 - y0) / (x1 - x0) + 0.9)))


def set_note(ax: Axes, text: str) -> None:
    """Set a line above a figure, in small print."""
    ax.set_title(text, loc="left", fontsize="small", color="0.35")


def finish(ax: Axes, xlabel: str = "", ylabel: str = "", above: str = "", grid: Any = None) -> None:
    """Set labels, a note above and a light grid, and remove the box."""
    ax.set(xlabel=xlabel, ylabel=ylabel)
    if above:
        set_note(ax, above)
    if grid:
        ax.grid(axis=grid, color=GRID, lw=0.8)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)


def add_legend(ax: Axes, **more: Any) -> None:
    """Add a legend beside the figure, so that it hides nothing."""
    beside = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0), "fontsize": "small"}
    ax.legend(frameon=False, **{**beside, **more})


def add_legend_below(axes: Iterable[Axes], columns: int = 3, **more: Any) -> None:
    """Add one legend below all panels, of every label once."""
    found = {label: one for ax in axes for one, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    if found:
        figure: Any = next(iter(axes)).figure
        small = {"loc": "outside lower center", "ncols": columns, "frameon": False, "fontsize": 8}
        figure.legend(list(found.values()), list(found), **{**small, **more})


def set_log_scale(axis: Any, low: float, high: float) -> None:
    """Make an axis logarithmic for values from `low` to `high`, with ticks that are plain numbers."""
    if not (np.isfinite([low, high]).all() and low > 0):
        return
    axis.axes.set_xscale("log") if axis.axis_name == "x" else axis.axes.set_yscale("log")
    few: tuple[float, ...] = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0) if high < 5 * low else (1.0, 2.0, 5.0)
    few = few if high < 30 * low else (1.0, 3.0) if high < 300 * low else (1.0,)
    axis.set_major_locator(LogLocator(subs=few))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


# For what draws into files, as a context or a decorator: they look alike, whatever a user has set in matplotlib.
as_shipped = partial(plt.style.context, "default")


def save(drawn: Axes | Figure, *paths: Path, dpi: int = 150, rc: Any = SVG) -> None:
    """Write a figure without a date, so that the same numbers give the same bytes, and close it.

    Coordinates of an SVG are to a hundredth of a point, which makes it a third shorter.
    """
    figure: Any = drawn.figure if isinstance(drawn, Axes) else drawn
    dates: dict[str, Any] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None, "Producer": None}}
    with mpl.rc_context({"pdf.fonttype": 42, **rc}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # it would be laid out again for each file, which takes longer than to draw
        for path in paths:
            figure.savefig(path, dpi=dpi, metadata=dates.get(path.suffix))
            if path.suffix == ".svg":
                path.write_text(round_numbers(path.read_text("utf-8"), r'\s(?:d|x|y)="[^"]*"', 2), "utf-8")
    plt.close(figure)


def round_numbers(svg: str, where: str, digits: int) -> str:
    """Return an SVG whose numbers with more digits are rounded, within each match of `where`."""
    number = re.compile(rf"-?\d+\.\d{{{digits + 1},}}")

    def round_match(found: re.Match[str]) -> str:
        return number.sub(lambda one: f"{float(one[0]):.{digits}f}".removesuffix(".0"), found[0])

    return re.sub(where, round_match, svg)

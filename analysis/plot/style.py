"""The one style of all figures: colours that colour-blind readers tell apart, markers and lines that grey print does.

An estimator keeps its look in every figure, whatever others are shown: the built-in ones have theirs by their place in
the registry, a variant ("arl[K=1]") has its method's colour, darker or lighter, and all others take theirs in the order
in which they appear. Hollow markers are over-confident; grey and dotted are centralised, and know more than any robot
could; grey in dots and dashes are offline, and know what is read later.

Rows that are drawn are those of `compare`, or of `summarize` with `consistency`, `centralised` and `bound`.
"""

import re
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from cooploc.analysis.metrics.compare import summarize
from cooploc.analysis.metrics.consistency import consistency
from cooploc.analysis.metrics.errors import is_offline
from cooploc.analysis.metrics.ranking import is_refused
from cooploc.estimators import BUILTIN

BLUE, ORANGE, GREEN, VERMILION, PURPLE, BROWN, _, _, _, SKY = map(to_hex, sns.color_palette("colorblind", 10))
HUES = BROWN, BLUE, SKY, VERMILION, ORANGE, GREEN, PURPLE  # of built-in estimators, in the order of the registry
OTHERS = ("#332288", "#882255", "#999933", "#44aa99")  # of estimators that are not built in; of Paul Tol's muted scheme
ROBOTS = BLUE, ORANGE, GREEN, PURPLE, BROWN, SKY
SHADES = (-0.4, 0.4, -0.65, 0.6)  # of variants: towards black, or towards white
# points, star, degrees
STARS = (4, 1, 0), (4, 1, 45), (6, 1, 0), (8, 1, 0), (3, 1, 0), (3, 1, 180), (5, 1, 36), (12, 1, 0), (3, 1, 90)
MARKERS: tuple[Any, ...] = (*"XosD^vP*ph<>d8H", *STARS)
SOLID, DOTTED, BROKEN = "-", (0, (1, 1.5)), (0, (2, 2))
OFFLINE = (0, (5, 1.5, 1, 1.5))  # of what saw later readings, too
DASHES: tuple[Any, ...] = (SOLID, (0, (6, 1.5)), (0, (3, 1, 1, 1)), (0, (8, 1, 1, 1, 1, 1)))
DARK, GREY, BAND, GRID, FAINT = "0.2", "0.55", "0.93", "0.92", "0.88"
UNRANKED = " (failed a check)"
Row = Mapping[Any, Any] | pd.Series


class Style(NamedTuple):
    """How large figures and their letters are."""

    rc: Any  # what matplotlib is told
    width: float  # of a figure [in]
    across: int = 1  # panels side by side
    keys: int = 2  # entries of a legend side by side


_SVG: Any = {"svg.hashsalt": "cooploc", "text.parse_math": False}  # labels are text, whatever they hold
PAGE = Style(  # of the report's page: text stays text
    {**_SVG, "svg.fonttype": "none", "font.sans-serif": ["DejaVu Sans"], "font.size": 9.0, "axes.titlesize": 9.0,
     "axes.titlelocation": "left"},
    7.4,
)  # fmt: skip
TEXT, SMALL = 8.0, 7.0  # [pt] of IEEE's two-column journals
_TIMES: Any = {
    **_SVG,
    "font.family": ["STIXGeneral", "DejaVu Sans"],  # metrics of Times; the second for what the first lacks
    **dict.fromkeys(("font.size", "axes.labelsize", "axes.titlesize", "legend.fontsize", "figure.labelsize"), TEXT),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize"), TEXT),
    "axes.titlelocation": "left",
    **dict.fromkeys(("axes.linewidth", "xtick.major.width", "ytick.major.width"), 0.6),
    **dict.fromkeys(("xtick.minor.width", "ytick.minor.width"), 0.4),
    "pdf.fonttype": 42,
    "svg.fonttype": "path",
    **dict.fromkeys(("figure.constrained_layout.w_pad", "figure.constrained_layout.h_pad"), 0.02),
}
COLUMNS = {1: 3.48, 2: 7.14}  # columns of a paper -> width [in]: IEEEtran's 21 and 43 picas, less a hair
PAPER = {1: Style(_TIMES, COLUMNS[1], 3, 3), 2: Style(_TIMES, COLUMNS[2], 5, 6)}
TALLEST = 8.6  # [in]: a page of a paper less its caption
FORMATS = ("pdf", "svg")


# ------------------------------------------------------------------------------------------------ looks


class Look(NamedTuple):
    """How an estimator is drawn."""

    colour: Any
    marker: Any
    line: Any


_SEEN: dict[str, Look] = {}  # in the figures of this process


def looks(estimators: Iterable[str], seen: dict[str, Look] | None = None) -> dict[str, Look]:
    """The look of each estimator, in the order given; those in `seen` keep theirs, and new ones are added to it."""
    names = list(dict.fromkeys(estimators))
    known = {} if seen is None else seen
    for name in names:
        if name not in known:
            known[name] = _new_look(name, known)
    return {name: known[name] for name in names}


def session_looks(estimators: Iterable[str]) -> dict[str, Look]:
    """The look of each estimator in this process, where a name once drawn keeps its look."""
    return looks(estimators, _SEEN)


def _new_look(name: str, known: Iterable[str]) -> Look:
    """The look of a built-in estimator, of a variant of one, or of one that is not built in."""
    method, order = name.partition("[")[0], list(BUILTIN)
    if method not in order:
        number = sum(other.partition("[")[0] not in order for other in known)
        return Look(OTHERS[number % len(OTHERS)], MARKERS[number % len(MARKERS)], DASHES[number % len(DASHES)])
    place, joint = order.index(method), method.endswith("-joint")
    number = 0 if name == method else 1 + sum(other.partition("[")[0] == method != other for other in known)
    marker = MARKERS[(place + max(0, number - 1)) % len(MARKERS)]
    line = DOTTED if joint else DASHES[(place + number) % len(DASHES)]
    colour = to_hex(GREY) if joint else HUES[place % len(HUES)]
    return Look(_shade(colour, SHADES[(number - 1) % len(SHADES)]) if number else colour, marker, line)


def _shade(colour: Any, by: float) -> str:
    """A colour moved towards black (negative) or white."""
    r, g, b = (c * (1 + by) if by < 0 else c + (1 - c) * by for c in to_rgb(colour))
    return to_hex((r, g, b))


def colour_of(row: Row, look: Look) -> Any:
    """Centralised estimators are grey, in the shade that is theirs, and so are those that are offline."""
    return to_hex(GREY) if row["centralised"] and len(set(to_rgb(look.colour))) > 1 else look.colour


def name_of(row: Row, name: str = "") -> str:
    """An estimator's name, or another one, and what keeps it from being ranked."""
    standing = " (bound)" if row["bound"] else " (centralised)" * bool(row["centralised"])
    standing = " (offline)" if row.get("offline", False) else standing
    return (name or str(row["estimator"])) + standing + UNRANKED * is_refused(row["certificate"])


# ------------------------------------------------------------------------------------------------ rows


def drawable(errors: pd.DataFrame) -> pd.DataFrame:
    """The table of `summarize` with what decides how a row is drawn: `consistency`, `centralised` and `bound`."""
    flags = errors.assign(offline=is_offline(errors)).groupby(["scenario", "estimator"], sort=False)
    standing = flags[["centralised", "bound", "offline"]].any().reset_index(drop=True)
    table = summarize(errors)
    return table.assign(consistency=consistency(table), **{str(name): standing[name].to_numpy() for name in standing})


def marker(ax: Axes, x: float, y: float, row: Row, look: Look, **more: Any) -> None:
    """A row's marker; hollow where it is over-confident."""
    colour = colour_of(row, look)
    face = "white" if row["consistency"] == "over-confident" else colour
    ax.plot(x, y, marker=look.marker, mfc=face, mec=colour, **{"ms": 6, "mew": 1.3, "zorder": 3, "ls": "none", **more})


def rmse_at(ax: Axes, place: float, row: Row, look: Look, vertical: bool = True) -> None:
    """A row's RMSE with its interval, at a place of the other axis."""
    ends, middle = [row["rmse_low"], row["rmse_high"]], [place, place]
    line = _robotless(row) or SOLID
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
    line = _robotless(first) or (BROKEN if over.mean() > 0.5 else look.line)
    band(ax, rows[x], rows["rmse_low"], rows["rmse_high"], colour, alpha)
    ax.plot(rows[x], rows["rmse"], color=colour, ls=line, lw=1.6, zorder=3)
    for row in rows.iloc[:: max(1, len(rows) // 25)].to_dict("records"):
        marker(ax, row[x], row["rmse"], row, look, ms=5, mew=1.2, zorder=4)
    face = "white" if over.all() else colour
    ax.plot([], [], color=colour, ls=line, marker=look.marker, mfc=face, label=label or name_of(first))


def _robotless(row: Row) -> Any:
    """The line of what no robot could run: dotted where it is centralised, dots and dashes where it is offline."""
    return OFFLINE if row.get("offline", False) else DOTTED if row["centralised"] else None


def band(ax: Axes, x: Any, low: Any, high: Any, colour: Any, alpha: float = 0.15) -> None:
    """The intervals along a curve: a tinted band; of a centralised one, which is grey, its two edges."""
    if colour == to_hex(GREY):
        ax.plot(x, low, x, high, color=colour, ls=DOTTED, lw=0.7, zorder=2)
    else:
        ax.fill_between(x, low, high, color=colour, alpha=alpha, lw=0, zorder=2)


def span(part: pd.DataFrame, *columns: str) -> tuple[float, float]:
    """From the smallest to the largest finite value of some columns; nan where there is none."""
    values = part[list(columns)].to_numpy(float)
    values = values[np.isfinite(values)]
    return (float(values.min()), float(values.max())) if len(values) else (np.nan, np.nan)


# ------------------------------------------------------------------------------------------------ axes and files


def new_axes(width: float, height: float) -> Axes:
    """Axes of a figure of that size [in]."""
    return plt.subplots(figsize=(width, height), layout="constrained")[1]


def new_panels(number: int, across: int, panel: tuple[float, float], more: float = 0.0, **sharing: Any) -> list[Axes]:
    """Axes of so many panels of a size [in] in rows, in a figure that is `more` [in] higher."""
    across, down = min(number, across), -(-number // across)
    size = across * panel[0], down * panel[1] + more
    _, axes = plt.subplots(down, across, figsize=size, squeeze=False, layout="constrained", **sharing)
    for ax in axes.flat[number:]:
        ax.remove()
    for ax in axes.flat[max(0, number - across) : number]:
        ax.tick_params(labelbottom=True)
    return list(axes.flat[:number])


def fit_height(ax: Axes, beside: float = 2.4) -> None:
    """The height of a figure whose axes have equal scales and `beside` which [in] a legend stands: no empty space."""
    (x0, x1), (y0, y1) = ax.get_xlim(), ax.get_ylim()
    figure = ax.get_figure(root=True)
    if figure is not None:
        width = figure.get_figwidth()
        figure.set_figheight(min(9.0, max(2.6, (width - beside - 0.6) * (y1 - y0) / (x1 - x0) + 0.9)))


def note(ax: Axes, text: str) -> None:
    """A line above a figure, in small print."""
    ax.set_title(text, loc="left", fontsize="small", color="0.35")


def finish(ax: Axes, xlabel: str = "", ylabel: str = "", above: str = "", grid: Any = None) -> None:
    """What all figures have: labels, a note above, a light grid, and no box around."""
    ax.set(xlabel=xlabel, ylabel=ylabel)
    if above:
        note(ax, above)
    if grid:
        ax.grid(axis=grid, color=GRID, lw=0.8)
    ax.set_axisbelow(True)
    sns.despine(ax=ax)


def legend(ax: Axes, **more: Any) -> None:
    """A legend beside the figure, so that it hides nothing."""
    beside = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0), "fontsize": "small"}
    ax.legend(frameon=False, **{**beside, **more})


def legend_below(axes: Iterable[Axes], columns: int = 3, **more: Any) -> None:
    """One legend below all panels, of every label once."""
    found = {label: one for ax in axes for one, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    if found:
        figure: Any = next(iter(axes)).figure
        small = {"loc": "outside lower center", "ncols": columns, "frameon": False, "fontsize": 8}
        figure.legend(list(found.values()), list(found), **{**small, **more})


def logarithmic(axis: Any, low: float, high: float) -> None:
    """A logarithmic axis for values from `low` to `high`, with ticks that are plain numbers."""
    if not (np.isfinite([low, high]).all() and low > 0):
        return
    axis.axes.set_xscale("log") if axis.axis_name == "x" else axis.axes.set_yscale("log")
    few: tuple[float, ...] = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0) if high < 5 * low else (1.0, 2.0, 5.0)
    few = few if high < 30 * low else (1.0, 3.0) if high < 300 * low else (1.0,)
    axis.set_major_locator(LogLocator(subs=few))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def save(drawn: Axes | Figure, *paths: Path, dpi: int = 150, rc: Any = _SVG) -> None:
    """Write a figure to files without a date, so that the same numbers give the same bytes, and close it."""
    figure: Any = drawn.figure if isinstance(drawn, Axes) else drawn
    dates: dict[str, Any] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None, "Producer": None}}
    with mpl.rc_context({"pdf.fonttype": 42, **rc}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # it would be laid out again for each file, which takes longer than to draw
        for path in paths:
            figure.savefig(path, dpi=dpi, metadata=dates.get(path.suffix))
            if path.suffix == ".svg":
                path.write_text(round_coordinates(path.read_text("utf-8")), "utf-8")
    plt.close(figure)


def round_coordinates(svg: str) -> str:
    """An SVG with the coordinates of its paths and marks to a hundredth of a point, which is a third shorter."""
    coordinates, long = re.compile(r'\s(?:d|x|y)="[^"]*"'), re.compile(r"-?\d+\.\d{3,}")
    return coordinates.sub(lambda found: long.sub(lambda number: f"{float(number[0]):.2f}", found[0]), svg)

"""The one style of all figures: colours that colour-blind readers tell apart, markers and lines that grey print does.

An estimator keeps its look in every figure, whatever others are shown: the built-in ones have theirs by name, a variant
("arl[K=1]") has its method's colour, darker or lighter, and all others take theirs in the order in which they appear.
Hollow markers are over-confident; grey and dotted are centralised, and know more than any robot could;
grey in dots and dashes are offline, and know what is read later.
"""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

BLUE, ORANGE, GREEN, VERMILION, PURPLE, BROWN, _, _, _, SKY = map(to_hex, sns.color_palette("colorblind", 10))
OTHERS = ("#332288", "#882255", "#999933", "#44aa99")  # of estimators that are not built in; of Paul Tol's muted scheme
SHADES = (-0.4, 0.4, -0.65, 0.6)  # of variants: towards black, or towards white
# points, star, degrees
STARS = (4, 1, 0), (4, 1, 45), (6, 1, 0), (8, 1, 0), (3, 1, 0), (3, 1, 180), (5, 1, 36), (12, 1, 0), (3, 1, 90)
MARKERS: tuple[Any, ...] = (*"osD^vPX*ph<>d8H", *STARS)
SOLID, DOTTED, BROKEN = "-", (0, (1, 1.5)), (0, (2, 2))
OFFLINE = (0, (5, 1.5, 1, 1.5))  # of what saw later readings, too
DASHES: tuple[Any, ...] = (SOLID, (0, (6, 1.5)), (0, (3, 1, 1, 1)), (0, (8, 1, 1, 1, 1, 1)))
DARK, GREY, BAND, GRID = "0.2", "0.55", "0.93", "0.92"

COORDINATES, DECIMALS = re.compile(r'\s(?:d|x|y)="[^"]*"'), re.compile(r"-?\d+\.\d{3,}")


class Look(NamedTuple):
    """How an estimator is drawn."""

    colour: Any
    marker: Any
    line: Any


BUILT_IN = {
    "dead-reckoning": Look(BROWN, "X", DASHES[0]),
    "arl": Look(BLUE, "o", DASHES[0]),
    "rssi-pf": Look(SKY, "s", DASHES[1]),
    "mrsl-rssi": Look(VERMILION, "D", DASHES[2]),
    "mrsl-distance": Look(ORANGE, "^", DASHES[3]),
    "ctrn": Look(GREEN, "v", DASHES[1]),
    "cmrl": Look(BLUE, STARS[0], DASHES[1]),
    "reciprocal-pf": Look(PURPLE, STARS[1], DASHES[2]),
    "channel-pf": Look(BROWN, STARS[2], DASHES[3]),
    "ekf-local": Look(PURPLE, "P", DASHES[3]),
    "ekf-naive": Look(VERMILION, "*", DASHES[1]),
    "ekf-ci": Look(GREEN, "p", DASHES[2]),
    "ekf-split-ci": Look(SKY, "h", DASHES[3]),
    "ekf-ici": Look(BLUE, STARS[5], DASHES[3]),
    "ekf-hmd": Look(PURPLE, STARS[6], DASHES[0]),
    "ekf-event-ci": Look(GREEN, STARS[7], DASHES[0]),
    "ekf-gs-ci": Look(BROWN, STARS[8], DASHES[2]),
    "ekf-luft": Look(ORANGE, "<", DASHES[1]),
    "ekf-interim": Look(BLUE, ">", DASHES[2]),
    "gbp": Look(BROWN, STARS[3], DASHES[1]),
    "ekf-joint": Look(GREY, "d", DOTTED),
    "iekf-joint": Look(GREY, STARS[4], DOTTED),
    "ukf-joint": Look(GREY, "8", DOTTED),
    "map-joint": Look(GREY, "H", DOTTED),
}
_SEEN: dict[str, Look] = {}  # in the figures of this process


def looks(estimators: Iterable[str], seen: dict[str, Look] | None = None) -> dict[str, Look]:
    """The look of each estimator, in the order given; those in `seen` keep theirs, and new ones are added to it."""
    names = list(dict.fromkeys(estimators))
    known = {} if seen is None else seen
    for name in names:
        if name not in known:
            known[name] = BUILT_IN.get(name) or _new(name, known)
    return {name: known[name] for name in names}


def session_looks(estimators: Iterable[str]) -> dict[str, Look]:
    """The look of each estimator in this process, where a name once drawn keeps its look."""
    return looks(estimators, _SEEN)


def _new(name: str, known: Iterable[str]) -> Look:
    """The look of a variant of a built-in estimator, or of one that is not built in."""
    method = name.partition("[")[0]
    if method in BUILT_IN:
        number = sum(other.partition("[")[0] == method for other in known if other != method)
        base = BUILT_IN[method]
        marker = MARKERS[(MARKERS.index(base.marker) + number) % len(MARKERS)]
        line = DOTTED if base.line == DOTTED else DASHES[(DASHES.index(base.line) + number + 1) % len(DASHES)]
        return Look(_shaded(base.colour, SHADES[number % len(SHADES)]), marker, line)
    number = sum(other.partition("[")[0] not in BUILT_IN for other in known)
    return Look(OTHERS[number % len(OTHERS)], MARKERS[number % len(MARKERS)], DASHES[number % len(DASHES)])


def _shaded(colour: Any, by: float) -> str:
    """A colour moved towards black (negative) or white."""
    r, g, b = (c * (1 + by) if by < 0 else c + (1 - c) * by for c in to_rgb(colour))
    return to_hex((r, g, b))


def new_axes(width: float, height: float) -> Axes:
    """Axes of a figure of that size [in]."""
    return plt.subplots(figsize=(width, height), layout="constrained")[1]


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


def band(ax: Axes, x: Any, low: Any, high: Any, colour: Any, alpha: float = 0.15) -> None:
    """The intervals along a curve: a tinted band; of a centralised one, which is grey, its two edges."""
    if colour == GREY:
        ax.plot(x, low, x, high, color=colour, ls=DOTTED, lw=0.7, zorder=2)
    else:
        ax.fill_between(x, low, high, color=colour, alpha=alpha, lw=0, zorder=2)


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


def save(ax: Axes, *paths: Path, dpi: int = 150) -> None:
    """Write a figure to files without a date, so that the same numbers give the same bytes, and close it."""
    figure: Any = ax.figure
    dates = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with mpl.rc_context({"svg.hashsalt": "cooploc", "pdf.fonttype": 42}):
        for path in paths:
            figure.savefig(path, dpi=dpi, metadata=dates.get(path.suffix))
            if path.suffix == ".svg":
                path.write_text(round_coordinates(path.read_text("utf-8")), "utf-8")
    plt.close(figure)


def round_coordinates(svg: str, decimals: int = 2) -> str:
    """Return an SVG with the coordinates of its paths and marks rounded, in points: half as long."""
    return COORDINATES.sub(lambda found: DECIMALS.sub(lambda n: f"{float(n[0]):.{decimals}f}", found[0]), svg)

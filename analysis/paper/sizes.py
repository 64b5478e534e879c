"""The sizes and letters of IEEE's two-column journals: a column is 3.5 in wide, a page 7.16 in; small text has 8 pt.

Fonts are embedded as TrueType in PDF, and drawn as outlines in SVG, so that a figure looks the same everywhere.
"""

import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

COLUMNS = {1: 3.48, 2: 7.14}  # columns -> width [in]: IEEEtran's 21 and 43 picas, less a hair
TALLEST = 8.6  # [in]: a page less its caption
TEXT, SMALL = 8.0, 7.0  # [pt]
FORMATS = ("pdf", "svg")
LOOK: Any = {
    "font.family": ["STIXGeneral", "DejaVu Sans"],  # metrics of Times; the second for what the first lacks
    "font.size": TEXT,
    **dict.fromkeys(("axes.labelsize", "axes.titlesize", "legend.fontsize", "figure.labelsize"), TEXT),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize"), TEXT),
    "axes.titlelocation": "left",
    "axes.linewidth": 0.6,
    **dict.fromkeys(("xtick.major.width", "ytick.major.width"), 0.6),
    **dict.fromkeys(("xtick.minor.width", "ytick.minor.width"), 0.4),
    "pdf.fonttype": 42,
    "svg.fonttype": "path",
    "svg.hashsalt": "cooploc",
    "text.parse_math": False,  # labels are text, whatever they hold
    "figure.constrained_layout.w_pad": 0.02,
    "figure.constrained_layout.h_pad": 0.02,
}


def figure(height: float, columns: int, draw: Callable[[Figure], None]) -> Figure:
    """A figure of so many columns' width and a height [in], drawn in the look of the paper."""
    with mpl.rc_context(LOOK):
        made = Figure(figsize=(COLUMNS[columns], min(height, TALLEST)), layout="constrained")
        draw(made)
    return made


def save(made: Figure, path: Path) -> None:
    """Write a figure in every format; the same numbers give the same bytes."""
    with mpl.rc_context(LOOK), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")
        made.draw_without_rendering()
        made.set_layout_engine("none")  # it would be laid out again for each format, which takes longer than to draw
        for ending in FORMATS:
            dates = {"Date": None} if ending == "svg" else {"CreationDate": None, "Producer": None}
            made.savefig(path.with_suffix(f".{ending}"), metadata=dates)


@cache
def width(written: str, size: float = TEXT) -> float:
    """How wide a text is in Times [pt]."""
    prop = FontProperties(family=LOOK["font.family"], size=size)
    return float(text_to_path.get_text_width_height_descent(written or " ", prop, False)[0])

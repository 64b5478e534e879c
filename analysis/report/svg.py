"""Figures as SVG that can be put into a page: text stays text, ids are unique, nothing links elsewhere.

The same numbers give the same bytes.
"""

import io
import re
import warnings
from collections.abc import Callable
from typing import Any

import matplotlib as mpl
import seaborn as sns
from markupsafe import escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure

LOOK: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "cooploc",
    "font.sans-serif": ["DejaVu Sans"],
    "text.parse_math": False,  # labels are text, whatever they hold
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
}
PANEL, WIDE = (3.5, 2.7), (7.4, 3.5)  # [in]


def drawn(draw: Callable[[Axes], None], size: tuple[float, float], panel: bool = False) -> str:
    """One axes, as the text of an SVG file; a panel's labels are known to have room.

    To measure labels takes twice as long as to draw them.
    """
    with mpl.rc_context(LOOK), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # the reader's fonts draw the text
        figure = Figure(figsize=size, layout=None if panel else "constrained")
        share = PANEL[1] / size[1]  # a key is below
        ax = figure.add_axes((0.17, 1 - 0.82 * share, 0.77, 0.7 * share)) if panel else figure.add_subplot()
        draw(ax)
        sns.despine(ax=ax)
        ax.set_axisbelow(True)
        out = io.StringIO()
        figure.savefig(out, format="svg", metadata={"Date": None})
    return out.getvalue()


def inline(svg: str, number: int, label: str) -> str:
    """An SVG file's text to be put into a page: ids of its own, no links to other places, and a label."""
    body = svg[svg.index("<svg") :]
    body = re.sub(r"<(metadata|style).*?</\1>", "", body, flags=re.DOTALL)  # the page has the style
    body = re.sub(r' xmlns(:\w+)?="[^"]*"', "", body).replace("xlink:href=", "href=")
    body = _smaller(body)
    body = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>f{number}-", body)
    return re.sub(r"^<svg", f'<svg role="img" aria-label="{escape(label)}"', body)


def _smaller(svg: str) -> str:
    """Without ids that nothing uses, and with coordinates to a hundredth of a point: half as long."""
    used = set(re.findall(r'(?:url\(#|href="#)([^)"]+)', svg))
    svg = re.sub(r' id="([^"]*)"', lambda found: found[0] if found[1] in used else "", svg)
    svg = re.sub(r"\d+\.\d{3,}", lambda found: f"{float(found[0]):.2f}".rstrip("0").rstrip("."), svg)
    svg = svg.replace("font-family: 'DejaVu Sans', sans-serif; ", "")
    return re.sub(r">\s+<", "><", re.sub(r"\s*\n\s*", " ", svg))

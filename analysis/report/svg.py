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

from cooploc.analysis.report.colours import as_variables

LOOK: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "cooploc",
    "font.sans-serif": ["DejaVu Sans"],
    "text.parse_math": False,  # labels are text, whatever they hold
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
}
TAG, STYLE = re.compile(r"<[a-z][^<>]*>"), re.compile(r' style="([\w :;.,()#%-]*)"')
NUMBER = re.compile(r"\d+\.\d{2,}")
PANEL, WIDE = (3.5, 2.7), (7.4, 3.5)  # [in]


def drawn(draw: Callable[[Axes], None], size: tuple[float, float], panel: bool = False, left: float = 0.0) -> str:
    """One axes, as the text of an SVG file; a panel's labels have room, and so have labels that are `left` [in] wide.

    To measure labels takes twice as long as to draw them.
    """
    with mpl.rc_context(LOOK), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # the reader's fonts draw the text
        figure = Figure(figsize=size, layout=None if panel or left else "constrained")
        share = PANEL[1] / size[1]  # a key is below
        box = (0.17, 1 - 0.82 * share, 0.77, 0.7 * share) if panel else _beside(left, size)
        ax = figure.add_axes(box) if panel or left else figure.add_subplot()
        draw(ax)
        ax.minorticks_off()  # a sixth of the time and of the page
        sns.despine(ax=ax)
        ax.set_axisbelow(True)
        out = io.StringIO()
        figure.savefig(out, format="svg", metadata={"Date": None})
    return out.getvalue()


def _beside(left: float, size: tuple[float, float]) -> tuple[float, float, float, float]:
    """The axes beside labels that are `left` [in] wide, below a title and above a label."""
    width, height = size
    return left / width, 0.48 / height, (width - left - 0.15) / width, (height - 0.76) / height


def inline(svg: str, number: int, label: str) -> str:
    """An SVG file's text to be put into a page: own ids, no links, the page's colours, a label."""
    body = svg[svg.index("<svg") :]
    body = re.sub(r"<(metadata|style).*?</\1>", "", body, flags=re.DOTALL)  # the page has the style
    body = re.sub(r' xmlns(:\w+)?="[^"]*"', "", body).replace("xlink:href=", "href=")
    body = as_variables(_smaller(body))
    body = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>f{number}-", body)
    return body.replace("<svg", f'<svg role="img" aria-label="{escape(label)}"', 1)


def shared_styles(markup: str) -> tuple[str, str]:
    """A page's markup with classes instead of the styles that repeat themselves, and the CSS of these classes.

    Only tags are looked at, so that no text can be taken for a style: it has no angle brackets that are not escaped.
    """
    classes: dict[str, str] = {}

    def tag(found: re.Match[str]) -> str:
        style = STYLE.search(found[0])
        if style is None or " class=" in found[0]:
            return found[0]
        name = classes.setdefault(style[1], f"s{len(classes)}")
        return found[0].replace(style[0], f' class="{name}"')

    markup = TAG.sub(tag, markup)
    return markup, "\n".join(f".{name} {{ {style} }}" for style, name in classes.items())


def _smaller(svg: str) -> str:
    """Without what nothing uses, and with coordinates to a tenth of a point: less than half as long."""
    used = set(re.findall(r'(?:url\(#|href="#)([^")]+)', svg))
    svg = re.sub(r' id="([^"]*)"', lambda found: found[0] if found[1] in used else "", svg)
    svg = TAG.sub(lambda found: NUMBER.sub(lambda n: f"{float(n[0]):.1f}".removesuffix(".0"), found[0]), svg)
    svg = svg.replace("font-family: 'DejaVu Sans', sans-serif; ", "")
    svg = re.sub(r' transform="rotate\(-0 [^"]*\)"', "", svg)
    return _without_groups(re.sub(r">\s+<", "><", re.sub(r"\s*\n\s*", " ", svg)))


def _without_groups(svg: str) -> str:
    """Without groups that are empty or have no attributes."""
    kept: list[bool] = []

    def tag(found: re.Match[str]) -> str:
        if found[0].endswith("/>"):
            return ""
        if found[0] == "</g>":
            return found[0] if kept.pop() else ""
        if found[0].startswith("<g"):
            kept.append(found[0] != "<g>")
        return "" if found[0] == "<g>" else found[0]

    return re.sub(r"</?g\b[^<>]*>", tag, svg)

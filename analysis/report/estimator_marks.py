"""Every estimator's marker in its colour, as in the figures, for tables and lists."""

from collections.abc import Mapping

import numpy as np
from markupsafe import Markup
from matplotlib.colors import to_hex
from matplotlib.markers import MarkerStyle

from cooploc.analysis.plot.marks import colour_of
from cooploc.analysis.plot.style import Look
from cooploc.analysis.report.colours import variable


def symbols(looks: Mapping[str, Look]) -> Markup:
    """Each different marker once, as a symbol that `mark` uses."""
    drawn = {look.marker: None for look in looks.values()}
    parts = Markup("").join(
        Markup('<symbol id="marker-{}" viewBox="-1.3 -1.3 2.6 2.6"><path d="{}"/></symbol>').format(i, _path(marker))
        for i, marker in enumerate(drawn)
    )
    return Markup('<svg class="symbols" aria-hidden="true" width="0" height="0">{}</svg>').format(parts)


def marks(looks: Mapping[str, Look], centralised: set[str]) -> dict[str, Markup]:
    """The marker of each estimator; grey where it is centralised, as in the figures."""
    number = {marker: i for i, marker in enumerate(dict.fromkeys(look.marker for look in looks.values()))}
    use = Markup('<svg class="mark" aria-hidden="true" style="color: {}"><use href="#marker-{}"/></svg>')
    return {
        name: use.format(variable(to_hex(colour_of({"centralised": name in centralised}, look))), number[look.marker])
        for name, look in looks.items()
    }


def _path(marker: object) -> str:
    """A marker's outline in SVG, within a unit circle or so."""
    style = MarkerStyle(marker)  # type: ignore[arg-type]
    path = style.get_path().transformed(style.get_transform())
    size = float(np.abs(np.asarray(path.vertices, float)).max())
    letters = {1: "M", 2: "L", 3: "Q", 4: "C", 79: "Z"}
    out = []
    for points, code in path.iter_segments(simplify=False):
        values = " ".join(f"{v:.2f}" for v in _flipped(points, size))
        out.append(letters[int(code)] + ("" if int(code) == 79 else values))
    return "".join(out)


def _flipped(points: object, size: float) -> list[float]:
    """Coordinates whose y grows downwards."""
    values = [float(v) / size for v in points]  # type: ignore[attr-defined]
    return [-v if i % 2 else v for i, v in enumerate(values)]

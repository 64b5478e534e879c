"""A ledger as one picture: what was found beside what was claimed."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from cooploc.analysis.claims.kinds import RELATIVE
from cooploc.analysis.claims.ledger import BASE
from cooploc.analysis.plot import style
from cooploc.estimators.errors import BadInput

# verdict -> colour, marker and filling, apart in grey print too
LOOKS = {
    "supported": (style.GREEN, "o", style.GREEN),
    "direction only": (style.ORANGE, "D", "white"),
    "flat": (style.PURPLE, "P", "white"),
    "contradicted": (style.VERMILION, "X", style.VERMILION),
    "undecided": (style.BLUE, "s", "white"),
}
CLAIMED = style.DARK


def claims(verdicts: pd.DataFrame, variant: str = BASE, ax: Axes | None = None) -> Axes:
    """The claims that name a change: the one found in every case with its 95 % interval, and the one claimed.

    Args:
        verdicts: from `cooploc.analysis.claims.verdicts.judge`.
        variant: the reading of the paper; "paper" is the ledger's own.
        ax: where to draw; a new figure if None.

    Raises:
        BadInput: no claim of this variant names a change, or none was run.

    """
    drawn = verdicts[(verdicts["variant"] == variant) & verdicts["kind"].isin(RELATIVE) & verdicts["value"].notna()]
    drawn = drawn[drawn["size"].notna()]
    if drawn.empty:
        raise BadInput(f"no claim of the reading {variant!r} that names a change was run: see the column `verdict`")
    blocks = list(drawn.groupby(["claim", "says"], sort=False))
    ax = ax or style.new_axes(7.4, 0.6 + 0.42 * len(blocks) + 0.21 * len(drawn))
    y, ticks = 0.0, {}
    for (claim, says), block in blocks:
        head = {"xycoords": ("figure fraction", "data"), "annotation_clip": False, "in_layout": False}
        ax.annotate(f"{claim}. {says}", (0.01, y), fontsize=8, weight="bold", va="center", **head)  # type: ignore[arg-type]
        first = y + 0.6
        for row in block.to_dict("records"):
            y += 1
            _row(ax, row, y)
            ticks[y] = row["of"] + (f" vs {row['than']}" if row["than"] else "") + f", {row['scenario']}"
        ax.plot([100 * block["size"].iloc[0]] * 2, [first, y + 0.4], color=CLAIMED, lw=2, solid_capstyle="butt")
        y += 1.4
    ax.set_yticks(list(ticks), list(ticks.values()), fontsize=7)
    ax.set_ylim(y - 0.6, -0.8)
    _finish(ax, set(drawn["verdict"]))
    return ax


def _row(ax: Axes, row: dict[Any, Any], y: float) -> None:
    colour, marker, face = LOOKS[row["verdict"]]
    low, value, high = (100 * row[name] for name in ("low", "value", "high"))
    if np.isfinite([low, high]).all():
        ax.plot([low, high], [y, y], color=colour, lw=1.5)
    ax.plot(value, y, marker, mec=colour, mfc=face, ms=6)


def _finish(ax: Axes, found: set[str]) -> None:
    for verdict, (colour, marker, face) in LOOKS.items():
        if verdict in found:
            ax.plot([], [], marker, mec=colour, mfc=face, ms=6, label=verdict)
    ax.plot([], [], color=CLAIMED, lw=2, label="claimed")
    ax.axvline(0, color="0.7", lw=0.8, zorder=0)
    ax.tick_params(axis="y", length=0)
    style.finish(ax, "change of the RMSE [%] with its 95 % interval", grid="x")
    ax.spines["left"].set_visible(False)
    style.legend(ax, fontsize=8, loc="lower right", ncols=5)

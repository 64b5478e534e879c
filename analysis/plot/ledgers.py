"""A ledger of claims as pictures: its verdicts, and its claims over all readings of the paper."""

import textwrap
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from cooploc.analysis.claims.kinds import RELATIVE
from cooploc.analysis.claims.ledger import BASE
from cooploc.analysis.plot import style
from cooploc.estimators.errors import BadInput


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

"""One claim over all readings of its paper: effects with intervals, sorted, above the choices that they rest on.

Source: U. Simonsohn, J. Simmons, L. Nelson, "Specification curve analysis", Nature Human Behaviour 4, 2020.
"""

from typing import cast

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from cooploc.analysis.claims.kinds import KINDS
from cooploc.analysis.claims.multiverse import dimensions_of
from cooploc.analysis.plot import style
from cooploc.analysis.plot.claims_forest import CLAIMED, LOOKS
from cooploc.estimators.errors import BadInput

CASE = {"scenario": "scenario", "of": "estimator", "than": "against"}  # column -> head of its rows
ENDS = {"letter": "0.1", "preset": "0.5"}  # column -> colour of its lines
ANEES = 0.1, 1e4  # values beyond are drawn at the edge
WIDTH, CURVE, ROW = 8.0, 2.6, 0.155  # of the figure, and heights of the curve and of a row of the matrix [in]


def specification_curve(found: pd.DataFrame, claim: str, definition: str = "") -> Axes:
    """The number of a claim in every specification, sorted, and the choices of each as a matrix of marks.

    Dotted lines mark the specifications of the paper's letter and of the preset.

    Args:
        found: from `cl.readings`.
        claim: its id in the ledger.
        definition: of the size, "change" or "ratio"; the first that the claim has where not given.

    Returns:
        The axes of the curve; the matrix stands below in axes of its own.

    Raises:
        BadInput: no specification of this claim was run.

    """
    part = found[(found["claim"] == claim) & found["value"].notna()].sort_values("value", kind="stable")
    if part.empty:
        known = ", ".join(dict.fromkeys(found["claim"]))
        raise BadInput(f"no specification of claim {claim!r} was run; the run has those of {known or 'none'}")
    definition = definition or part["definition"].min()
    part = part[part["definition"] == definition]
    if part.empty:
        raise BadInput(f"claim {claim!r} has no size defined as {definition!r}: write change or ratio")
    rows = _choices(part)
    height = ROW * (len(rows) + 1)
    _, (curve, matrix) = plt.subplots(
        2, figsize=(WIDTH, CURVE + height + 0.3), height_ratios=(CURVE, height), sharex=True, layout="constrained"
    )
    _effects(curve, part)
    _matrix(matrix, part, rows)
    return cast(Axes, curve)


def _effects(ax: Axes, part: pd.DataFrame) -> None:
    kind, x = str(part["kind"].iloc[0]), np.arange(len(part))
    unit = 100.0 if KINDS[kind].unit is None else 1.0
    value, low, high = (unit * part[name].to_numpy(float) for name in ("value", "low", "high"))
    if kind == "consistency":  # collapsed clouds have an ANEES of any size
        value, low, high = (np.clip(number, *ANEES) for number in (value, low, high))
        ax.set_yscale("log")
    for verdict, (colour, marker, face) in LOOKS.items():
        some = (part["verdict"] == verdict).to_numpy()
        if some.any():
            ax.vlines(x[some], low[some], high[some], color=colour, lw=0.8, alpha=0.6)
            label = f"{verdict} ({some.sum()})"
            ax.plot(x[some], value[some], marker, ls="", mec=colour, mfc=face, ms=_size(len(part)), label=label)
    for size in part["size"].dropna().unique():
        ax.axhline(unit * size, color=CLAIMED, lw=1.5, ls=style.BROKEN, label="claimed", zorder=0)
    if KINDS[kind].unit is None:
        ax.axhline(0, color="0.6", lw=0.8, zorder=0)
    _limit(ax, value, low, high)
    _mark_ends(ax, part)
    what = {"level": "RMSE [m]", "slope": "exponent", "time": "time [s]", "consistency": "ANEES"}.get(
        kind, "change [%]"
    )
    as_ratio = " (as a ratio of errors)" * (part["definition"].iloc[0] == "ratio")
    style.finish(ax, "", what, f"Claim {part['claim'].iloc[0]}: {part['says'].iloc[0]}{as_ratio}", grid="y")
    ax.tick_params(axis="x", length=0)
    handles = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    ax.legend(
        handles.values(),
        handles,
        frameon=True,
        edgecolor="none",
        fontsize="small",
        loc="upper left",
        bbox_to_anchor=(0.0, 0.9),
    )


def _limit(ax: Axes, *values: np.ndarray) -> None:
    """Long intervals do not squeeze the curve: they leave the axes."""
    value = values[0]
    inside = np.concatenate(values)[np.isfinite(np.concatenate(values))]
    if ax.get_yscale() == "log":
        ax.set_ylim(inside.min() / 1.3, inside.max() * 1.3)
        return
    room = 0.35 * (np.ptp(value) or 1.0)
    ax.set_ylim(
        max(inside.min(), value.min() - room) - 0.05 * room, min(inside.max(), value.max() + room) + 0.05 * room
    )


def _mark_ends(ax: Axes, part: pd.DataFrame) -> None:
    """A dotted line at every specification of the letter and of the preset, named where the curve has room."""
    for end, colour in ENDS.items():
        for x in np.flatnonzero(part[end]).tolist():
            ax.axvline(x, color=colour, lw=0.8, ls=style.DOTTED, zorder=0)
            ax.annotate(
                end,
                (x, 1.0),
                xycoords=("data", "axes fraction"),
                fontsize=7,
                rotation=90,
                ha="right",
                va="top",
                color=colour,
            )


def _choices(part: pd.DataFrame) -> list[tuple[str, str]]:
    """The rows of the matrix: column and choice, where there is more than one; before each column its head."""
    rows: list[tuple[str, str]] = []
    for name in [*dimensions_of(part), *CASE]:
        choices = [choice for choice in dict.fromkeys(part.sort_index()[name]) if choice]
        if len(choices) > 1:
            rows += [(name, ""), *((name, choice) for choice in choices)]
    return rows


def _matrix(ax: Axes, part: pd.DataFrame, rows: list[tuple[str, str]]) -> None:
    colours = np.array([LOOKS[verdict][0] for verdict in part["verdict"]])
    for y, (name, choice) in enumerate(rows):
        if choice:
            x = np.flatnonzero(part[name] == choice)
            ax.vlines(x, y - 0.33, y + 0.33, color=colours[x], lw=0.6 * 62 * WIDTH / (len(part) + 2))
            ax.axhline(y, color=style.GRID, lw=0.5, zorder=0)
    labels = [f"{choice}   " if choice else CASE.get(name, name) for name, choice in rows]
    ax.set_yticks(range(len(rows)), labels, fontsize=7)
    for label, (_, choice) in zip(ax.get_yticklabels(), rows, strict=True):
        label.set_fontweight("normal" if choice else "bold")
    for end, colour in ENDS.items():
        for place in np.flatnonzero(part[end]).tolist():
            ax.axvline(place, color=colour, lw=0.8, ls=style.DOTTED, zorder=0)
    ax.set(ylim=(len(rows) - 0.5, -0.5), xlim=(-1, len(part)))
    style.finish(ax, "specifications, sorted by their number")
    ax.tick_params(axis="both", length=0, labelbottom=False)
    for side in ("left", "bottom"):
        ax.spines[side].set_visible(False)


def _size(specifications: int) -> float:
    """Of a marker [pt], so that neighbours do not cover each other."""
    return float(np.clip(250 / specifications, 1.5, 5))

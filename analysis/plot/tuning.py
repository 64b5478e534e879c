"""What tuning found: the gain against the budget, and how much each parameter mattered."""

from typing import cast

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes

from cooploc.analysis.plot import style
from cooploc.estimators.errors import BadInput, nearest

VALUE = "value: "  # before a parameter's name in the columns of `cl.tune(...).history`
ACROSS, WIDTH, HEIGHT = 3, 3.0, 2.4  # panels in a row, and the size of each [in]
WIDE = 20  # values over more than this factor have a logarithmic axis


def tuning(history: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """The gain of the best configuration so far, on training streams, against the trials that were used.

    The first mark of a line is the configuration as published, whose gain is 0. What is gained on training streams may
    be lost on fresh ones: the table of `cl.tune` has both.

    Args:
        history: of `cl.tune`.
        ax: where to draw; a new figure if None.

    """
    ax = ax or style.new_axes(7.0, 4.0)
    names = list(dict.fromkeys(history["estimator"]))
    for name, look in style.session_looks(names).items():
        part = history[history["estimator"] == name].sort_values("spent", kind="stable")
        best = part[part["best"]]
        x, y = [*best["spent"], part["spent"].iloc[-1]], [*best["gain"], best["gain"].iloc[-1]]
        ax.plot(x, y, color=look.colour, ls=look.line, lw=1.4, drawstyle="steps-post", label=name)
        ax.plot(best["spent"], best["gain"], color=look.colour, marker=look.marker, ls="none", ms=5)
    style.finish(ax, "training trials used", "gain of the mean score", "on training streams", grid="both")
    style.legend(ax)
    return ax


def tuned_parameters(history: pd.DataFrame, estimator: str) -> Axes:
    """The gain of every configuration of one estimator that was tried, over the value of each of its parameters.

    Filled marks ran all rounds, hollow ones were stopped early, after fewer trials; the cross is the configuration as
    published, and a circle is drawn around the one that was chosen.

    Args:
        history: of `cl.tune`.
        estimator: its label in the study.

    Returns:
        The axes of the first panel.

    Raises:
        BadInput: there is no such estimator in the history, or it has no parameter that was tuned.

    """
    known = list(dict.fromkeys(history["estimator"]))
    if estimator not in known:
        raise BadInput(f"there is no estimator {estimator!r} in this tuning; {nearest(estimator, known)}")
    part = history[history["estimator"] == estimator].dropna(axis=1, how="all")
    columns = [str(name) for name in part if str(name).startswith(VALUE)]
    if not columns:
        raise BadInput(f"{estimator!r} declares no parameter that may be tuned; choose another estimator")
    down = -(-len(columns) // ACROSS)
    size = (min(len(columns), ACROSS) * WIDTH, down * HEIGHT)
    figure, axes = plt.subplots(
        down, min(len(columns), ACROSS), figsize=size, sharey=True, squeeze=False, layout="constrained"
    )
    for k, (ax, column) in enumerate(zip(axes.flat, columns, strict=False)):
        _panel(ax, part, column, style.session_looks([estimator])[estimator].colour)
        label = "gain of the mean score" if k % ACROSS == 0 else ""
        style.finish(ax, column.removeprefix(VALUE), label, grid="y")
    for ax in list(axes.flat)[len(columns) :]:
        ax.set_visible(False)
    figure.suptitle(estimator, fontsize="medium")
    return cast(Axes, axes[0, 0])


def _panel(ax: Axes, part: pd.DataFrame, column: str, colour: str) -> None:
    """One parameter."""
    values = pd.to_numeric(part[column], errors="coerce")
    if values.isna().any():  # words, and true and false
        words = part[column].astype(str).str.lower()
        kinds = sorted(set(words))
        values = words.map(kinds.index).astype(float)
        ax.set_xticks(range(len(kinds)), kinds)
        ax.set_xlim(-0.5, len(kinds) - 0.5)
    elif values.min() > 0 and values.max() > WIDE * values.min():
        style.logarithmic(ax.xaxis, float(values.min()), float(values.max()))
    whole = part["state"] == "finished"
    ax.plot(values[whole], part["gain"][whole], "o", color=colour, ms=5)
    ax.plot(values[~whole], part["gain"][~whole], "o", color=colour, mfc="white", ms=5)
    chosen = part[part["best"]].index[-1]
    ax.plot(values.iloc[:1], part["gain"].iloc[:1], "x", color="black", ms=8, mew=2)
    ax.plot(values[[chosen]], part["gain"][[chosen]], "o", mfc="none", mec="black", ms=11)

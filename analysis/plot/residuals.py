"""What the readings of a team's recording are off by, after the models that were fitted."""

from pathlib import Path
from typing import cast

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from cooploc.analysis.plot import style
from cooploc.estimators.errors import BadInput
from cooploc.scenarios import resolve
from cooploc.scenarios.recordings.fit import Leftover
from cooploc.scenarios.recordings.scenario import TeamScenario

COLOURS = (style.BLUE, style.ORANGE, style.GREEN, style.PURPLE, style.BROWN, style.SKY)
MOST_LINKS = len(COLOURS)  # with a colour and a line of the legend of their own; further ones are grey
WIDTH, HEIGHT = 7.2, 2.6  # of the figure and of a panel [in]


def residuals(label: str, data: str | Path) -> Axes:
    """Reading less model over true distance, a row for each channel: where it was fitted, and where it is judged.

    Dashed: two standard deviations as filters are told. The right column looks at truth that is judged: choose nothing
    by it.

    Args:
        label: a run of a team, "log/RUN", or "log/all" for the first.
        data: its directory.

    Returns:
        The axes of the first panel; the others follow.

    Raises:
        BadInput: it is not a recording of a team, or has no readings with a true distance.

    """
    model = resolve(label, data).model
    if not isinstance(model, TeamScenario):
        raise BadInput(f"{label!r} is not a recording of a team; name one whose log.toml begins with format")
    found = [one for one in model.at([0]).leftovers() if len(one.residual)]
    whats = list(dict.fromkeys(one.what for one in found))
    if not whats:
        raise BadInput(f"{label!r} has no reading whose true distance is known; check the names in log.toml")
    size = WIDTH, HEIGHT * len(whats)
    _, axes = plt.subplots(len(whats), 2, figsize=size, sharex=True, sharey="row", squeeze=False, layout="constrained")
    for row, what in zip(axes, whats, strict=True):
        mine = [one for one in found if one.what == what]
        links = list(dict.fromkeys(one.link for one in mine))
        for ax, fitted in zip(row, (True, False), strict=True):
            _panel(ax, [one for one in mine if one.fitted == fitted], links)
        row[0].set_ylabel(f"{what}: residual [{mine[0].unit}]")
        row[0].legend(frameon=False, fontsize=7, markerscale=3)
    for ax, title in zip(axes[0], ("fitted on", "judged"), strict=True):
        ax.set_title(title, fontsize=9)
    for ax in axes[-1]:
        ax.set_xlabel("true distance [m]")
    return cast(Axes, axes[0, 0])


def _panel(ax: Axes, found: list[Leftover], links: list[str]) -> None:
    for one in found:
        k = links.index(one.link)
        named = k < MOST_LINKS
        colour = COLOURS[k] if named else style.GREY
        ax.plot(one.distance, one.residual, ".", ms=2, alpha=0.5, color=colour, label=one.link if named else None)
        for sign in (-2, 2):
            ax.axhline(sign * one.sigma, color=style.DARK, lw=0.8, ls="--")
    ax.axhline(0, color=style.DARK, lw=0.8)

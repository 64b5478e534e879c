"""Draws the figures of reports/paper from a run of the study `paper`, each as SVG and PDF.

Run: python reports/paper_figures.py RUN_DIR [OUT]. What a run does not hold yet is left out, and said.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

import cooploc as cl
from cooploc.analysis.claims import verdicts
from cooploc.analysis.claims.ledger import BASE, load
from cooploc.analysis.execution.stored_run import read
from cooploc.analysis.metrics.consistency import CONSERVATIVE, OVER_CONFIDENT
from cooploc.analysis.metrics.crlb import floors
from cooploc.analysis.metrics.curves import over_time, swept
from cooploc.analysis.metrics.errors import stream_hash
from cooploc.analysis.metrics.smoother import LABEL as HINDSIGHT
from cooploc.analysis.plot import style
from cooploc.analysis.plot.ellipses import ellipse
from cooploc.analysis.plot.marks import colour_of, curve, drawable, name_of, rmse_against, span

mpl.use("agg")
MAIN = (
    "dead-reckoning", "arl", "rssi-pf", "mrsl-rssi", "mrsl-distance", "ctrn[weights=exact]", "ekf-local", "ekf-joint",
)  # fmt: skip
LOOKS = style.looks(MAIN)
HATCHES = dict(zip(MAIN, ("", "///", "...", "\\\\\\", "xxx", "---", "++", "oo"), strict=True))
PATHS = ("arl", "mrsl-rssi", "ctrn[weights=exact]", "ekf-joint")
SEED, TRIALS_OVER_TIME = 1, 100


def main(run: str, out: str = "reports/paper") -> None:
    """Draw what the run holds."""
    kept = read(Path(run))
    rows = kept.rows[kept.rows["estimator"].isin(MAIN)]
    table = drawable(rows)
    drawn = [
        label for label in dict.fromkeys(table["scenario"]) if any(fits(label, wanted) for _, _, wanted, _ in FIGURES)
    ]
    table["floor"] = table["scenario"].map(floors(drawn, kept.manifest["seed"]))
    hashes = {scenario: stream_hash(part) for scenario, part in rows.groupby("scenario", sort=False)}
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    captions = []
    for name, title, wanted, draw in FIGURES:
        part = table[[fits(label, wanted) for label in table["scenario"]]]
        if part.empty:
            print(f"{name}: the run has none of {wanted}")
            continue
        axes = draw(part)
        trials = sorted(set(part["trials"]))
        counted = str(trials[0]) if len(trials) == 1 else f"{trials[0]} to {trials[-1]}"
        streams = ", ".join(f"{label} {hashes[label][:8]}" for label in dict.fromkeys(part["scenario"]))
        captions.append(f"**{name}** {title} n = {counted} trials, seed {kept.manifest['seed']}. Streams: {streams}.")
        keep(axes, folder / name)
    for name, title, axes in (trajectories(), time_course(), ledger(kept.rows)):
        captions.append(f"**{name}** {title}")
        keep(axes, folder / name)
    text = "\n\n".join([CAPTION, *captions])
    (folder / "figures.md").write_text(f"# Figures\n\n{text}\n", encoding="utf-8")


CAPTION = (
    "Whiskers and bands are 95 % intervals over trials (jackknife on the logarithm); no test is drawn in a figure: "
    "paired tests with Holm's correction are in the tables. Hollow markers, and hatching on white: over-confident, "
    "as the README defines it. Grey: a bound, which knows more than any robot could. Dotted: the posterior "
    "Cramer-Rao floor of any estimator that hears and uses everything, where it holds."
)


def fits(label: str, wanted: str) -> bool:
    """Whether a scenario belongs to a family, or to a sweep `family/key=`, without options in brackets."""
    return "[" not in label and (label == wanted or label.startswith(f"{wanted.split('/')[0]}/"))


def keep(ax: Axes, path: Path) -> None:
    """As SVG and PDF, without dates, so that the same run gives the same files."""
    figure: Any = ax.figure
    with mpl.rc_context({"svg.hashsalt": "cooploc", "pdf.fonttype": 42}):
        figure.savefig(path.with_suffix(".svg"), metadata={"Date": None})
        figure.savefig(path.with_suffix(".pdf"), metadata={"CreationDate": None})
    plt.close(figure)


def bars(part: pd.DataFrame) -> Axes:
    """RMSE by scenario, a bar for each estimator."""
    scenarios = list(dict.fromkeys(part["scenario"]))
    names = present(part)
    ax = style.new_axes(max(7.0, 2.2 * len(scenarios)), 3.4)
    width = 0.86 / len(names)
    for i, name in enumerate(names):
        mine = part[part["estimator"] == name].set_index("scenario").reindex(scenarios)
        colour = colour_of(part[part["estimator"] == name].iloc[0], LOOKS[name])
        x = np.arange(len(scenarios)) + (i - (len(names) - 1) / 2) * width
        around = np.abs(mine[["rmse_low", "rmse_high"]].to_numpy().T - mine["rmse"].to_numpy())
        boxes = ax.bar(x, mine["rmse"], width, yerr=around, error_kw={"lw": 1, "capsize": 2})
        for box, solid in zip(boxes, mine["consistency"] != "over-confident", strict=True):
            box.set(facecolor=colour if solid else "white", hatch=HATCHES[name], linewidth=1)
            box.set_edgecolor("0.25" if solid else colour)
        ax.bar(0, 0, facecolor=colour, hatch=HATCHES[name], edgecolor="0.25", label=name)
    floor = part.groupby("scenario")["floor"].first().reindex(scenarios)
    middle = np.arange(len(scenarios))
    ax.hlines(floor, middle - 0.45, middle + 0.45, color="black", ls=style.DOTTED, lw=1.2)
    ax.set_xticks(range(len(scenarios)), scenarios)
    return finish(ax, "")


def present(part: pd.DataFrame) -> list[str]:
    """Those of `MAIN` that a table has."""
    known = set(part["estimator"])
    return [name for name in MAIN if name in known]


def finish(ax: Axes, xlabel: str) -> Axes:
    """Labels, a grid, and the legend beside it."""
    style.finish(ax, xlabel, "position RMSE [m]", grid="both" if xlabel else "y")
    style.legend(ax, fontsize=8)
    return ax


def sweep(xlabel: str, log: bool = False) -> Callable[[pd.DataFrame], Axes]:
    """RMSE over what the scenarios sweep, a line for each estimator."""

    def draw(part: pd.DataFrame) -> Axes:
        part = swept(part)
        part = part[np.isfinite(part["value"])].sort_values("value")
        ax = style.new_axes(7.4, 3.8)
        for name in present(part):
            curve(ax, part[part["estimator"] == name], "value", LOOKS[name], label=name)
        floor = part.groupby("value")["floor"].first()
        ax.plot(floor.index, floor, color="black", ls=style.DOTTED, lw=1.2, label="floor")
        style.logarithmic(ax.yaxis, *span(part, "rmse", "floor"))
        if log:
            ax.set_xscale("log")
            ax.set_xticks([1, 2, 5, 10, 20, 50, 100], ["1", "2", "5", "10", "20", "50", "100"])
            ax.xaxis.set_minor_formatter(mpl.ticker.NullFormatter())
        return finish(ax, xlabel)

    return draw


def scatter(other: str, xlabel: str) -> Callable[[pd.DataFrame], Axes]:
    """RMSE against ANEES or a cost, a point for each estimator, with both intervals where there are any."""

    def draw(part: pd.DataFrame) -> Axes:
        ax = style.new_axes(6.4, 3.8)
        if other == "anees":
            ax.axvspan(CONSERVATIVE, OVER_CONFIDENT, color=style.BAND, zorder=0)
            style.logarithmic(ax.xaxis, *span(part, "anees", "anees_low", "anees_high"))
        for row in part.to_dict("records"):
            rmse_against(ax, other, row, LOOKS[row["estimator"]], label=name_of(row))
        return finish(ax, xlabel)

    return draw


def trajectories() -> tuple[str, str, Axes]:
    """Robot 0 of trial 0 as four estimators see it, with the 95 % ellipse of every tenth tick."""
    truth, stream = cl.simulate("trajectory", trials=1, seed=SEED)
    run = cl.run({name: cl.make(name) for name in PATHS}, stream)
    _, axes = plt.subplots(2, 2, figsize=(7.4, 7.4), layout="constrained", sharex=True, sharey=True)
    for ax, name in zip(axes.flat, PATHS, strict=True):
        x, P = run.traces[name].x[0, :, 0], run.traces[name].P[0, :, 0]
        ax.plot(*truth.x[0, :, 0, :2].T, color="black", lw=1.2, label="truth")
        ax.plot(*x[:, :2].T, color=LOOKS[name].colour, lw=1.0, ls="--", label="estimate")
        for k in range(9, len(x), 10):
            ax.add_patch(ellipse(x[k], P[k], ec=LOOKS[name].colour, lw=0.7))
        ax.plot(*stream.world.anchors.T, "s", color="0.3", ms=5)
        ax.set_title(name, loc="left", fontsize=9)
        ax.set_aspect("equal")
    axes[0, 0].legend(frameon=False, fontsize=8)
    axes[1, 0].set_xlabel("x [m]")
    axes[1, 0].set_ylabel("y [m]")
    title = f"Robot 0 in trial 0 of `trajectory`, seed {SEED}, stream {stream.hashes[0][:8]}; 95 % ellipses at times."
    return "trajectories", title, axes[0, 0]


def time_course() -> tuple[str, str, Axes]:
    """RMSE at every tick."""
    truth, stream = cl.simulate("trajectory", trials=TRIALS_OVER_TIME, seed=SEED)
    names = [name for name in MAIN if name != "dead-reckoning"]
    table = over_time(truth, cl.run({name: cl.make(name) for name in names}, stream))
    ax = style.new_axes(7.4, 3.6)
    for name in names:
        mine = table[table["estimator"] == name]
        style.band(ax, mine["tick"], mine["rmse_low"], mine["rmse_high"], LOOKS[name].colour)
        ax.plot(mine["tick"], mine["rmse"], color=LOOKS[name].colour, ls=LOOKS[name].line, lw=1.3, label=name)
    known = np.sqrt(((cl.smoother(stream) - truth.x[..., :2]) ** 2).sum(-1).mean((0, 2)))
    ax.plot(known, color="black", ls=style.BROKEN, lw=1.0, label=HINDSIGHT, zorder=1)
    ax.set_ylim(0)
    title = f"`trajectory` over time, n = {TRIALS_OVER_TIME} trials, seed {SEED}, stream {stream.hash[:8]}."
    return "over-time", title, finish(ax, "tick")


def ledger(rows: pd.DataFrame) -> tuple[str, str, Axes]:
    """What was found beside what was claimed."""
    judged = verdicts.judge(load(), rows)
    trials = int(judged.loc[judged["variant"] == BASE, "trials"].max())
    title = f"Claims that name a change, in the `paper` reading; 95 % intervals over n = {trials} paired trials."
    return "claims", title, cl.plot.claims(judged)


FIGURES: tuple[tuple[str, str, str, Callable[[pd.DataFrame], Axes]], ...] = (
    ("robots-1-3", "One to three robots in the 6 m arena.", "robots-1-3/n=", bars),
    ("scalability", "Error against the number of robots.", "scalability/n=", sweep("robots", log=True)),
    ("nlos", "Walls and wandering obstacles; bias: of ranges without line of sight [m].", "nlos", bars),
    ("packet-drop", "Five robots that lose packets.", "packet-drop/drop=", sweep("share of packets lost")),
    ("arena-60m", "The 60 m arena by the sd of the initial position [m].", "arena-60m/sd=", bars),
    (
        "consistency",
        "Accuracy against consistency, three robots; grey: neither over-confident nor conservative.",
        "trajectory",
        scatter("anees", "ANEES (1 is consistent)"),
    ),
    (
        "bytes",
        "Accuracy against what is sent, three robots.",
        "trajectory",
        scatter("bytes", "bytes per robot and tick"),
    ),
)

if __name__ == "__main__":
    main(*sys.argv[1:])

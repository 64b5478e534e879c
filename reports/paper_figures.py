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
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse

import cooploc as cl
from cooploc.analysis.claims import verdicts
from cooploc.analysis.claims.ledger import BASE, load
from cooploc.analysis.execution.stored_run import read
from cooploc.analysis.metrics.compare import summarize
from cooploc.analysis.metrics.consistency import consistency
from cooploc.analysis.metrics.crlb import floors
from cooploc.analysis.metrics.over_time import over_time, swept
from cooploc.analysis.metrics.pooling import stream_hash
from cooploc.analysis.report.svg_figures import GREY, styles

mpl.use("agg")
MAIN = (
    "dead-reckoning", "arl", "rssi-pf", "mrsl-rssi", "mrsl-distance", "ctrn[weights=exact]", "ekf-local", "ekf-joint",
)  # fmt: skip
LOOKS = styles(list(MAIN))
HATCHES = ("", "///", "...", "\\\\\\", "xxx", "---", "++", "oo")
PATHS = ("arl", "mrsl-rssi", "ctrn[weights=exact]", "ekf-joint")
SEED, TRIALS_OVER_TIME = 1, 100


def main(run: str, out: str = "reports/paper") -> None:
    """Draw what the run holds."""
    kept = read(Path(run))
    rows = kept.rows[kept.rows["estimator"].isin(MAIN)]
    table = summarize(rows)
    table["consistency"] = consistency(table)
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
    "Cramer-Rao floor of whoever hears and uses everything, where it holds."
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
    names = [name for name in MAIN if name in set(part["estimator"])]
    _, ax = plt.subplots(figsize=(max(7.0, 2.2 * len(scenarios)), 3.4), layout="constrained")
    width = 0.86 / len(names)
    for i, name in enumerate(names):
        mine = part[part["estimator"] == name].set_index("scenario").reindex(scenarios)
        x = np.arange(len(scenarios)) + (i - (len(names) - 1) / 2) * width
        colour = GREY if name == "ekf-joint" else LOOKS[name].colour
        honest = (mine["consistency"] != "over-confident").to_numpy()
        around = np.abs(mine[["rmse_low", "rmse_high"]].to_numpy().T - mine["rmse"].to_numpy())
        boxes = ax.bar(x, mine["rmse"], width, edgecolor=colour, yerr=around, error_kw={"lw": 1, "capsize": 2})
        for box, solid in zip(boxes, honest, strict=True):
            box.set(facecolor=colour if solid else "white", hatch=HATCHES[i], linewidth=1)
            box.set_edgecolor("0.25" if solid else colour)
        ax.bar(0, 0, facecolor=colour, hatch=HATCHES[i], edgecolor="0.25", label=name)
    least = part.groupby("scenario")["floor"].first().reindex(scenarios)
    ax.hlines(least, np.arange(len(scenarios)) - 0.45, np.arange(len(scenarios)) + 0.45, color="black", ls=":", lw=1.2)
    ax.set_xticks(range(len(scenarios)), scenarios)
    ax.set_ylabel("position RMSE [m]")
    ax.legend(frameon=False, fontsize=8, bbox_to_anchor=(1.0, 1.0), loc="upper left")
    sns.despine(ax=ax)
    return ax


def dressed(ax: Axes, xlabel: str) -> Axes:
    """Labels, a grid, and the legend beside it."""
    ax.set_xlabel(xlabel)
    ax.set_ylabel("position RMSE [m]")
    ax.grid(color="0.9", lw=0.8)
    ax.legend(frameon=False, fontsize=8, bbox_to_anchor=(1.0, 1.0), loc="upper left")
    sns.despine(ax=ax)
    return ax


def sweep(xlabel: str, log: bool = False) -> Callable[[pd.DataFrame], Axes]:
    """RMSE over what the scenarios sweep, a line for each estimator."""

    def draw(part: pd.DataFrame) -> Axes:
        part = swept(part)
        part = part[np.isfinite(part["value"])]
        _, ax = plt.subplots(figsize=(7.4, 3.8), layout="constrained")
        for name in (name for name in MAIN if name in set(part["estimator"])):
            mine = part[part["estimator"] == name].sort_values("value")
            colour = GREY if name == "ekf-joint" else LOOKS[name].colour
            ax.fill_between(mine["value"], mine["rmse_low"], mine["rmse_high"], color=colour, alpha=0.2, lw=0)
            ax.plot(mine["value"], mine["rmse"], color=colour, ls=LOOKS[name].line, lw=1.3, label=name)
            for hollow in (False, True):
                which = mine[(mine["consistency"] == "over-confident") == hollow]
                face = "white" if hollow else colour
                ax.plot(which["value"], which["rmse"], LOOKS[name].marker, mfc=face, mec=colour, ms=4.5)
        least = part.groupby("value")["floor"].first()
        ax.plot(least.index, least, color="black", ls=":", lw=1.2, label="floor")
        ax.set_yscale("log")
        ax.yaxis.set_major_formatter(mpl.ticker.FuncFormatter(lambda v, _: f"{v:g}"))
        ax.yaxis.set_major_locator(mpl.ticker.LogLocator(subs=(1, 2, 5)))
        ax.yaxis.set_minor_formatter(mpl.ticker.NullFormatter())
        if log:
            ax.set_xscale("log")
            ax.set_xticks([1, 2, 5, 10, 20, 50, 100], ["1", "2", "5", "10", "20", "50", "100"])
            ax.xaxis.set_minor_formatter(mpl.ticker.NullFormatter())
        return dressed(ax, xlabel)

    return draw


def scatter(other: str, xlabel: str) -> Callable[[pd.DataFrame], Axes]:
    """RMSE against ANEES or a cost, a point for each estimator, with both intervals where there are any."""

    def draw(part: pd.DataFrame) -> Axes:
        _, ax = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
        if other == "anees":
            ax.axvspan(0.67, 1.5, color="0.93", zorder=0)
        for row in part.to_dict("records"):
            name = row["estimator"]
            colour = GREY if name == "ekf-joint" else LOOKS[name].colour
            face = "white" if row["consistency"] == "over-confident" else colour
            ax.plot([row[other]] * 2, [row["rmse_low"], row["rmse_high"]], color=colour, lw=1.2)
            if other == "anees":
                ax.plot([row["anees_low"], row["anees_high"]], [row["rmse"]] * 2, color=colour, lw=1.2)
            ax.plot(row[other], row["rmse"], LOOKS[name].marker, mfc=face, mec=colour, ms=7, ls="none", label=name)
        if other == "anees":
            ax.set_xscale("log")
            ax.xaxis.set_major_formatter(mpl.ticker.FuncFormatter(lambda v, _: f"{v:g}"))
        return dressed(ax, xlabel)

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
            ax.add_patch(ellipse(x[k, :2], P[k, :2, :2], LOOKS[name].colour))
        ax.plot(*stream.world.anchors.T, "s", color="0.3", ms=5)
        ax.set_title(name, loc="left", fontsize=9)
        ax.set_aspect("equal")
    axes[0, 0].legend(frameon=False, fontsize=8)
    axes[1, 0].set_xlabel("x [m]")
    axes[1, 0].set_ylabel("y [m]")
    title = f"Robot 0 in trial 0 of `trajectory`, seed {SEED}, stream {stream.hashes[0][:8]}; 95 % ellipses at times."
    return "trajectories", title, axes[0, 0]


def ellipse(middle: Any, P: Any, colour: Any) -> Ellipse:
    """The 95 % ellipse of a Gaussian."""
    values, vectors = np.linalg.eigh(P)
    width, height = 2 * np.sqrt(values * -2 * np.log(0.05))
    angle = np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0]))
    return Ellipse(tuple(middle), width, height, angle=angle, fill=False, ec=colour, lw=0.7)


def time_course() -> tuple[str, str, Axes]:
    """RMSE at every tick."""
    truth, stream = cl.simulate("trajectory", trials=TRIALS_OVER_TIME, seed=SEED)
    names = [name for name in MAIN if name != "dead-reckoning"]
    curve = over_time(truth, cl.run({name: cl.make(name) for name in names}, stream))
    _, ax = plt.subplots(figsize=(7.4, 3.6), layout="constrained")
    for name in names:
        mine = curve[curve["estimator"] == name]
        colour = GREY if name == "ekf-joint" else LOOKS[name].colour
        ax.fill_between(mine["tick"], mine["rmse_low"], mine["rmse_high"], color=colour, alpha=0.15, lw=0)
        ax.plot(mine["tick"], mine["rmse"], color=colour, ls=LOOKS[name].line, lw=1.3, label=name)
    ax.set_ylim(0)
    dressed(ax, "tick")
    title = f"`trajectory` over time, n = {TRIALS_OVER_TIME} trials, seed {SEED}, stream {stream.hash[:8]}."
    return "over-time", title, ax


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

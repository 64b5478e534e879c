"""Values of reports/text/paper.md.j2 from a run of the study `paper`: the verdicts and the figures, drawn as SVG."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from study_numbers import read_run

import cooploc as cl
from cooploc.analysis.claims import verdicts
from cooploc.analysis.claims.ledger import BASE, load
from cooploc.analysis.metrics.crlb import floors
from cooploc.analysis.metrics.errors import stream_hash
from cooploc.analysis.plot import style
from cooploc.analysis.report import claim_tables

MAIN = (
    "dead-reckoning", "arl", "rssi-pf", "mrsl-rssi", "mrsl-distance", "ctrn[weights=exact]", "ekf-local", "ekf-joint",
)  # fmt: skip
PATHS = ("arl", "mrsl-rssi", "ctrn[weights=exact]", "ekf-joint")
SEED, TRIALS_OVER_TIME, FLOORS = 1, 100, 14  # floors are drawn of every fourth team where there are 57
FEW = 6  # scenarios whose streams a caption names
SWEPT = {  # figure -> its caption, and the scenarios in it
    "robots-1-3": ("One to three robots in the 6 m arena.", "robots-1-3/n="),
    "scalability": ("Error against the number of robots.", "scalability/n="),
    "nlos": ("Walls and wandering obstacles; bias: of ranges without line of sight [m].", "nlos"),
    "packet-drop": ("Five robots that lose packets.", "packet-drop/drop="),
    "arena-60m": ("The 60 m arena by the sd of the initial position [m].", "arena-60m/sd="),
}
CAPTION = (
    "Whiskers and bands are 95 % intervals over trials (jackknife on the logarithm); no test is drawn in a figure: "
    "paired tests with Holm's correction are in the tables. Hollow markers: over-confident, as the README defines it. "
    "Grey: a bound, which knows more than any robot could. Dotted: the posterior Cramer-Rao floor of any estimator "
    "that hears and uses everything, where it holds."
)


def values(runs: Path, out: Path, data: Path) -> dict[str, Any]:
    """Return the words of the text, and draw its figures."""
    kept, ledger = read_run(runs / "paper"), load()
    judged = verdicts.judge(ledger, kept.rows)
    captions = []
    for name, title, axes in _figures(kept.rows[kept.rows["estimator"].isin(MAIN)], kept.manifest["seed"], judged):
        style.save(axes, out / f"{name}.svg")
        captions.append({"name": name, "title": title})
    table = claim_tables.overview(verdicts.overview(judged), judged, ledger)
    return {"verdicts": table.markdown().strip(), "caption": CAPTION, "figures": captions}


def _figures(rows: pd.DataFrame, seed: int, judged: pd.DataFrame) -> Iterator[tuple[str, str, Axes]]:
    """Yield name, caption and axes of every figure."""
    labels = list(dict.fromkeys(rows["scenario"]))
    for name, (title, family) in SWEPT.items():
        begin = f"{family.split('/')[0]}/"
        if chosen := [label for label in labels if "[" not in label and (label == family or label.startswith(begin))]:
            part = rows[rows["scenario"].isin(chosen)]
            lowest = floors(chosen[:: len(chosen) // FLOORS or 1], seed)
            yield name, f"{title} {_made_of(part, seed)}", cl.plot.rmse(part, floors=lowest)
    if "trajectory" in labels:
        part = rows[rows["scenario"] == "trajectory"]
        made_of = _made_of(part, seed)
        title = "Accuracy against consistency, three robots; grey: neither over-confident nor conservative."
        yield "consistency", f"{title} {made_of}", cl.plot.tradeoff(part)
        yield "bytes", f"Accuracy against what is sent, three robots. {made_of}", cl.plot.pareto(part)
    truth, stream = cl.simulate("trajectory", trials=1, seed=SEED)
    title = f"Robot 0 in trial 0 of `trajectory`, seed {SEED}, stream {stream.hashes[0][:8]}; 95 % ellipses at times."
    yield "trajectories", title, cl.plot.trajectories(truth, cl.run(list(PATHS), stream))
    truth, stream = cl.simulate("trajectory", trials=TRIALS_OVER_TIME, seed=SEED)
    run = cl.run([name for name in MAIN if name != "dead-reckoning"], stream)
    title = f"`trajectory` over time, n = {TRIALS_OVER_TIME} trials, seed {SEED}, stream {stream.hash[:8]}."
    yield "over-time", title, cl.plot.error_over_time(truth, run)
    n = int(judged.loc[judged["variant"] == BASE, "trials"].max())
    title = f"Claims that name a change, in the `paper` reading; 95 % intervals over n = {n} paired trials."
    yield "claims", title, cl.plot.claims(judged)


def _made_of(part: pd.DataFrame, seed: int) -> str:
    """Say how many trials a figure has, and of which streams where they are few."""
    trials = sorted(set(part.groupby("scenario")["trial"].nunique()))
    counted = f"n = {' to '.join(map(str, dict.fromkeys((trials[0], trials[-1]))))} trials, seed {seed}."
    streams = [f"{label} {stream_hash(rows)[:8]}" for label, rows in part.groupby("scenario", sort=False)]
    return counted + (f" Streams: {', '.join(streams)}." if len(streams) <= FEW else "")

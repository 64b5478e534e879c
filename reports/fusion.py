"""Values of reports/text/fusion.md.j2 from a run of the study `fusion` and from MRCLAM, and its figure.

The recording is run here, in a minute or two, to be cut into pieces.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from page import pipe_by_scenario

import cooploc as cl
from cooploc.analysis.execution.run_directory import RunDir
from cooploc.analysis.formats import change, count, metres, percent, ratio
from cooploc.analysis.metrics.consistency import OVER_CONFIDENT
from cooploc.analysis.metrics.statistics import FIXED
from cooploc.analysis.plot import style
from cooploc.analysis.plot.results import frontier
from cooploc.analysis.report.tables import Table, interval_column, number_column, text_column

BASELINE = "ekf-local"
PIECE = 63.0  # [s] of the recording, whose 756 s make twelve
SHORT = {r"\[density=exact,M=1,K=1.*\]": "", r"\[anchor_reading=doa\]": ""}
PLAIN = "ekf-joint[iterations=1,second_order=false,update=sequential]"
REAL = (
    *("ekf-local", "ekf-naive", "ekf-ci", "ekf-event-ci", "ekf-split-ci", "ekf-split-ci[form=conservative]", "ekf-ici"),
    *("ekf-ici[form=fixed]", "ekf-hmd", "ekf-hmd[weight=0.8]", "ekf-gs-ci", "ekf-luft", "ekf-interim", "gbp"),
    *("ekf-event-ci[threshold=0.01]", "ekf-gs-ci[period=10]", "cmrl", "channel-pf", "reciprocal-pf"),
    *("iekf-joint", "ukf-joint", "ekf-joint", PLAIN, "ekf-joint[loss=student]"),
)


def values(runs: Path, out: Path, data: Path) -> dict[str, Any]:
    """Return the words of the text, and draw its figure."""
    stored = cl.load_run(runs / "fusion")
    errors = stored.rows.assign(estimator=stored.rows["estimator"].replace(SHORT, regex=True))
    style.save(cl.plot.pareto(errors), out / "fusion.svg")
    table = cl.compare(errors, baseline=BASELINE, full=True)
    real = over_pieces(data / "mrclam6")
    decentral = table[~table["centralised"].astype(bool) & (table["bytes"] > 0)]
    lossy, won = table["scenario"].str.contains("drop=0.7"), table["change_high"] < 0
    before, after, known = (
        set(zip(rows["estimator"], rows["robots"], strict=True))
        for rows in (table[won & ~lossy], table[won & lossy], table[lossy])
    )
    flags = [f"{flag}, {ratio(anees)}" for flag, anees in zip(table["consistency"], table["anees"], strict=True)]
    return {
        "trials": table["trials"].max(),
        "seed": RunDir(Path(stored)).manifest["seed"],
        "flags": decentral.groupby("estimator", sort=False)["consistency"].agg(list).to_dict(),
        "frontiers": {name: frontier(rows).to_dict("records") for name, rows in table.groupby("scenario", sort=False)},
        "gone": sorted((before - after) & known),
        "baseline": BASELINE,
        "real": real,
        "limit": OVER_CONFIDENT,
        "consistency": pipe_by_scenario(table.replace({"scenario": {"^scalability/": ""}}, regex=True), flags),
        "numbers": _numbers(table, "rules").markdown(),
        "mrclam": _numbers(real, "mrclam", pose=True).markdown(),
        "seconds": f"{PIECE * real['trials'].max():.0f}",
        "pieces": real["trials"].max(),
        "piece": f"{PIECE:.0f}",
    }


def over_pieces(data: Path) -> pd.DataFrame:
    """Return the table of `compare` over pieces of the recording, with `pose_nees` and the ends of its interval."""
    found = []
    for view in ("all", "one", "none"):
        truth, stream = cl.simulate(f"mrclam/{view}", data=data)
        run = cl.run(REAL, stream)
        place = np.floor((stream.time - stream.time[0]) / PIECE)
        valid = (truth.valid & (place == k)[None, :, None] for k in np.unique(place))
        for k, mask in enumerate(mask for mask in valid if mask.any()):  # each piece is a trial of its own
            frame = cl.errors(replace(truth, valid=mask), run)
            found.append(frame.assign(trial=k, stream=frame["stream"] + f"/{k}"))
    errors = pd.concat(found, ignore_index=True)
    table = cl.compare(errors, baseline=BASELINE, full=True)
    pose = errors.groupby(["scenario", "estimator", "trial"], sort=False)["pose_nees"].mean().dropna()
    names = ["pose_nees", "pose_nees_low", "pose_nees_high"]
    ends = {key: FIXED.mean_of_positive(one.to_numpy(float)) for key, one in pose.groupby(["scenario", "estimator"])}
    return table.join(pd.DataFrame(ends, index=names).T, on=["scenario", "estimator"])


def _numbers(table: pd.DataFrame, name: str, pose: bool = False) -> Table:
    nees = "pose_nees" if pose else "anees"
    columns = (
        text_column("scenario"),
        text_column("estimator"),
        interval_column("RMSE [m]", "rmse", metres),
        interval_column(f"against {BASELINE}", "change", change),
        interval_column("ANEES (pose)" if pose else "ANEES", nees, ratio),
        interval_column("in the 95 % ellipse", "coverage95", percent),
        number_column("bytes", "bytes", form=count),
    )
    return Table(name, "Means with 95 % intervals; bytes per robot and tick.", columns, table.to_dict("records"))

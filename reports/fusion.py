"""Values of reports/text/fusion.md.j2 from a run of the study `fusion` and from MRCLAM, and its figure.

The recording is run here, in a minute or two, to be cut into pieces.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import cooploc as cl
from cooploc.analysis.formats import change, count, interval, join_words, metres, percent, ratio
from cooploc.analysis.metrics.consistency import OVER_CONFIDENT
from cooploc.analysis.metrics.statistics import mean_of_positive
from cooploc.analysis.plot import style
from cooploc.analysis.plot.results import frontier
from cooploc.analysis.report.tables import Table, interval_column, number_column, text_column
from cooploc.api import stored_run

BASELINE = "ekf-local"
PIECE = 63.0  # [s] of the recording, whose 756 s make twelve
SHORT = {r"\[density=exact,M=1,K=1.*\]": "", r"\[anchor_reading=doa\]": ""}
REAL = (
    *("ekf-local", "ekf-naive", "ekf-ci", "ekf-event-ci", "ekf-split-ci", "ekf-split-ci[form=conservative]", "ekf-ici"),
    *("ekf-ici[form=fixed]", "ekf-hmd", "ekf-hmd[weight=0.8]", "ekf-gs-ci", "ekf-luft", "ekf-interim", "gbp"),
    *("ekf-joint", "iekf-joint", "ukf-joint"),
)


def values(runs: Path, out: Path, data: Path) -> dict[str, Any]:
    """Return the words of the text, and draw its figure."""
    stored = cl.load_run(runs / "fusion")
    errors = stored.rows.assign(estimator=stored.rows["estimator"].replace(SHORT, regex=True))
    style.save(cl.plot.pareto(errors), out / "fusion.svg")
    table = cl.compare(errors, baseline=BASELINE, full=True)
    real = over_pieces(data / "mrclam6")
    return {
        "trials": table["trials"].max(),
        "seed": stored_run(stored).manifest["seed"],
        "sentences": "\n".join(f"- {text}" for text in [*sentences(table), *_on_real_robots(real)]),
        "consistency": _consistency(table).markdown(),
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
        valid = [truth.valid & (place == k)[None, :, None] for k in np.unique(place)]
        whole = [mask for mask in valid if mask.any()]
        for k, mask in enumerate(whole):  # each piece is a trial of its own
            frame = cl.errors(replace(truth, valid=mask), run)
            found.append(frame.assign(trial=k, stream=frame["stream"] + f"/{k}"))
    errors = pd.concat(found, ignore_index=True)
    table = cl.compare(errors, baseline=BASELINE, full=True)
    pose = errors.groupby(["scenario", "estimator", "trial"], sort=False)["pose_nees"].mean().dropna()
    names = ["pose_nees", "pose_nees_low", "pose_nees_high"]
    ends = {key: mean_of_positive(one.to_numpy(float)) for key, one in pose.groupby(["scenario", "estimator"])}
    return table.join(pd.DataFrame(ends, index=names).T, on=["scenario", "estimator"])


def sentences(table: pd.DataFrame) -> list[str]:
    """Return which rules are consistent in how many worlds, what the frontier costs, and what losing packets does."""
    decentral = table[~table["centralised"].astype(bool) & (table["bytes"] > 0)]
    flags = {str(name): list(rows) for name, rows in decentral.groupby("estimator", sort=False)["consistency"]}
    worlds = max(map(len, flags.values()))
    over = {name: sum(flag == "over-confident" for flag in found) for name, found in flags.items()}
    wide = [name for name, found in flags.items() if set(found) <= {"conservative", "over-wide"}]
    some = [f"`{n}` ({number} of {len(flags[n])})" for n, number in over.items() if 0 < number < len(flags[n])]
    fewer = [f"`{name}` ran in {len(found)}" for name, found in flags.items() if len(found) < worlds]
    bought = []
    for scenario, rows in table.groupby("scenario", sort=False):
        rules = [row for row in frontier(rows).to_dict("records") if row["bytes"] > 0]
        texts = [f"`{row['estimator']}` {_changed(row)} for {_bytes(row['bytes'])}" for row in rules]
        bought.append(f"*{scenario}*: against `{BASELINE}`, {'; '.join(texts) or 'nothing is bought'}.")
    table = table.assign(lossy=table["scenario"].str.contains("drop=0.7"))
    won = table[table["change_high"] < 0]
    before, after, known = (
        set(zip(rows["estimator"], rows["robots"], strict=True))
        for rows in (won[~won["lossy"]], won[won["lossy"]], table[table["lossy"]])
    )
    gone = [f"`{name}` at {robots} robots" for name, robots in sorted((before - after) & known)]
    never = [name for name, number in over.items() if not number]
    always = [name for name, number in over.items() if number == len(flags[name])]
    return [
        f"**Over-confidence is shown in none of the {worlds} worlds**: {_names(never)}.",
        f"**In some of them**: {', '.join(some) or 'no rule'}.",
        f"**In every one**: {_names(always)}.",
        f"**Conservative in every one**: {_names(wide)}.",
        *([f"Of the {worlds} worlds, {join_words(fewer)}."] if fewer else []),
        "The frontier, as change of RMSE:\n    - " + "\n    - ".join(bought),
        f"A gain that is shown with every packet, and not with 70 % of them lost: {', '.join(gone) or 'none'}.",
    ]


def _on_real_robots(real: pd.DataFrame) -> list[str]:
    """Say for how many filters the pose is over-confident on the recording."""
    said = []
    for scenario, rows in real.groupby("scenario", sort=False):
        over = rows["pose_nees_low"] > OVER_CONFIDENT
        alone = rows[rows["estimator"] == BASELINE].iloc[0]
        but = _names(list(rows.loc[~over, "estimator"]))
        said.append(
            f"*{scenario}*: the interval of ANEES (pose) lies above {OVER_CONFIDENT} for {over.sum()} of {len(rows)} "
            f"filters, all but {but}; `{BASELINE}` alone has {ratio(alone['pose_nees'])}."
        )
    return ["On real robots:\n    - " + "\n    - ".join(said)]


def _bytes(number: float) -> str:
    return f"{count(number)} byte{'' if count(number) == '1' else 's'}"


def _changed(row: dict) -> str:
    return f"{change(row['change'])} ({interval(change)(row['change_low'], row['change_high'])})"


def _names(names: list[str]) -> str:
    return ", ".join(f"`{name}`" for name in names) or "no rule"


def _consistency(table: pd.DataFrame) -> Table:
    """A row for each estimator, a column for each scenario."""
    scenarios = list(dict.fromkeys(table["scenario"]))
    flags = [f"{flag}, {ratio(anees)}" for flag, anees in zip(table["consistency"], table["anees"], strict=True)]
    wide = table.assign(flag=flags).pivot(index="estimator", columns="scenario", values="flag")
    rows = wide.reindex(table["estimator"].unique())[scenarios].fillna("").reset_index().to_dict("records")
    heads = (text_column(scenario.removeprefix("scalability/"), scenario) for scenario in scenarios)
    return Table("consistency", "", (text_column("estimator"), *heads), rows)


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

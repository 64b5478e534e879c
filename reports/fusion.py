"""Writes reports/fusion.md, and its figure as PNG and SVG, from a run of the study `fusion` and from MRCLAM.

Run: python reports/fusion.py RUN_DIR DATA [OUT], where DATA is the folder of an MRCLAM recording. The recording is run
here, in a minute or two, to be cut into pieces.
"""

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd

import cooploc as cl
from cooploc.analysis.formats import change, count, interval, listed, metres, percent, ratio
from cooploc.analysis.metrics.consistency import OVER_CONFIDENT
from cooploc.analysis.metrics.statistics import mean_of_positive
from cooploc.analysis.plot.pareto import frontier
from cooploc.analysis.report.tables import Table, estimates, numbers, words
from cooploc.runs import kept

mpl.use("agg")
BASELINE = "ekf-local"
PIECE = 63.0  # [s] of the recording, whose 756 s make twelve
SHORT = {r"\[density=exact,M=1,K=1.*\]": "", r"\[anchor_reading=doa\]": ""}
REAL = (
    *("ekf-local", "ekf-naive", "ekf-ci", "ekf-event-ci", "ekf-split-ci", "ekf-split-ci[form=conservative]", "ekf-ici"),
    *("ekf-ici[form=fixed]", "ekf-hmd", "ekf-hmd[weight=0.8]", "ekf-gs-ci", "ekf-luft", "ekf-interim", "gbp"),
    *("ekf-joint", "iekf-joint", "ukf-joint"),
)
TEXT = """# Which rules of fusion are consistent, and at which price

    cooploc run fusion --out RUN_DIR
    python reports/fusion.py RUN_DIR DATA      # this page; DATA is an MRCLAM recording

All filters have the same sensors: odometry, a direction of arrival from the four anchors, and a range to every teammate
whose packet arrives, which `ekf-local` leaves out. They differ in what they send and in how they use it; Kalman filters
also weigh a direction by the strength of its gradient, which particle filters do not use. Particle filters use each
direction once, with its exact density (`density=exact,M=1,K=1`); `ctrn` is `ctrn[fusion=received,weights=exact]`, and
`gbp` is `gbp[anchor_reading=doa]`. The 6 m world of the `paper` preset; {trials} trials, seed {seed}, 95 % intervals
over trials.

![RMSE over bytes of every rule, at three, ten and fifty robots, with every packet and with 70 % lost](fusion.png)

Hollow markers are over-confident: the interval of ANEES lies above 1.5, or that of the coverage of the 95 % ellipse
below the 86 % that goes with it. The frontier joins the rules that no other one beats in both error and bytes, of those
that are not shown to be over-confident; it is drawn by the values alone, without a test between
neighbours. Grey: all readings reach one computer, whose bytes are those of the readings.

## What was found

{sentences}

## Consistency

*Consistent* is said where the whole interval of ANEES lies between 0.67 and 1.5, *conservative* where it lies below
0.67, *over-wide* where it lies below 0.1; *not shown* where it holds one of the first two limits.

{consistency}

## All numbers

{numbers}

## Five real robots

UTIAS MRCLAM, all, one or none of the robots see landmarks. One recording is one trial, which has no interval; here its
{seconds:.0f} s are cut into {pieces} pieces of {piece:.0f} s, and intervals are over pieces. These follow one another
and are not independent, so the intervals may be too narrow. Errors are of the pose's position, ANEES (pose) of
position and heading.

{mrclam}

## More

- [fixed-weights.md](fixed-weights.md): weights that somebody has to choose, of `ekf-ici[form=fixed]` and `ekf-hmd`.
- [vague-start.md](vague-start.md): how many robots the joint filter loses where they hardly know where they start.
- [gbp.md](gbp.md): Gaussian belief propagation; [sightings.md](sightings.md): what of a teammate is worth using.
- [speed.md](speed.md): what the filters cost.
"""


def main(run: str, data: str, out: str = "reports") -> None:
    """Write the page and the figure."""
    stored = cl.load_run(run)
    errors = shortened(stored.rows)
    figure = cl.plot.pareto(errors).figure
    with mpl.rc_context({"svg.hashsalt": "cooploc"}):
        figure.savefig(Path(out) / "fusion.png", dpi=150)
        figure.savefig(Path(out) / "fusion.svg", metadata={"Date": None})
    table = cl.compare(errors, baseline=BASELINE, full=True)
    real = recorded(data)
    text = TEXT.format(
        trials=table["trials"].max(),
        seed=kept(stored).manifest["seed"],
        sentences="\n".join(f"- {text}" for text in [*sentences(table), *_on_real_robots(real)]),
        consistency=_consistency(table).markdown(),
        numbers=_numbers(table, "rules").markdown(),
        mrclam=_numbers(real, "mrclam", pose=True).markdown(),
        seconds=PIECE * real["trials"].max(),
        pieces=real["trials"].max(),
        piece=PIECE,
    )
    (Path(out) / "fusion.md").write_text(text, encoding="utf-8")


def shortened(errors: pd.DataFrame) -> pd.DataFrame:
    """The same with short names of the particle filters; the page says once what they leave out."""
    return errors.assign(estimator=errors["estimator"].replace(SHORT, regex=True))


def recorded(data: str, names: tuple[str, ...] = REAL) -> pd.DataFrame:
    """As `compare`, over pieces of the recording; with `pose_nees` and the ends of its interval."""
    found = []
    for view in ("all", "one", "none"):
        truth, stream = cl.simulate(f"mrclam/{view}", data=data)
        run = cl.run(names, stream)
        place = np.floor((stream.time - stream.time[0]) / PIECE)
        pieces = [np.flatnonzero(place == k) for k in np.unique(place)]
        whole = [ticks for ticks in pieces if truth.valid[0, ticks].any()]
        for k, ticks in enumerate(whole):
            found.append(piece_of(truth, run, k, ticks))
    errors = pd.concat(found, ignore_index=True)
    table = cl.compare(errors, baseline=BASELINE, full=True)
    pose = errors.groupby(["scenario", "estimator", "trial"], sort=False)["pose_nees"].mean()
    ends = pose.groupby(["scenario", "estimator"], sort=False).apply(_mean_with_ends).unstack()
    return table.join(ends, on=["scenario", "estimator"])


def piece_of(truth: cl.Truth, run: cl.Run, k: int, ticks: np.ndarray) -> pd.DataFrame:
    """The errors within some ticks, as those of a trial of its own."""
    mask = np.zeros(truth.valid.shape, bool)
    mask[:, ticks] = True
    frame = cl.errors(replace(truth, valid=truth.valid & mask), run)
    return frame.assign(trial=k, stream=frame["stream"] + f"/{k}")


def _mean_with_ends(values: pd.Series) -> pd.Series:
    found = mean_of_positive(values.dropna().to_numpy(float))
    return pd.Series({"pose_nees": found.value, "pose_nees_low": found.low, "pose_nees_high": found.high})


def sentences(table: pd.DataFrame) -> list[str]:
    """Who is consistent in which share of the worlds, what the frontier costs, and what losing packets does."""
    decentral = table[~table["centralised"].astype(bool) & (table["bytes"] > 0)]
    return [*_standings(decentral), *_frontiers(table), *_losses(table)]


def _standings(table: pd.DataFrame) -> list[str]:
    flags = {str(name): list(rows) for name, rows in table.groupby("estimator", sort=False)["consistency"]}
    worlds = max(map(len, flags.values()))
    over = {name: sum(flag == "over-confident" for flag in found) for name, found in flags.items()}
    wide = [name for name, found in flags.items() if set(found) <= {"conservative", "over-wide"}]
    never = [name for name, number in over.items() if not number]
    always = [name for name, number in over.items() if number == len(flags[name])]
    some = [f"`{n}` ({number} of {len(flags[n])})" for n, number in over.items() if 0 < number < len(flags[n])]
    fewer = [f"`{name}` ran in {len(found)}" for name, found in flags.items() if len(found) < worlds]
    return [
        f"**Over-confidence is shown in none of the {worlds} worlds**: {_names(never)}.",
        f"**In some of them**: {', '.join(some) or 'no rule'}.",
        f"**In every one**: {_names(always)}.",
        f"**Conservative in every one**: {_names(wide)}.",
        *([f"Of the {worlds} worlds, {listed(fewer)}."] if fewer else []),
    ]


def _frontiers(table: pd.DataFrame) -> list[str]:
    said = []
    for scenario, rows in table.groupby("scenario", sort=False):
        bought = [
            f"`{row['estimator']}` {_changed(row)} for {_bytes(row['bytes'])}"
            for row in frontier(rows).to_dict("records")
            if row["bytes"] > 0
        ]
        said.append(f"*{scenario}*: against `{BASELINE}`, {'; '.join(bought) or 'nothing is bought'}.")
    return ["The frontier, as change of RMSE:\n    - " + "\n    - ".join(said)]


def _losses(table: pd.DataFrame) -> list[str]:
    """Whose interval against the baseline holds 0 with 70 % of the packets lost, though it did not without."""
    table = table.assign(lossy=table["scenario"].str.contains("drop=0.7"))
    won = table[table["change_high"] < 0]
    before, after, known = (
        set(zip(rows["estimator"], rows["robots"], strict=True))
        for rows in (won[~won["lossy"]], won[won["lossy"]], table[table["lossy"]])
    )
    gone = [f"`{name}` at {robots} robots" for name, robots in sorted((before - after) & known)]
    return [f"A gain that is shown with every packet, and not with 70 % of them lost: {', '.join(gone) or 'none'}."]


def _on_real_robots(real: pd.DataFrame) -> list[str]:
    """Whose pose is over-confident on the recording, and whether the robot's own filter is."""
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
    rows = [
        {"estimator": name, **dict(zip(part["scenario"], map(_flag, part.to_dict("records")), strict=True))}
        for name, part in table.groupby("estimator", sort=False)
    ]
    filled = [{**dict.fromkeys(scenarios, ""), **row} for row in rows]
    columns = (words("estimator"), *(words(scenario.removeprefix("scalability/"), scenario) for scenario in scenarios))
    return Table("consistency", "", columns, filled)


def _flag(row: dict) -> str:
    return f"{row['consistency']}, {ratio(row['anees'])}"


def _numbers(table: pd.DataFrame, name: str, pose: bool = False) -> Table:
    nees = "pose_nees" if pose else "anees"
    columns = (
        words("scenario"),
        words("estimator"),
        estimates("RMSE [m]", "rmse", metres),
        estimates(f"against {BASELINE}", "change", change),
        estimates("ANEES (pose)" if pose else "ANEES", nees, ratio),
        estimates("in the 95 % ellipse", "coverage95", percent),
        numbers("bytes", "bytes", form=count),
    )
    return Table(name, "Means with 95 % intervals; bytes per robot and tick.", columns, table.to_dict("records"))


if __name__ == "__main__":
    main(*sys.argv[1:])

"""Values of reports/text/real-robots.md.j2 from recordings: what sensors were off by, and what cooperation bought.

The recordings are uwb-tiers, wifi-rssi and mrclam6; the runs those of the studies `uwb`, `mrclam` and `wifi-priors`.
"""

import re
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from page import pipe, pipe_by_scenario

import cooploc as cl
from cooploc.analysis.formats import metres
from cooploc.analysis.plot import style
from cooploc.scenarios import resolve
from cooploc.scenarios.recordings.fit import fit_part, residuals
from cooploc.scenarios.recordings.sampling import Gaps, span
from cooploc.scenarios.studies.study import load

LABELS = ("log/all", "log/all[bias=none]", "log/all[position_sd=0.002,heading_sd=0.005]")
BAGS = {"two-robots": "two turtlebots, one radio pair, 45 s", "four-robots": "four turtlebots, six radio pairs, 17 s"}
SHOWN = ("dead-reckoning", "constant", "arl", "mrsl-distance", "ctrn", "ekf-local", "ekf-ci", "ekf-joint")
PAIRS = ("mrsl-distance", "arl"), ("ctrn", "arl"), ("ekf-ci", "ekf-local"), ("mrsl-distance", "ekf-ci")


def ranges(label: str, data: Path) -> pd.DataFrame:
    """Return range minus distance of every pair, over the whole recording."""
    judged = resolve(label, data).model.at([0]).judged_run
    log, robots = judged.log, judged.log.robots
    found = residuals([fit_part(log, *span(log), Gaps(0.5, 0.5))], "range", robots, judged.how)
    error = found.z[:, 0] - found.distance
    rows = []
    for link in np.unique(found.link):
        low, middle, high = np.quantile(one := error[found.link == link], [0.05, 0.5, 0.95])
        pair = " - ".join(robots[i] for i in divmod(int(link), len(robots)))
        rows.append({"pair": pair, "readings": len(one), "bias (median) [m]": f"{middle:.2f}",
                     "spread [m]": f"{one.std():.2f}", "5 % to 95 % [m]": f"{low:.2f} to {high:.2f}"})  # fmt: skip
    return pd.DataFrame(rows)


def errors_of(labels: tuple[str, ...], data: Path) -> pd.DataFrame:
    """Return the summary of the study `log`'s estimators in each scenario."""
    found = []
    for label in labels:
        (truth, stream), names = cl.simulate(label, data=data), list[str]()
        for name in (name for cell in load("log").cells() for name in cell.estimators):
            with suppress(cl.IncompatibleEstimator):  # the recording lacks a channel that it needs
                cl.run([name], stream.first_ticks(1))
                names.append(name)
        found.append(cl.summarize(cl.errors(truth, cl.run(names, stream))).assign(scenario=label))
    return pd.concat(found, ignore_index=True)


def values(runs: Path, out: Path, data: Path) -> dict[str, Any]:
    """Return the words of the text, and draw its figures."""
    (folder := out / "real-robots").mkdir(exist_ok=True)
    for name, study in (("mrclam", "mrclam"), ("wifi", "wifi-priors")):
        style.save(cl.plot.rmse(cl.load_run(runs / study).rows), folder / f"{name}.png")
    return {
        **bags(data, folder),
        "uwb": by_scenario(runs / "uwb", "anees_median"),
        "mrclam": by_scenario(runs / "mrclam", "anees"),
        "recordings": recordings(runs.joinpath("recordings")),  # not made here: they are fetched,
    }


def bags(data: Path, out: Path) -> dict[str, Any]:
    """Return what every bag shows, and what their tables have in common."""
    sections, pairs, less, dead, joint = [], [], [], list[str](), list[str]()
    with tempfile.TemporaryDirectory() as place:
        for name, about in BAGS.items():
            copy = shutil.copytree(data / "uwb-tiers" / name, Path(place) / name, copy_function=shutil.copy)
            found = cl.inspect(copy)
            found.write()
            shutil.copy(copy / "inspect.png", out / f"{name}.png")
            style.save(cl.plot.residuals("log/all", copy), out / f"{name}-residuals.png", dpi=130)
            pairs.append(ranges("log/all", copy))
            table = errors_of(LABELS, copy)
            error = table["rmse"].round(3)  # to the millimetre
            known = error[table["estimator"] == "dead-reckoning"].set_axis(table["scenario"].unique())
            dead += list(known.map(metres))
            joint += list(error[table["estimator"].str.startswith("ekf-joint")].map(metres))  # in the order of LABELS
            own = (table["scenario"] == LABELS[2]) | table["estimator"].str.startswith("arl")  # uses no ranges
            less += [*table["estimator"][~own & (error < table["scenario"].map(known))]]
            texts = [f"{rmse:.3f} ({anees:.2g})" for rmse, anees in zip(table["rmse"], table["anees"], strict=True)]
            facts = [f"- {str(one.fact).replace(f'{place}/', '')} ({one.sure})" for one in found.findings.itertuples()]
            tables = {"ranges": pipe(pairs[-1]), "errors": pipe_by_scenario(table, texts), "findings": "\n".join(facts)}
            sections.append({"name": name, "about": about, **tables})
    every = pd.concat(pairs)
    spread = {"bias": list(every["bias (median) [m]"]), "spread": list(every["spread [m]"]), "dead": dead}
    ends = {name: f"{min(written, key=float)} to {max(written, key=float)}" for name, written in spread.items()}
    return {"bags": sections, **ends, "less": list(dict.fromkeys(less)), "joint": joint}


def recordings(runs: Path) -> str:
    """Return the errors [m] of each public recording that was run, and who errs less; without runs, what is there."""
    if not runs.exists():
        page = Path(__file__).with_name("real-robots.md").read_text("utf-8")
        return re.findall(r"^\| recording .*?(?=\n\nMRCLAM)", page, re.DOTALL | re.MULTILINE)[0]
    rows, team = [], []
    for folder in sorted(runs.iterdir()):
        table = cl.load_run(folder).table
        rmse = dict(zip(table["estimator"].str.partition("[")[0], table["rmse"], strict=True))
        rmse["arl"] = rmse.get("rssi-pf", rmse["arl"])  # that of each reading as it is, where a study has another too
        team += [rmse] * ("mrsl-distance" in rmse)
        row = {"recording": folder.name, "robots": int(table["robots"].iloc[0]), "runs": int(table["trials"].iloc[0])}
        rows.append(row | {name: metres(rmse.get(name, np.nan)) for name in SHOWN})
    less = [f"`{a}` errs less than `{b}` in {sum(rmse[a] < rmse[b] for rmse in team)}" for a, b in PAIRS]
    return f"{pipe(pd.DataFrame(rows))}\n\nOf the {len(team)} recordings of several robots {', '.join(less)}."


def by_scenario(run: Path, consistency: str) -> str:
    """Return a run's RMSE [m] and a figure of consistency, a column for each scenario."""
    table = cl.load_run(run).table
    in_brackets = [f"({value:.2g})" if value < 1000 else "(> 1000)" for value in table[consistency]]
    texts = [f"{metres(rmse)} {other}" for rmse, other in zip(table["rmse"], in_brackets, strict=True)]
    return pipe_by_scenario(table, texts)

"""The trials behind a report's numbers: a CSV file for each scenario, and what the page draws pairs of them from.

The page holds each trial's RMSE as a 16-bit number on a logarithmic scale, exact to a ten-thousandth or so.
"""

import base64
import re
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pandas as pd

from cooploc.analysis.claims.trial_table import TrialTable
from cooploc.analysis.report.csv_text import csv_text

FOLDER = "trials"
MOST = 400_000  # RMSE values that a page holds, in two bytes each; of more trials the first ones
ABSENT = 65535


def rmse_by_trial(table: pd.DataFrame, results: TrialTable) -> dict[str, pd.DataFrame]:
    """Of each scenario the RMSE [m]: a row per trial, a column per estimator; nan where the trial failed."""
    out = {}
    for scenario, part in table[table["rmse"].notna()].groupby("scenario", sort=False):
        out[str(scenario)] = results.errors(str(scenario), list(part["estimator"])).pow(0.5).sort_index()
    return out


def names_of(scenarios: list[str]) -> dict[str, str]:
    """The file of each scenario."""
    plain = (re.sub(r"[^A-Za-z0-9]+", "-", scenario).strip("-")[:60] for scenario in scenarios)
    return {scenario: f"{i:03}-{name}.csv" for i, (scenario, name) in enumerate(zip(scenarios, plain, strict=True), 1)}


def addresses(scenarios: list[str]) -> dict[str, str]:
    """The address of each scenario's file, from the page."""
    return {scenario: f"{FOLDER}/{quote(name)}" for scenario, name in names_of(scenarios).items()}


def write(trials: dict[str, pd.DataFrame], out: Path) -> None:
    """Write a file for each scenario."""
    (out / FOLDER).mkdir(parents=True, exist_ok=True)
    for scenario, name in names_of(list(trials)).items():
        file = trials[scenario].rename_axis("trial").reset_index()
        (out / FOLDER / name).write_text(csv_text(file), encoding="utf-8")


def compact(trials: dict[str, pd.DataFrame]) -> list[dict[str, Any]]:
    """What the page holds of each scenario: estimators, trials, and their RMSE, estimator by estimator."""
    cells = sum(len(one.columns) for one in trials.values())
    most = max(1, MOST // max(1, cells))
    return [_packed(scenario, one.iloc[:most], len(one)) for scenario, one in trials.items()]


def _packed(scenario: str, rmse: pd.DataFrame, every: int) -> dict[str, Any]:
    values = rmse.to_numpy(float).T
    known = np.isfinite(values) & (values > 0)
    logs = np.log(np.where(known, values, 1.0))
    low, high = (float(f(logs[known])) if known.any() else 0.0 for f in (np.min, np.max))
    steps = np.where(known, np.round((logs - low) / ((high - low) or 1.0) * (ABSENT - 1)), ABSENT)
    return {
        "scenario": scenario,
        "estimators": list(map(str, rmse.columns)),
        "trials": [int(trial) for trial in rmse.index],
        "every": every,
        "low": low,
        "high": high,
        "steps": base64.b64encode(steps.astype("<u2").tobytes()).decode(),
    }

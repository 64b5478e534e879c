"""Errors over time, and against what a scenario's label sweeps."""

import re
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.consistency import band
from cooploc.analysis.metrics.errors import position_errors
from cooploc.estimators import parse
from cooploc.estimators.interface import Array
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.stream import Truth

CURVE = ("rmse", "rmse_low", "rmse_high", "anees", "anees_low", "anees_high", "band_low", "band_high")


def over_time(truth: Truth, run: Run) -> pd.DataFrame:
    """One row per (estimator, tick): `rmse` [m] and `anees` with 95 % intervals over trials, and the chi-square band.

    Robots are pooled within a trial first. `band_low` and `band_high` hold the ANEES of a consistent estimator in
    95 % of the ticks if errors are Gaussian and the robots of a trial count as one; so it is a guide, not a test.

    Raises:
        BadInput: truth and run are of different streams.

    """
    rows: list[dict[str, Any]] = []
    for name, trace in run.traces.items():
        d2, nees = position_errors(truth, run, trace)
        for k in range(d2.shape[1]):
            mse, anees = _of_trials(d2[:, k]), _of_trials(nees[:, k]) / 2
            values = (
                *np.sqrt(statistics.mean_of_positive(mse)),
                *statistics.mean_of_positive(anees),
                *band(len(anees), 2),
            )
            rows.append(
                {"scenario": run.scenario, "estimator": name, "tick": k, **dict(zip(CURVE, values, strict=True))}
            )
    return pd.DataFrame(rows)


def swept(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table with `family`, `parameter` and `value` read from its scenarios' labels: "packet-drop/drop=0.7".

    A label that sweeps nothing has an empty parameter and the value nan; options in brackets stay with the family.
    """
    read = [sweep(label) for label in table["scenario"]]
    return table.assign(
        family=[family for family, _, _ in read], parameter=[p for _, p, _ in read], value=[v for _, _, v in read]
    )


def sweep(label: str) -> tuple[str, str, float]:
    """Family, swept parameter and value of a scenario's label; an empty parameter and nan where nothing is swept."""
    path, written = parse(label)
    found = re.fullmatch(r"(.+)/([^/=]+)=([-+.0-9einf]+)", path)
    options = f"[{','.join(f'{k}={v}' for k, v in written.items())}]" if written else ""
    if found is None:
        return path + options, "", np.nan
    return found[1] + options, found[2], float(found[3])


def _of_trials(values: Array) -> Array:
    """Return means over the robots (t, n) that count, of the trials that have any."""
    some = ~np.isnan(values).all(1)
    means: Array = np.nanmean(values[some], axis=1)
    return means

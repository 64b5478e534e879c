"""Errors over time, and against what a scenario's label sweeps."""

import re
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.metrics.consistency import band
from cooploc.analysis.metrics.errors import position_errors
from cooploc.analysis.metrics.statistics import FIXED, Interval
from cooploc.estimators import parse
from cooploc.estimators.registry import write_label
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.stream import Truth


def over_time(truth: Truth, run: Run) -> pd.DataFrame:
    """Return `rmse` [m] and `anees` by (estimator, tick), with 95 % intervals over trials, and the chi-square band.

    Robots are pooled within a trial first. `band_low` and `band_high` hold the ANEES of a consistent estimator in
    95 % of the ticks if errors are Gaussian and the robots of a trial count as one: a guide, not a test.
    """
    rows: list[dict[str, Any]] = []
    for name, trace in run.traces.items():
        d2, nees = position_errors(truth, run, trace)
        for k in range(d2.shape[1]):
            mse, anees = (np.nanmean(a[~np.isnan(a).all(1)], axis=1) for a in (d2[:, k], nees[:, k] / 2))
            rmse = Interval(*np.sqrt(FIXED.mean_of_positive(mse)))
            row = {"scenario": run.scenario, "estimator": name, "tick": k, **rmse.columns("rmse")}
            row |= FIXED.mean_of_positive(anees).columns("anees")
            rows.append(row | dict(zip(("band_low", "band_high"), band(len(anees), 2), strict=True)))
    return pd.DataFrame(rows)


def swept(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table with `family`, `parameter` and `value` of its scenarios' labels, as of `sweep`."""
    found = [sweep(label) for label in table["scenario"]]
    return table.assign(**dict(zip(("family", "parameter", "value"), map(list, zip(*found, strict=True)), strict=True)))


def sweep(label: str) -> tuple[str, str, float]:
    """Return family, swept parameter and value of a scenario's label, such as "packet-drop/drop=0.7".

    A label that sweeps nothing has an empty parameter and the value nan; options in brackets stay with the family.
    """
    path, written = parse(label)
    found = re.fullmatch(r"(.+)/([^/=]+)=([-+.0-9einf]+)", path)
    family, parameter, value = found.groups() if found else (path, "", "nan")
    return write_label(family, written), parameter, float(value)

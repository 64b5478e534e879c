"""Trials that are far worse than the others: the interval of an RMSE does not hold what it has hardly seen.

Where one trial of a hundred diverges twentyfold, four fifths of the mean squared error are in that trial: with 20
trials it is missed in four of five runs, and the 95 % interval of the RMSE then does not hold the truth
(`reports/statistics.md`). No interval mends that. So the share of such trials is printed with its own interval, beside
the median, which such trials do not decide, and a sentence warns where any was seen.
"""

from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.formats import interval, metres, percent
from cooploc.analysis.metrics import statistics
from cooploc.estimators.interface import Array

FAR = 5.0  # times the median trial's RMSE


def far(mse: Array) -> Array:
    """1.0 for a trial whose RMSE exceeds `FAR` times that of the median trial, else 0.0; from squared errors (k,)."""
    return (mse > FAR**2 * np.median(mse)).astype(float) if len(mse) else np.zeros(0)


def share(mse: Array) -> statistics.Interval:
    """The share of such trials, with Wilson's interval, which reaches to 16 % where 20 trials show none."""
    return statistics.share(far(mse[~np.isnan(mse)]))


def warnings(table: pd.DataFrame) -> list[str]:
    """A sentence on each row of `summarize` or `compare` whose RMSE a few trials decide."""
    return [_warning(row) for row in table[table["outlying"] > 0].to_dict("records")]


def _warning(row: dict[Any, Any]) -> str:
    count = round(row["outlying"] * row["trials"])
    ends = interval(percent)(row["outlying_low"], row["outlying_high"])
    return (
        f"{row['scenario']}, {row['estimator']}: {count} of {row['trials']} trials ({ends or 'no interval'}) err more "
        f"than {FAR:g} times as much as the median trial, {metres(row['rmse_median'])} m; they decide the RMSE, "
        f"{metres(row['rmse'])} m, and its interval is too narrow; diverged: {percent(row['diverged'])} of robots"
    )

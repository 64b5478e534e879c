"""What tuning makes small: one number for a trial, of the rows of `errors`.

`nll`, mean negative log-likelihood of the true position [nats]: a proper score, so that no estimator gains by claiming
to be surer than it is (Gneiting & Raftery, J. American Statistical Association 102, 2007). A robot that collapsed onto
a wrong place can score millions and decide any mean; so beyond `CAP` a score s counts as CAP + log(1 + s - CAP), which
keeps the order. `rmse`, the logarithm of the trial's RMSE [log m]: 0.1 is about 10 %, wherever it is measured.
"""

from collections.abc import Callable

import numpy as np
import pandas as pd

from cooploc.estimators.interface import Array
from cooploc.estimators.plugins.errors import BadInput, nearest

CAP = 10.0  # [nats] to know nothing but a 60 m arena scores 8.2
LARGEST = 1e6  # [nats], [m]: what a failed trial counts as


def trial_scores(rows: pd.DataFrame, objective: str) -> "pd.Series[float]":
    """The score of every trial, by its number; a trial that failed has the worst.

    Raises:
        BadInput: there is no such objective.

    """
    if objective not in OBJECTIVES:
        raise BadInput(f"there is no objective {objective!r}; {nearest(objective, list(OBJECTIVES))}")
    column, score, after = OBJECTIVES[objective]
    there = rows if column in rows else rows.assign(**{column: np.nan})  # lacking where no trial succeeded
    values = there[column].where(rows["failure"].isna(), np.inf)
    weight = rows["ticks"].fillna(1).to_numpy(float)  # of a trial that failed nothing is known
    known = weight > 0
    trials, of = np.unique(rows["trial"].to_numpy()[known], return_inverse=True)
    total = np.bincount(of, weight[known] * score(values.to_numpy(float)[known]))
    return pd.Series(after(total / np.bincount(of, weight[known])), index=trials)


def capped(nll: Array) -> Array:
    """Scores [nats] that grow as their logarithm beyond `CAP`; what is not a number is the worst."""
    finite = np.minimum(np.nan_to_num(nll, nan=np.inf), LARGEST)
    return np.asarray(np.where(finite > CAP, CAP + np.log1p(np.maximum(finite - CAP, 0.0)), finite))


def _squared(mse: Array) -> Array:
    return np.asarray(np.minimum(np.nan_to_num(mse, nan=np.inf), LARGEST**2))


def _same(score: Array) -> Array:
    return score


def _log_root(mse: Array) -> Array:
    return np.asarray(np.log(np.maximum(mse, 1e-12)) / 2)


# name -> column of `errors`, what a robot's value counts as, what becomes of the trial's mean
OBJECTIVES: dict[str, tuple[str, Callable[[Array], Array], Callable[[Array], Array]]] = {
    "nll": ("nll", capped, _same),
    "rmse": ("mse", _squared, _log_root),
}
UNITS = {"nll": "nats", "rmse": "log m"}

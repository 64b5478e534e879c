"""The rows of `errors`, pooled over the robots of a trial; which of them may be paired; what estimators counted."""

import hashlib
from collections.abc import Hashable
from typing import Any

import pandas as pd

from cooploc.analysis.metrics.errors import NOTE
from cooploc.estimators.plugins.errors import BadInput

CELL: list[Hashable] = ["scenario", "estimator"]


def succeeded(errors: pd.DataFrame) -> pd.DataFrame:
    """The rows of trials that did not fail."""
    return errors[errors["failure"].isna()] if "failure" in errors else errors


def notes(errors: pd.DataFrame) -> list[str]:
    """What estimators counted, one line each: sums over trials and robots, and maxima of what is called largest."""
    columns = [name for name in errors if str(name).startswith(NOTE)]
    lines = []
    for (scenario, estimator), group in errors.groupby(CELL, sort=False):
        counted = {str(c).removeprefix(NOTE): group[c] for c in columns if group[c].notna().any()}
        said = [f"{name} {v.max() if name.startswith('largest') else v.sum():.3g}" for name, v in counted.items()]
        lines += [f"{scenario}, {estimator}: {', '.join(said)}"] if said else []
    return lines


def trial_means(errors: pd.DataFrame) -> dict[tuple[str, str], pd.DataFrame]:
    """One row per trial that succeeded, by (scenario, estimator): means over robots, weighted by the ticks that count.

    Medians, final and largest errors, and `diverged`, are a robot's: there every robot counts the same. `stream`,
    `seconds` and `robots` are those of the trial. A cell whose trials all failed has no rows.
    """
    ended = succeeded(errors)
    keys: list[Any] = [ended[key] for key in (*CELL, "trial")]
    weight = ended["ticks"] / ended["ticks"].groupby(keys).transform("sum")
    weighted = ended[["mse", "anees", "coverage95", "mean_error"]].mul(weight, axis=0)
    out = weighted.groupby(keys).sum(min_count=1)
    of_robots = ["diverged", "median_error", "final_error", "max_error"]
    out[of_robots] = ended[of_robots].groupby(keys).mean()
    of_trial = ["stream", "seconds", "robots"]
    out[of_trial] = ended[of_trial].groupby(keys).first()
    found = {(str(s), str(e)): part.droplevel(CELL) for (s, e), part in out.groupby(level=CELL)}
    cells = errors[CELL].drop_duplicates().itertuples(index=False)
    return {(str(s), str(e)): found.get((str(s), str(e)), out.iloc[:0].droplevel(CELL)) for s, e in cells}


def demand_same_streams(errors: pd.DataFrame) -> None:
    """Refuse rows that look paired and are not.

    Raises:
        BadInput: estimators ran on different streams, or were judged on different ticks of one.

    """
    different = errors.groupby(["scenario", "trial"])["stream"].nunique()
    if (different > 1).any():
        scenario, trial = different[different > 1].index[0]
        raise BadInput(f"{scenario}, trial {trial}: estimators ran on different streams; run them again on one stream")
    different = succeeded(errors).groupby(["scenario", "trial", "robot"])["ticks"].nunique()
    if (different > 1).any():
        scenario, trial, _ = different[different > 1].index[0]
        raise BadInput(f"{scenario}, trial {trial}: estimators were judged on different ticks; use one burn_in for all")


def stream_hash(group: pd.DataFrame) -> str:
    """The hash of a scenario's stream: of the hashes of its trials, as `Stream.hash`."""
    trials = group.drop_duplicates("trial").sort_values("trial")["stream"]
    return hashlib.sha256("".join(trials).encode()).hexdigest()

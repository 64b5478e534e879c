"""The rows of `errors`, pooled over the robots of a trial; which of them may be paired; what estimators counted."""

import hashlib
from typing import Any

import pandas as pd

from cooploc.analysis.metrics.errors import NOTE, OFFLINE, SCORES
from cooploc.estimators.plugins.errors import BadInput

CELL = ["scenario", "estimator"]
TRIAL = [*CELL, "trial"]
SHOWN = 5  # trials that a refusal names
LARGEST = 1e100  # [m^2] the square of a larger error overflows in a variance


def succeeded(errors: pd.DataFrame) -> pd.DataFrame:
    """The rows of trials that neither failed nor have an error, of any robot whose truth is known, that is not finite.

    An error that is nan, infinite or beyond `LARGEST` is a failure of the whole trial: left out
    silently it would make the estimator look better, and counted as zero better still.
    """
    lost = (errors["ticks"] > 0) & ~(errors["mse"] < LARGEST)
    if "failure" in errors:
        lost |= errors["failure"].notna()
    return errors[~lost.groupby([errors[key] for key in TRIAL]).transform("any")] if lost.any() else errors


def offline(errors: pd.DataFrame) -> "pd.Series[bool]":
    """Whether a row is of an estimator that saw the readings of later ticks, too."""
    return errors[OFFLINE].eq(True) if OFFLINE in errors else pd.Series(False, errors.index)


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

    Medians, final and largest errors, and `diverged`, are a robot's: there every robot counts the same. `stream` is
    that of the trial. A cell whose trials all failed has no rows.
    """
    means = _of_trials(succeeded(errors))
    known = {cell: part.droplevel([0, 1]).sort_index() for cell, part in means.groupby(level=CELL, sort=False)}
    nothing = means.iloc[:0].droplevel([0, 1])
    every = errors[CELL].drop_duplicates().itertuples(index=False, name=None)
    return {(str(s), str(e)): known.get((s, e), nothing) for s, e in every}


def weighted_means(errors: pd.DataFrame, keys: list[str], columns: list[str]) -> pd.DataFrame:
    """Means of columns over the robots of each group, weighted by the ticks that count; index: the keys.

    A robot without such ticks does not count; one that has some, and no value, leaves its group without one.
    """
    groups: list[Any] = [errors[key] for key in keys]
    weight = errors["ticks"] / errors["ticks"].groupby(groups).transform("sum")
    means = errors[columns].mul(weight, axis=0).groupby(groups, sort=False).sum(min_count=1)
    absent = errors[columns].isna() & (errors[["ticks"]].to_numpy() > 0)
    return means.mask(absent.groupby(groups, sort=False).any()) if absent.to_numpy().any() else means


def _of_trials(ended: pd.DataFrame) -> pd.DataFrame:
    """One row per trial of every cell; index: scenario, estimator, trial."""
    scores = [name for name in SCORES if name in ended]  # runs of former versions have none
    out = weighted_means(ended, TRIAL, ["mse", "anees", "coverage95", "mean_error", *scores])
    out = out.reindex(columns=[*out, *(name for name in SCORES if name not in scores)])
    of_robots = ["diverged", "median_error", "final_error", "max_error"]
    groups = ended.groupby(TRIAL, sort=False)
    out[of_robots] = groups[of_robots].mean()
    out["stream"] = groups["stream"].first()
    return out


def demand_same_streams(errors: pd.DataFrame) -> None:
    """Refuse rows that look paired and are not.

    Raises:
        BadInput: estimators ran on different streams, or were judged on different ticks of one; two trials have the
            same stream; or a row stands there twice.

    """
    _demand_once(errors)
    different = errors.groupby(["scenario", "trial"])["stream"].nunique()
    if (different > 1).any():
        scenario, trial = different[different > 1].index[0]
        raise BadInput(f"{scenario}, trial {trial}: estimators ran on different streams; run them again on one stream")
    different = succeeded(errors).groupby(["scenario", "trial", "robot"])["ticks"].nunique()
    if (different > 1).any():
        scenario, trial, _ = different[different > 1].index[0]
        raise BadInput(f"{scenario}, trial {trial}: estimators were judged on different ticks; use one burn_in for all")


def _demand_once(errors: pd.DataFrame) -> None:
    """Refuse copies of trials, which would count as independent."""
    twice = errors[errors.duplicated([*TRIAL, "robot"])]
    if len(twice):
        scenario, estimator, trial = twice.iloc[0][TRIAL]
        raise BadInput(f"{scenario}, {estimator}, trial {trial} stands there twice: join every run once")
    once = errors.drop_duplicates(["scenario", "stream", "trial"]).dropna(subset="stream")
    copies = once[once.duplicated(["scenario", "stream"], keep=False)]
    if len(copies):
        first = copies.iloc[0]
        same = copies[(copies["scenario"] == first["scenario"]) & (copies["stream"] == first["stream"])]
        raise BadInput(
            f"{first['scenario']}: trials {', '.join(map(str, same['trial'][:SHOWN]))} are of one stream; keep one of "
            "them, or copies would count as independent"
        )


def stream_hash(group: pd.DataFrame) -> str:
    """The hash of a scenario's stream: of the hashes of its trials, as `Stream.hash`."""
    trials = group.drop_duplicates("trial").sort_values("trial")["stream"].dropna()  # none where it was never made
    return hashlib.sha256("".join(trials).encode()).hexdigest()

"""The rows of `errors`, pooled over the robots of a trial; which of them may be paired; what estimators counted."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.formats import interval, metres, percent
from cooploc.analysis.metrics import sequential, statistics
from cooploc.analysis.metrics.consistency import collapsed, consistency
from cooploc.analysis.metrics.errors import (
    CELL,
    COLUMNS,
    SCORES,
    SENSES,
    demand_same_streams,
    drop_failed,
    is_offline,
    stream_hash,
    trial_means,
)
from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array

# Trials that are far worse than the others: the interval of an RMSE does not hold what it has hardly seen.
#
# Where one trial of a hundred diverges twentyfold, four fifths of the mean squared error are in that trial: with 20
# trials it is missed in four of five runs, and the 95 % interval of the RMSE then does not hold the truth
# (`reports/statistics.md`). No interval mends that. So the share of such trials is printed with its own interval,
# beside
# the median, which such trials do not decide, and a sentence warns where any was seen.

FAR = 5.0  # times the median trial's RMSE


def mark_outliers(mse: Array) -> Array:
    """1.0 for a trial whose RMSE exceeds `FAR` times that of the median trial, else 0.0; from squared errors (k,)."""
    return (mse > FAR**2 * np.median(mse)).astype(float) if len(mse) else np.zeros(0)


def outlier_share(mse: Array) -> statistics.Interval:
    """The share of such trials, with Wilson's interval, which reaches to 16 % where 20 trials show none."""
    return statistics.share(mark_outliers(mse[~np.isnan(mse)]))


def outlier_warnings(table: pd.DataFrame) -> list[str]:
    """A sentence on each row of `summarize` or `compare` whose RMSE a few trials decide."""
    return [_outlier_warning(row) for row in table[table["outlying"] > 0].to_dict("records")]


def _outlier_warning(row: dict[Any, Any]) -> str:
    count = round(row["outlying"] * row["trials"])
    ends = interval(percent)(row["outlying_low"], row["outlying_high"])
    return (
        f"{row['scenario']}, {row['estimator']}: {count} of {row['trials']} trials ({ends or 'no interval'}) err more "
        f"than {FAR:g} times as much as the median trial, {metres(row['rmse_median'])} m; they decide the RMSE, "
        f"{metres(row['rmse'])} m, and its interval is too narrow; diverged: {percent(row['diverged'])} of robots"
    )


# Tables over trials: what each estimator achieves, and how it differs from a baseline on the same streams.

# The fields of `cooploc run --json`; `summarize` says what they mean.
SUMMARY = (
    *("scenario", "estimator", "robots", "trials", "rmse", "rmse_low", "rmse_high", "anees", "anees_low", "anees_high"),
    *("coverage95", "diverged", "failed", "messages", "bytes", "seconds", "stream", "certificate"),
)
# What `compare` shows unless it is asked for all.
SHORT = (
    *("scenario", "estimator", "trials", "rmse", "rmse_low", "rmse_high", "change", "change_low", "change_high"),
    *("p_holm", "rmse_median", "outlying", "anees", "anees_median", "collapsed", "consistency", "coverage95", "nll"),
    *("diverged", "failed", "bytes", "seconds", "centralised", "bound", "senses", "certificate"),
)
Cell = tuple[str, str]  # labels of a scenario and an estimator
MARGIN = 0.05  # two estimators whose RMSE differ by less than this share tie


def summarize(errors: pd.DataFrame) -> pd.DataFrame:
    """One row per (scenario, estimator), in order of appearance. Trials that failed count as `failed`, nothing else.

    A trial whose error is not finite has failed, too. Where a trial failed, the numbers are of the others, and so not
    of the same trials as those of another estimator: such a one does not qualify as best, is not ranked, and no
    difference in its favour is significant.

    Intervals (`_low`, `_high`) are 95 % ones over trials; they are nan below five trials.

    Columns:
        scenario: label of the scenario
        estimator: label of the estimator
        robots: robots in the team
        trials: trials that succeeded
        rmse [m]: square root of the mean over trials of the trial's mean squared position error
        rmse_low, rmse_high [m]: its interval
        anees: position NEES / 2, per trial first, then over trials; 1 is consistent
        anees_low, anees_high: its interval
        coverage95: share of true positions inside the 95 % ellipse
        diverged: share of (trial, robot) whose last-quarter RMSE exceeds a quarter of the arena's side
        failed: trials that failed
        messages: messages per robot and tick, as sent
        bytes: bytes per robot and tick, as sent
        seconds [s]: computing time per robot and tick
        stream: hash of the scenario's stream, over its trials
        certificate: one line on the estimator's checks; empty for a built-in one, and where none were asked for
        anees_median: median over trials of the trial's ANEES; a single collapsed trial does not decide it
        collapsed: share of trials whose ANEES exceeds `consistency.COLLAPSED`, 100
        collapsed_low, collapsed_high: its interval (Wilson)
        coverage95_low, coverage95_high: interval of coverage95
        diverged_low, diverged_high: interval of diverged
        rmse_median [m]: median over trials of the trial's RMSE; a few diverged trials do not decide it
        outlying: share of trials whose RMSE exceeds `outliers.FAR`, 5, times that median; where there are any, the
            interval of RMSE is too narrow
        outlying_low, outlying_high: its interval (Wilson); at 0 of 20 trials it reaches to 16 %
        nll: mean negative log-likelihood of the true position [nats]; smaller is better, as of `errors`
        area95 [m^2]: mean area of the 95 % ellipse
        mean_error [m]: mean Euclidean position error
        median_error [m]: median position error of a robot in a trial, averaged
        final_error [m]: position error at the last tick, averaged
        max_error [m]: largest position error of a robot in a trial, averaged

    Args:
        errors: from `errors`, or the rows of a run directory.

    Raises:
        BadInput: `errors` is not such a table.

    """
    _demand_errors(errors)
    return _summary(errors, trial_means(errors))


def compare(
    errors: pd.DataFrame, baseline: str | Mapping[str, str], margin: float = MARGIN, full: bool = False
) -> pd.DataFrame:
    """Every estimator against a baseline, trial by trial on the same streams; one row per (scenario, estimator).

    A change or difference is negative where the estimator's error is smaller than the baseline's.

    Columns:
        scenario, estimator, trials, rmse, rmse_low, rmse_high: as of `summarize`
        change: RMSE / the baseline's RMSE - 1; -0.2 is an error 20 % smaller
        change_low, change_high: its 95 % interval (Fieller), over trials
        p_holm: p of the test that the interval of `change` inverts, adjusted by Holm over all rows of the table
        rmse_median, outlying, anees, anees_median, collapsed: as of `summarize`
        consistency: over-confident, consistent, conservative, over-wide, not shown or not assessed; see
            `consistency.flag`
        coverage95, nll, diverged, failed, bytes, seconds: as of `summarize`
        centralised: True for an estimator whose readings all reach one computer
        bound: True for a centralised one that bounds all others
        senses: what it reads beside odometry, in words
        certificate: as of `summarize`

    With `full=True` the table has all columns of `summarize` too, and these.

    More columns:
        offline: True for an estimator that saw the readings of later ticks, too; never best, and not ranked
        baseline: label of the estimator that the row is compared with
        pairs: trials in which both succeeded
        difference [m]: mean over trials of RMSE minus the baseline's
        difference_low, difference_high [m]: its 95 % t interval
        bca_low, bca_high: interval of `change` by the BCa bootstrap, a cross-check of Fieller's
        p: p against equal RMSE, not adjusted: below 0.05 where the interval of `change` excludes 0, and nowhere else;
            1 where the one that looks better failed in a trial
        effect: matched-pairs rank-biserial correlation in [-1, 1], which says in how many trials errors are smaller
            (negative), and not by how much RMSE is; it decides nothing
        p_equal: p of the equivalence test on the RMSE; small where the two tie within `margin`; 1 where one failed
        trials_for_margin: trials at which `change` would be known to plus or minus `margin`
        p_equal_holm: p_equal, adjusted by Holm

    Args:
        errors: from `errors`, or the rows of a run directory.
        baseline: an estimator's label, or one for each scenario's label.
        margin: the share of RMSE by which two estimators may differ and still tie.
        full: all columns instead of those that are read most.

    Raises:
        BadInput: `errors` is not such a table, the baseline is not in it, or rows to be paired are of different
            streams or ticks.

    """
    _demand_errors(errors)
    against = _baselines(errors, baseline)
    if not margin > 0:
        raise BadInput(f"margin is {margin}; it must lie above 0, such as {MARGIN}")
    demand_same_streams(errors)
    cells = trial_means(errors)
    table = _summary(errors, cells)
    table["consistency"] = consistency(table)
    kinds = errors[CELL].assign(offline=is_offline(errors), centralised=errors["centralised"], bound=errors["bound"])
    for standing in ("centralised", "bound", "offline"):
        table[standing] = kinds.groupby(CELL, sort=False)[standing].any().to_numpy()
    known = errors if SENSES in errors else errors.assign(senses="")  # results of former versions lack it
    table[SENSES] = known.groupby(CELL, sort=False)[SENSES].first().fillna("").to_numpy()
    failed = {(row["scenario"], row["estimator"]): row["failed"] > 0 for row in table.to_dict("records")}
    rows = [_pair(cells, failed, (scenario, name), against[scenario], margin) for scenario, name in failed]
    pairs = pd.DataFrame(rows)
    for test in ("p", "p_equal"):
        pairs[f"{test}_holm"] = statistics.holm(pairs[test].to_numpy())
    last = ["stream", "certificate"]
    everything = pd.concat([table.drop(columns=last), pairs, table[last]], axis=1)
    return everything if full else everything[list(SHORT)]


def _demand_errors(errors: object) -> None:
    if not isinstance(errors, pd.DataFrame):
        raise BadInput(f"errors is of type {type(errors).__name__}; it must be the table that cl.errors returns")
    missing = [name for name in COLUMNS if name not in errors]
    if missing:
        raise BadInput(f"errors has no column {missing[0]!r}; it must be the table that cl.errors returns")


def _baselines(errors: pd.DataFrame, baseline: str | Mapping[str, str]) -> Mapping[str, str]:
    """The baseline of every scenario."""
    known, scenarios = list(errors["estimator"].unique()), list(errors["scenario"].unique())
    against = baseline if isinstance(baseline, Mapping) else dict.fromkeys(scenarios, baseline)
    for scenario in scenarios:
        if scenario not in against:
            raise BadInput(f"baseline names none for scenario {scenario!r}: add it")
        if against[scenario] not in known:
            name = against[scenario]
            raise BadInput(f"there is no estimator {name!r} to compare with; {nearest(str(name), known)}")
    return against


def _summary(errors: pd.DataFrame, cells: dict[Cell, pd.DataFrame]) -> pd.DataFrame:
    """The table of `summarize`, from the trials of every cell."""
    groups = errors.groupby(CELL, sort=False)
    return pd.DataFrame([_row(str(s), str(e), group, cells[str(s), str(e)]) for (s, e), group in groups])


def _row(scenario: str, estimator: str, group: pd.DataFrame, trials: pd.DataFrame) -> dict[str, object]:
    """A row of `summarize`."""
    ended = drop_failed(group)
    mse, anees = (statistics.mean_of_positive(trials[name].to_numpy(float)) for name in ("mse", "anees"))
    return {
        "scenario": scenario,
        "estimator": estimator,
        "robots": int(group["robots"].iloc[0]),
        "trials": len(trials),
        **_value_and_ends("rmse", statistics.Interval(*np.sqrt(mse))),
        **_value_and_ends("anees", anees),
        "coverage95": trials["coverage95"].mean(),
        "diverged": ended["diverged"].mean(),
        "failed": group["trial"].nunique() - len(trials),
        **{cost: ended[cost].mean() for cost in ("messages", "bytes", "seconds")},
        "stream": stream_hash(group),
        "certificate": _certificate(group),
        "anees_median": trials["anees"].median(),
        **_value_and_ends("collapsed", collapsed(trials["anees"].dropna().to_numpy(float))),
        **_ends("coverage95", statistics.share(trials["coverage95"].dropna().to_numpy(float))),
        **_ends("diverged", statistics.share(trials["diverged"].dropna().to_numpy(float))),
        "rmse_median": np.sqrt(trials["mse"]).median(),
        **_value_and_ends("outlying", outlier_share(trials["mse"].to_numpy(float))),
        **{score: trials[score].mean() for score in SCORES},
        **{f"{kind}_error": trials[f"{kind}_error"].mean() for kind in ("mean", "median", "final", "max")},
    }


def _certificate(group: pd.DataFrame) -> str:
    """The line of a cell's rows; empty where there is none."""
    lines = list(group["certificate"].dropna()) if "certificate" in group else []
    return str(lines[0]) if lines else ""


def _pair(
    cells: dict[Cell, pd.DataFrame], failed: dict[Cell, bool], cell: Cell, baseline: str, margin: float
) -> dict[str, object]:
    """What `compare` adds to a row."""
    none, (scenario, estimator) = pd.Series(dtype=float), cell
    base, mine = (cells[one]["mse"] if one in cells else none for one in ((scenario, baseline), cell))
    both = pd.concat([base, mine], axis=1, join="inner", keys=["base", "mine"]).dropna()
    a, b = both["base"].to_numpy(), both["mine"].to_numpy()
    change, n = statistics.change(a, b), len(both)
    other = estimator != baseline
    tested = other and n >= statistics.LEAST_TRIALS
    lost = failed.get((scenario, baseline), False), failed[cell]
    p = statistics.p_of_difference(a, b) if tested else np.nan
    p_equal = statistics.equivalence(a, b, margin) if tested else np.nan
    return {
        "baseline": baseline,
        "pairs": n,
        **_value_and_ends("difference", statistics.mean(np.sqrt(b) - np.sqrt(a))),
        **_value_and_ends("change", change),
        **_ends("bca", statistics.change_bca(a, b)),
        "p": 1.0 if p == p and lost[int(change.value < 0)] else p,
        "effect": statistics.signed_rank(np.sqrt(a), np.sqrt(b))[1] if tested else np.nan,
        "p_equal": 1.0 if p_equal == p_equal and any(lost) else p_equal,
        "trials_for_margin": sequential.trials_for_width(change, n, margin) if other else np.nan,
    }


def _value_and_ends(name: str, interval: statistics.Interval) -> dict[str, float]:
    return {name: interval.value, **_ends(name, interval)}


def _ends(name: str, interval: statistics.Interval) -> dict[str, float]:
    return {f"{name}_low": interval.low, f"{name}_high": interval.high}

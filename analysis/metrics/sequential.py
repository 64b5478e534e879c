"""Confidence sequences, runs that stop when their questions are decided, and how many trials a comparison needs.

A 95 % interval that is looked at again and again misses the truth sooner or later; a sequence does so, at any of all
looks, in at most 5 % of runs. Of n differences d:

    t = mean(d) / (s / sqrt(n)),   R = t^2 / (n - 1 + t^2)
    e(n) = sqrt(c^2 / (n + c^2)) (1 - R n / (n + c^2))^(-n/2)

e is the likelihood ratio of "mean(d) / sigma is drawn from N(0, 1 / c^2)" to "mean(d) = 0", which reaches 1 / alpha
with probability alpha at most (Ville 1939). The theta for which d - theta does not reach it are the sequence, exact for
normal differences. Where a few trials decide a mean its logarithm is not normal: sequences are as wide as over 1.5
times the effective number of trials (sum v)^2 / sum v^2 (Kish 1965), by the worlds of `reports/statistics.md`.

Sources: T. L. Lai, "On confidence sequences", Annals of Statistics 4, 1976; H. Wang, A. Ramdas, "Anytime-valid t-tests
and confidence sequences for Gaussian means with unknown variance", Sequential Analysis 44, 2025 (Gaussian mixture);
I. Waudby-Smith et al., "Time-uniform central limit theory and asymptotic confidence sequences", Annals of Statistics
52, 2024.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ndtri, stdtr

from cooploc.analysis.metrics.errors import CELL, trial_means
from cooploc.analysis.metrics.statistics import LEAST_TRIALS, LEVEL, MARGIN, Interval, Stopping, holm, quantile
from cooploc.estimators.interface import Array

C2 = 4.0  # c^2: an effect of half a standard deviation is expected; b is smallest near 70 trials
ALPHA = 0.05
LARGEST = 700.0  # logarithm of an e-value, beyond which none is told from another


def boundary(n: float) -> float:
    """Return b(n), how many standard errors the sequence reaches to either side; nan where it is unbounded (n < 7).

    b^2 = (n - 1) (K - 1) / (1 - K c^2 / (n + c^2)),  K = ((n + c^2) / (c^2 alpha^2))^(1/n).
    """
    K = ((n + C2) / (C2 * ALPHA**2)) ** (1 / n)
    bounded = 1 - K * C2 / (n + C2)
    return float(np.sqrt((n - 1) * (K - 1) / bounded)) if bounded > 0 else np.nan


def e_value(t: float, n: float) -> float:
    """Return the evidence e(n) of a t statistic against a mean of 0; its inverse is a p-value at any stopping."""
    R = explained_share(t, n)
    log = 0.5 * np.log(C2 / (n + C2)) - n / 2 * np.log1p(-R * n / (n + C2))
    return float(np.exp(np.minimum(log, LARGEST)))


def one_sided_e_value(t: float, n: float) -> float:
    """Return the evidence against a mean of at most 0, 2 e(n) P(effect > 0 | d): the posterior is t, n degrees."""
    R = explained_share(t, n)
    S = np.sign(t) * np.sqrt(R * n)  # sum of d, over the root of the sum of d^2; nan where there is no sequence
    positive = stdtr(n, np.sqrt(n) * S / np.sqrt((n + C2) * (1 - R * n / (n + C2))))
    return float(2 * positive * e_value(t, n))


def explained_share(t: float, n: float) -> float:
    """Return R, the share of the sum of d^2 that the mean explains: 1 where d has no spread, nan without a t."""
    return 1.0 if np.isinf(t) else t * t / (n - 1 + t * t)


# ---- intervals and tests of a run that may have stopped at any look

WORTH = 1.5  # trials that an effective one counts for


def effective(values: Array) -> float:
    """Return the number of trials that a sequence over positive `values` (trial, j) counts."""
    kish = (values.sum(0) ** 2 / (values**2).sum(0)).min()
    return float(np.minimum(len(values), WORTH * kish))


def _is_tie(change: Interval) -> bool:
    """Return whether a change of RMSE lies within 1/(1 + MARGIN) .. 1 + MARGIN."""
    return change.low >= -MARGIN / (1 + MARGIN) and change.high <= MARGIN


ANYTIME: Stopping = Stopping(  # confidence sequences
    boundary,
    trials=effective,
    contrast_trials=effective,
    test_trials=len,
    p=lambda t, n: float(1 / np.maximum(1.0, e_value(t, n))),
    p_one_sided=lambda t, n: float(1 / np.maximum(1.0, one_sided_e_value(t, n))),
    equal=lambda a, b: _is_tie(ANYTIME.change(a, b)),
)


# ---- which comparisons of a run are decided, at which look

FIRST = 10  # trials at the first look; each later one doubles them
OPEN, FAILED = "open", "failed"


def looks(most: int) -> list[int]:
    """Return the numbers of trials after which a run of at most so many is looked at: 10, 20, 40, ..., the last one."""
    out = [min(FIRST, most)]
    while out[-1] < most:
        out.append(min(2 * out[-1], most))
    return out


class Decision(NamedTuple):
    """An estimator against its scenario's baseline, by the sequence of its change of RMSE at its last look.

    Better or worse where that excludes 0, else a tie where it lies within the margin; failed where one that this
    favours failed in a trial.
    """

    scenario: str
    estimator: str
    baseline: str
    verdict: str = OPEN  # or better, worse, tie, failed
    look: int = 0  # trials after which it was decided, or was last looked at
    change: float = np.nan  # of RMSE, against the baseline's
    low: float = np.nan  # its confidence sequence
    high: float = np.nan
    e: float = np.nan  # e-value against equal RMSE; of equals, 20 is reached in 5 % of runs at most


def decide(rows: pd.DataFrame, baselines: Mapping[str, str], most: Mapping[str, int]) -> list[Decision]:
    """Return every comparison at the look that decided it, or at the last look for which all its trials are there."""
    ran, cells = rows.groupby(CELL)["trial"].unique(), {}
    for cell, means in trial_means(rows).items():
        trials = np.sort(ran[cell])
        mse = means["mse"].reindex(trials).to_numpy(float)  # nan where a trial failed
        cells[cell] = mse[trials == np.arange(len(trials))]  # up to the first that is not there
    out = []
    for (scenario, name), mine in cells.items():
        base, found = cells[scenario, baselines[scenario]], Decision(scenario, name, baselines[scenario])
        for n in looks(most[scenario]):
            if found.verdict == OPEN and n <= min(len(base), len(mine)):
                found = _decide_at_look(found._replace(look=n), base[:n], mine[:n])
        out += [found] if name != found.baseline else []
    return out


def _decide_at_look(found: Decision, base: Array, mine: Array) -> Decision:
    """Return the decision at a look at squared errors (n,); nan: failed."""
    both = ~np.isnan(base) & ~np.isnan(mine)
    a, b = base[both], mine[both]
    change = ANYTIME.change(a, b)
    verdict = "better" if change.high < 0 else "worse" if change.low > 0 else "tie" if _is_tie(change) else OPEN
    favoured = {"better": (mine,), "worse": (base,), "tie": (base, mine)}.get(verdict, ())
    if any(np.isnan(one).any() for one in favoured):
        verdict = FAILED
    e = e_value(_t(ANYTIME.log_change(a, b), len(a)), len(a)) if len(a) else np.nan
    return found._replace(verdict=verdict, change=change.value, low=change.low, high=change.high, e=e)


def _t(log: Interval, n: int) -> float:
    """Return the t statistic over n trials of a sequence's distance from 0."""
    half = log.high - log.value
    if half == 0:
        return float(np.copysign(np.inf, log.value)) if log.value else 0.0
    return log.value / half * boundary(n)


def add_decisions(table: pd.DataFrame, found: pd.DataFrame) -> pd.DataFrame:
    """Return the table of `compare(..., full=True)` with the decision on each row, in place of tests of a fixed n.

    Columns:
        verdict, look: as of `Decision`; empty and 0 for a baseline
        p, p_holm: 1 / e, which is valid at any stopping, 1 where it rests on failures; p_holm by Holm over all rows
        p_equal, p_equal_holm: nan, for a tie is a verdict here
    """
    joined = table[CELL].merge(found[[*CELL, "verdict", "look", "e"]], how="left", on=CELL)
    p = np.where(joined["verdict"] == FAILED, 1.0, np.minimum(1.0, 1 / joined["e"].to_numpy(float)))
    verdict, look = joined["verdict"].fillna("").to_numpy(), joined["look"].fillna(0).astype(int).to_numpy()
    return table.assign(verdict=verdict, look=look, p=p, p_holm=holm(p), p_equal=np.nan, p_equal_holm=np.nan)


# ---- how many trials a comparison needs to exclude a value

PILOT = 10  # trials from which a study is planned
ROUNDS = 8  # of n = f(b(n))
POWER = float(ndtri(0.8))  # a planned number of trials succeeds in 4 of 5 repetitions


def trials_to_exclude(interval: Interval, n: int, distance: float, tests: int = 1) -> float:
    """Return the trials whose interval would, in 4 of 5 repetitions, exclude a value this far away; nan without one.

    n = ((z + z_0.8) s / distance)^2 + z^2 / 2 (Guenther 1981), with Bonferroni's z of the first of so many tests.
    """
    if not distance > 0:
        return np.nan
    z = -float(ndtri((1 - LEVEL) / 2 / tests))
    return _trials(((z + POWER) * _deviation(interval, n) / distance) ** 2 + z * z / 2)


def trials_until_decided(interval: Interval, n: int, distance: float) -> float:
    """Return the same by a confidence sequence: n = ((b(n) + z_0.8) s / distance)^2, from above."""
    if not distance > 0:
        return np.nan
    needed = 10 * trials_to_exclude(interval, n, distance)
    for _ in range(ROUNDS if np.isfinite(needed) else 0):
        needed = max(((boundary(needed) + POWER) * _deviation(interval, n) / distance) ** 2, float(FIRST))
    return _trials(needed)


def minutes(found: pd.DataFrame, column: str, jobs: int = 1) -> float:
    """Return the time [min] that the estimators of a plan take for `trials` or `until_decided`, without streams.

    A baseline runs as often as the comparison that needs most in its scenario.
    """
    needed = found[column].fillna(0.0)
    own = (needed * found["seconds"]).sum()
    base = (needed * found["baseline_seconds"]).groupby(found["scenario"]).max().sum()
    return float(own + base) / 60 / jobs


def _deviation(interval: Interval, n: int) -> float:
    """Return the standard deviation of one trial's share in an interval over n, by its wider side."""
    half = max(interval.value - interval.low, interval.high - interval.value)
    return half * np.sqrt(n) / quantile(n) if n >= LEAST_TRIALS else np.nan


def _trials(needed: float) -> float:
    return float(max(np.ceil(needed), LEAST_TRIALS)) if np.isfinite(needed) else np.nan

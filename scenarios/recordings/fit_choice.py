"""Choice between least squares and Huber's fit, by what each predicts of a part that it was not fitted on.

Of several runs each is left out once, of a single part each of five equal pieces. What is left out is scored by the
CRPS, a distance between forecast and reading that is proper and grows but linearly with an outlier. Huber's fit is
taken unless least squares is better by more than one standard error over the parts, as a tie is noise.

Sources: T. Gneiting, A. Raftery, "Strictly proper scoring rules, prediction, and estimation", JASA 102, 2007, eq. 21;
L. Breiman et al., "Classification and Regression Trees", 1984, sec. 3.4.3 (the rule of one standard error).
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from scipy.stats import norm

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.fit import (
    LEAST_SCALE,
    FitPart,
    FitSettings,
    link_residuals,
    odometry_residuals,
    team_models,
)
from cooploc.scenarios.recordings.team_log import TeamLog

PIECES = 5  # of a single part


def choose_fit(log: TeamLog, parts: Sequence[FitPart], how: FitSettings) -> tuple[FitSettings, str]:
    """Return the settings with `robust` as chosen, and a sentence that says why, with both scores."""
    if not parts:
        return how._replace(robust=True), "nothing is fitted"
    folds = list(leave_out(parts))
    errors = np.array([[held_out_error(log, *fold, how, robust) for robust in (False, True)] for fold in folds])
    errors = errors[np.isfinite(errors).all(1)]
    if len(errors) < 2:
        return how._replace(robust=True), "fitted robustly (Huber's loss); too little can be left out to compare"
    robust = is_no_worse(errors)
    chosen = "robustly (Huber's loss)" if robust else "by least squares"
    plain, huber = np.exp(np.log(errors).mean(0))
    tie = " (no more than a standard error worse)" * bool(robust and huber > plain)
    what = f"{len(errors)} {'pieces' if len(parts) == 1 else 'runs'}, left out in turn"
    return how._replace(robust=robust), (
        f"fitted {chosen}: {what}, are predicted with an error (CRPS) of {huber:.3g} by the robust fit{tie}, of "
        f"{plain:.3g} by least squares"
    )


def is_no_worse(errors: Array) -> bool:
    """Return whether log errors (folds, 2: least squares, robust) rise by one standard error over folds at most."""
    worse = np.log(errors[:, 1] / errors[:, 0])
    return bool(worse.mean() <= worse.std(ddof=1) / np.sqrt(len(worse)))


def leave_out(parts: Sequence[FitPart]) -> Iterator[tuple[list[FitPart], FitPart]]:
    """Yield what is fitted on and what is left out, part by part; a single part is cut into `PIECES` first."""
    if len(parts) == 1:
        edges = np.linspace(parts[0].begin, parts[0].end, PIECES + 1).tolist()
        parts = [parts[0]._replace(begin=a, end=b) for a, b in pairwise(edges)]
    for i, out in enumerate(parts):
        yield [part for k, part in enumerate(parts) if k != i], out


def held_out_error(log: TeamLog, fitted: Sequence[FitPart], out: FitPart, how: FitSettings, robust: bool) -> float:
    """Return the geometric mean over quantities of the mean CRPS in what is left out; nan where nothing is fitted."""
    how = how._replace(robust=robust, inflate=False)  # each reading is predicted alone
    try:
        models = team_models(log, fitted, how)
    except BadInput:
        return np.nan
    found: dict[str, list[Array]] = {}
    for one in link_residuals(log, [], out, models, how):
        found.setdefault(one.what, []).append(crps(one.residual, one.sigma))
    for what, e, sigma in odometry_residuals(log, out, models, how):
        found.setdefault(what, []).append(crps(e, sigma))
    each = np.array([np.concatenate(scores).mean() for scores in found.values() if sum(map(len, scores))])
    return float(np.exp(np.log(np.maximum(each, LEAST_SCALE)).mean())) if len(each) else np.nan


def crps(e: Array, sigma: float) -> Array:
    """Return sigma (z (2 Phi(z) - 1) + 2 phi(z) - 1/sqrt(pi)), z = e/sigma, of errors e (m,)."""
    z = e / max(sigma, LEAST_SCALE)
    return np.asarray(sigma * (z * (2 * norm.cdf(z) - 1) + 2 * norm.pdf(z) - 1 / np.sqrt(np.pi)))

"""The choice of a fit, and of a loss, by what each predicts of a part of a recording that it was not fitted on.

Of several runs each is left out once, of a single part each of five equal pieces. The simpler one is taken unless the
other is better by more than one standard error over the parts.

Sources: T. Gneiting, A. Raftery, "Strictly proper scoring rules, prediction, and estimation", JASA 102, 2007, eq. 21;
L. Breiman et al., "Classification and Regression Trees", 1984, sec. 3.4.3 (the rule of one standard error).
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import gammaln, ndtr

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.estimators.models import Displacement, Unicycle
from cooploc.estimators.robust import DEGREES, Loss, penalty
from cooploc.scenarios.recordings import fit
from cooploc.scenarios.recordings.team_log import TeamLog

PIECES = 5  # of a single part


class HeldOut(NamedTuple):
    """A left-out part of a recording, and the models that were fitted on the rest; None where that is too little."""

    part: fit.FitPart
    how: fit.FitSettings  # of the fit; each reading is predicted alone
    models: fit.TeamModels | None
    residuals: list[fit.LinkResiduals]


def choose(
    log: TeamLog, parts: Sequence[fit.FitPart], how: fit.FitSettings, robust: bool | None, loss: Loss | None
) -> tuple[fit.FitSettings, Loss, str]:
    """Return the settings with `robust`, the loss of readings, and a sentence that says why; None: to be chosen."""
    pieces = list(parts)
    if len(parts) == 1:
        edges = np.linspace(parts[0].begin, parts[0].end, PIECES + 1).tolist()
        pieces = [parts[0]._replace(begin=a, end=b) for a, b in pairwise(edges)]
    kind = "pieces" if len(parts) == 1 else "runs"

    @cache
    def hold_out(robust: bool) -> list[HeldOut]:
        settings, found = how._replace(robust=robust, inflate=False), []
        for i, out in enumerate(pieces):
            one = HeldOut(out, settings, None, [])
            with suppress(BadInput):
                models = fit.team_models(log, [*pieces[:i], *pieces[i + 1 :]], settings)
                one = one._replace(models=models, residuals=[*fit.link_residuals(log, [], out, models, settings)])
            found.append(one)
        return found

    why = "fitted as asked"
    if robust is None and not parts:
        robust, why = True, "nothing is fitted"
    elif robust is None:
        errors = [[held_out_error(log, one) for one in hold_out(which)] for which in (False, True)]
        robust, why = choose_fit(np.transpose(errors), kind)
    if loss is None:
        loss, of_loss = choose_loss(hold_out(robust), kind)
        why = f"{why}; {of_loss}"
    return how._replace(robust=robust), loss, why


def choose_fit(errors: Array, kind: str) -> tuple[bool, str]:
    """Return whether Huber's loss is minimised, by errors (parts, 2) of fits by least squares and by it, and why.

    What is left out is scored by the CRPS, a distance between forecast and reading that is proper and grows but
    linearly with an outlier. Huber's fit is taken unless least squares is better.
    """
    errors = errors[np.isfinite(errors).all(1)]
    if len(errors) < 2:
        return True, "fitted with Huber's loss (too little can be left out to compare)"
    plain, huber = np.exp(np.log(errors).mean(0))
    if is_no_worse(errors):
        return True, f"fitted with Huber's loss (CRPS of left-out {kind} {huber:.3g}, {plain:.3g} by least squares)"
    return False, f"fitted by least squares (CRPS of left-out {kind} {plain:.3g}, {huber:.3g} with Huber's loss)"


SPREADS: Mapping[Loss, float] = {  # log of the integral of exp(-rho)
    "none": float(np.log(2 * np.pi) / 2),
    "huber": float(np.log(np.sqrt(2 * np.pi) * (2 * ndtr(fit.K) - 1) + 2 * np.exp(-(fit.K**2) / 2) / fit.K)),
    "student": float(gammaln(DEGREES / 2) - gammaln((DEGREES + 1) / 2) + np.log(np.pi * DEGREES) / 2),
}


def choose_loss(found: Sequence[HeldOut], kind: str) -> tuple[Loss, str]:
    """Return the loss by which filters weigh the readings, and a sentence that says why, with its score.

    What is left out is scored by the log-likelihood of its readings under the density of each loss. Readings count
    fully unless another density is better by more than one standard error over the parts.
    """
    scores = []
    for one in found:
        d2 = np.concatenate([np.empty(0), *(e.residual / e.sigma for e in one.residuals)]) ** 2
        if len(d2):
            scores.append([(penalty(loss, d2, 1) / 2).mean() + spread for loss, spread in SPREADS.items()])
    if len(scores) >= 2:
        gains = np.array(scores)[:, :1] - np.array(scores)[:, 1:]
        mean, error = gains.mean(0), gains.std(0, ddof=1) / np.sqrt(len(gains))
        best = int(np.argmax(mean))
        if mean[best] > error[best]:
            loss = list(SPREADS)[1 + best]
            gain = f"left-out {kind}: log-likelihood {mean[best]:+.2g} a reading, standard error {error[best]:.2g}"
            return loss, f"far readings count less (loss={loss}; {gain})"
    return "none", "every reading counts fully (loss=none)"


def is_no_worse(errors: Array) -> bool:
    """Return whether log errors (folds, 2: least squares, robust) rise by one standard error over folds at most."""
    worse = np.log(errors[:, 1] / errors[:, 0])
    return bool(worse.mean() <= worse.std(ddof=1) / np.sqrt(len(worse)))


def held_out_error(log: TeamLog, one: HeldOut) -> float:
    """Return the geometric mean over quantities of the mean CRPS in what is left out; nan where nothing is fitted."""
    how, models = one.how, one.models
    if models is None:
        return np.nan
    found: dict[str, list[Array]] = {}
    for e in one.residuals:
        found.setdefault(e.what, []).append(crps(e.residual, e.sigma))
    sigmas = {"displacement": models.motion.sigma} if isinstance(models.motion, Displacement) else {}
    if isinstance(models.motion, Unicycle):
        sigmas = {"length": models.motion.sigma_v * how.tick, "turn": models.motion.sigma_omega * how.tick}
    for robot, scale in zip(log.robots, models.scales, strict=True):
        for track in fit.tracks_of([one.part], robot, how):
            for quantity, sigma in sigmas.items():
                x, y, dt = fit.PAIRS[quantity](track._replace(odometry=track.odometry * scale))
                found.setdefault(quantity, []).append(crps((y - x) / np.sqrt(dt), sigma / how.tick**0.5))
    each = np.array([np.concatenate(scores).mean() for scores in found.values() if sum(map(len, scores))])
    return float(np.exp(np.log(np.maximum(each, fit.LEAST_SCALE)).mean())) if len(each) else np.nan


def crps(e: Array, sigma: float) -> Array:
    """Return sigma (z (2 Phi(z) - 1) + 2 phi(z) - 1/sqrt(pi)), z = e/sigma, of errors e (m,)."""
    z = e / max(sigma, fit.LEAST_SCALE)
    return np.asarray(sigma * (z * (2 * ndtr(z) - 1) + 2 * fit.normal_density(z) - 1 / np.sqrt(np.pi)))

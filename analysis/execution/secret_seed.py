"""Does an estimator know the seed of the study? Its errors under that seed, and under a secret one."""

import secrets
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

LEVEL = 3e-4  # an honest estimator is accused in fewer than this share of certificates, however many worlds
TRIALS = 12  # of the study, and as many of the secret seed
MORE = 24  # of the secret seed where the study has fewer
BITS = 64


class Verdict(NamedTuple):
    """What the errors of the trials under both seeds say."""

    known: bool  # the errors under the study's seed are too small for chance
    said: str


def drawn() -> int:
    """A seed that no estimator can know before its certificate is written."""
    return secrets.randbits(BITS)


def possible(study: int, secret: int, worlds: int) -> bool:
    """Whether so many trials could show anything at the level of one of so many worlds."""
    return bool(_least(study, secret) < LEVEL / worlds)


def verdict(study: NDArray[np.float64], secret: NDArray[np.float64], worlds: int) -> Verdict:
    """Compare RMSEs [m] of trials (k,) under the study's seed with those (m,) under the secret one.

    Wilcoxon's rank sum test, exact and one-sided: honest errors of both are draws from one distribution, whatever that
    is, so the share of false accusations is at most the level, heavy tails or not.
    """
    study, secret = study[np.isfinite(study)], secret[np.isfinite(secret)]
    if not possible(len(study), len(secret), worlds):
        return Verdict(False, f"{len(study)} and {len(secret)} trials with a result are too few to say")
    p = float(stats.mannwhitneyu(study, secret, alternative="less", method="exact").pvalue)
    means = (float(np.sqrt(np.mean(errors**2))) for errors in (study, secret))
    said = "RMSE {:.3g} m under the study's seed, {:.3g} m under a secret one".format(*means)
    return Verdict(p < LEVEL / worlds, f"{said} ({len(study)} and {len(secret)} trials, p = {p:.2g})")


def _least(study: int, secret: int) -> float:
    """The smallest p-value that so many trials can give."""
    return 1 / comb(study + secret, study)

"""The columns of a run's results, and what a reader of a row must know."""

from typing import Any

import numpy as np

from cooploc.analysis.formats import change, count, fixed, interval, metres, microseconds, p_value, percent, ratio
from cooploc.analysis.metrics.ranking import is_refused, short_certificate
from cooploc.analysis.report.tables import numbers, words
from cooploc.estimators.listing import declares_bytes, standing

SAID = {flag: flag for flag in ("over-confident", "over-wide", "conservative")} | {"not shown": "consistency not shown"}


def remark(
    estimator: str,
    certificate: str,
    consistency: str,
    centralised: bool,
    bound: bool,
    offline: bool,
    failed: int,
    rmse: float,
) -> str:
    """What a reader of a result must know."""
    remarks = [standing(estimator)] if standing(estimator) else []
    remarks += ["not ranked"] if is_refused(certificate) else []
    remarks += [SAID[consistency]] if consistency in SAID else []
    remarks += ["offline, not ranked"] if offline else ["bound"] if bound else ["centralised"] * centralised
    remarks += ["bytes as declared"] * (not centralised and declares_bytes(estimator))
    lost = "every trial failed" if np.isnan(rmse) else f"{failed} failed, numbers of the other trials"
    return ", ".join(remarks + [lost] * int(failed > 0))


def decided(verdict: str, look: int, trials: int) -> str:
    """What a run until decided found of a row, and when."""
    if not verdict:
        return ""
    stopped = verdict != "open" and trials <= look
    return f"{verdict}{', stopped' * stopped} at n = {look}"


def _of_others(form: Any) -> Any:
    """Writes a comparison with the baseline; nothing for the baseline itself."""
    return lambda estimator, baseline, *values: "" if estimator == baseline else form(*values)


def percents(digits: int) -> Any:
    """A format of a share, with so many digits."""
    return lambda share: percent(share, digits)


RMSE = (
    numbers("RMSE [m]", "rmse", form=metres),
    numbers("95 %", "rmse_low", "rmse_high", form=interval(metres), under=True),
)
ANEES = numbers("ANEES", "anees", form=ratio), numbers("95 %", "anees_low", "anees_high", form=interval(ratio))
OTHER = ("estimator", "baseline")
REMARK = words(
    "remark",
    *("consistency", "centralised", "bound", "offline", "failed", "baseline", "stream"),
    of=("estimator", "certificate", "consistency", "centralised", "bound", "offline", "failed", "rmse"),
    form=remark,
    under=True,
)
RESULTS = (
    words("scenario"),
    words("estimator"),
    REMARK,
    words("senses", under=True),
    words("checks", "certificate", form=short_certificate),
    *RMSE,
    numbers("median", "rmse_median", form=metres, detail=True),
    numbers("outlying", form=percents(0), detail=True),
    numbers("95 %", *(f"outlying_{end}" for end in ("low", "high")), form=interval(percents(0))),
    numbers("rank", form=lambda rank: fixed(rank, 1)),
    words("group"),
    numbers("vs baseline", "change", of=(*OTHER, "change"), form=_of_others(change)),
    numbers(
        "95 %",
        *(ends := ("change_low", "change_high")),
        of=(*OTHER, *ends),
        form=_of_others(interval(change)),
        under=True,
    ),
    numbers("p (Holm)", "p_holm", form=p_value, spare=2),
    *ANEES,
    numbers("median", "anees_median", form=ratio, under=True, detail=True),
    numbers("collapsed", form=percents(0), spare=7, detail=True),
    numbers("95 %", "collapsed_low", "collapsed_high", form=interval(percents(0))),
    numbers("in 95 %", "coverage95", form=percents(0), spare=4),
    numbers("NLL", "nll", form=ratio, under=True, spare=5, detail=True),
    numbers("ellipse [m²]", "area95", form=ratio, detail=True),
    numbers("diverged", form=percents(1), spare=3, detail=True),
    numbers("messages", form=ratio, spare=6, detail=True),
    numbers("bytes", form=count),
    numbers("µs", "seconds", form=microseconds, under=True),
    numbers("trials", under=True, spare=1),
)


DECIDED = words("decided", "verdict", "look", of=("verdict", "look", "trials"), form=decided)

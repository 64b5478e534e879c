"""The columns of a run's results: in the terminal, on the page, in LaTeX, Markdown and CSV, and in a paper's tables.

To add a column, add one entry to `RESULTS`: its head, the key of `compare`'s table that it shows (two keys for an
interval), and how it is written. Every table, file and legend follows.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from cooploc.analysis.formats import change, count, decimals, interval, metres, microseconds, p_value, percent, ratio
from cooploc.analysis.metrics.ranking import is_refused, short_certificate
from cooploc.analysis.report.tables import TableColumn, number_column, text_column
from cooploc.estimators.listing import declares_bytes, standing

CONSISTENCY = {flag: flag for flag in ("over-confident", "over-wide", "conservative")}
CONSISTENCY["not shown"] = "consistency not shown"
REMARKS = {  # what the words of a remark mean
    "over-wide": "ANEES below 0.1",
    "consistency not shown": "the interval of ANEES holds 0.67 or 1.5: more trials decide",
    "centralised": "every reading reaches one computer",
    "bound": "uses all readings; no estimator is better in a simulated world",
    "as published": "configured as in its paper; at its best: as the audit found it best",
}
STOPPED = (
    "decided: by the confidence sequence of the change (better or worse where it excludes 0, tie within 5 %), at that "
    "number of trials; it holds however the run stops, and p is its 1 / e. Sizes and their intervals are those of a "
    "fixed number of trials: where a row stopped, they are a little too far from 0."
)


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
    """Return what a reader of a result must know."""
    remarks = [standing(estimator), "not ranked" * is_refused(certificate), CONSISTENCY.get(consistency, "")]
    remarks += ["offline, not ranked"] if offline else ["bound"] if bound else ["centralised"] * centralised
    remarks += ["bytes as declared"] * (not centralised and declares_bytes(estimator))
    lost = "every trial failed" if np.isnan(rmse) else f"{failed} failed, numbers of the other trials"
    return ", ".join(filter(None, [*remarks, lost * int(failed > 0)]))


def decision(verdict: str, look: int, trials: int) -> str:
    """Return what a run until decided found of a row, and when."""
    if not verdict:
        return ""
    stopped = verdict != "open" and trials <= look
    return f"{verdict}{', stopped' * stopped} at n = {look}"


def share(digits: int) -> Callable[[float], str]:
    """Return a format of a share, with so many digits."""
    return lambda value: percent(value, digits)


def _write_change(estimator: str, baseline: str, value: float, trial: float) -> str:
    """Write the change against the baseline; not that of the baseline itself, and not one that one trial decides."""
    return "" if estimator == baseline else change(value) if np.isnan(trial) else "not comparable:"


def _write_change_ends(estimator: str, baseline: str, low: float, high: float, trial: float) -> str:
    if estimator == baseline:
        return ""
    return interval(change)(low, high) if np.isnan(trial) else f"trial {trial:.0f} decides"


def _ends(name: str, form: Callable[[float], str], **layout: Any) -> TableColumn:
    """Return the column of an interval, of the keys NAME_low and NAME_high."""
    return number_column("95 %", f"{name}_low", f"{name}_high", form=interval(form), **layout)


RMSE = number_column("RMSE [m]", "rmse", form=metres), _ends("rmse", metres, second_line=True)
ANEES = (
    number_column(
        "ANEES", "anees", form=ratio, about="1 is consistent, more is over-confident; median: of the trials' ANEES"
    ),
    _ends("anees", ratio),
)
VERSUS = ("estimator", "baseline")
RESULTS = (
    text_column("scenario", report_only=True),
    text_column("estimator"),
    text_column(
        "remark",
        *("consistency", "centralised", "bound", "offline", "failed", "baseline", "stream"),
        of=("estimator", "certificate", "consistency", "centralised", "bound", "offline", "failed", "rmse"),
        form=remark,
        second_line=True,
    ),
    text_column("senses", second_line=True),
    text_column("checks", "certificate", form=short_certificate),
    *RMSE,
    number_column("median", "rmse_median", form=metres, collapsed=True, report_only=True),
    number_column("outlying", form=share(0), collapsed=True, rare=True, about="trials above 5 times the median RMSE"),
    _ends("outlying", share(0), report_only=True),
    number_column("rank", form=lambda rank: decimals(rank, 1), report_only=True),
    text_column("group", report_only=True),
    number_column(
        "vs baseline",
        "change",
        of=(*VERSUS, "change", "decisive_trial"),
        form=_write_change,
        about="change of RMSE on the same streams, with its interval; not comparable where one trial decides it",
    ),
    number_column(
        "95 %",
        *("change_low", "change_high"),
        of=(*VERSUS, "change_low", "change_high", "decisive_trial"),
        form=_write_change_ends,
        second_line=True,
    ),
    number_column(
        "p (Holm)",
        "p_holm",
        form=p_value,
        priority=2,
        about="the test that the interval inverts, adjusted by Holm over the whole study",
    ),
    ANEES[0],
    replace(ANEES[1], report_only=True),
    number_column("median", "anees_median", form=ratio, second_line=True, collapsed=True),
    number_column(
        "collapsed", form=share(0), priority=7, collapsed=True, rare=True, about="trials whose ANEES exceeds 100"
    ),
    _ends("collapsed", share(0), report_only=True),
    number_column("in 95 %", "coverage95", form=share(0), priority=4),
    number_column(
        "NLL",
        "nll",
        form=ratio,
        second_line=True,
        priority=5,
        collapsed=True,
        about="negative log-likelihood of the true position; smaller is better",
    ),
    number_column("ellipse [m²]", "area95", form=ratio, collapsed=True, report_only=True),
    number_column("diverged", form=share(1), priority=3, collapsed=True, rare=True),
    number_column(
        "messages",
        form=ratio,
        priority=6,
        collapsed=True,
        about="messages, bytes and µs are per robot and tick",
    ),
    number_column("bytes", form=count),
    number_column("µs", "seconds", form=microseconds, second_line=True),
    number_column("trials", second_line=True, priority=1, report_only=True),
)
DECIDED = text_column("decided", "verdict", "look", of=("verdict", "look", "trials"), form=decision)


def result_columns(baselines: Iterable[str], until_decided: bool) -> tuple[TableColumn, ...]:
    """Return the columns of some rows of `compare`, with the baseline's name in a head where there is only one."""
    names = set(baselines)
    head = f"vs {names.pop()}" if len(names) == 1 else "vs baseline"
    columns = (*RESULTS, DECIDED) if until_decided else RESULTS
    return tuple(replace(column, head=head) if column.head == "vs baseline" else column for column in columns)

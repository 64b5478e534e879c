"""What the one line of a certificate means.

"passed: 16 checks", "passed: 15 of 16 checks; axes: why", "failed: causality: why", "unchecked: why"; each may end with
"; trained on: what".

An empty line stands for a built-in estimator.
"""

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.consistency import DOUBTFUL
from cooploc.analysis.metrics.errors import TRAINED
from cooploc.analysis.metrics.sequential import FIXED, Stopping
from cooploc.estimators.interface import Array, Mask

DECLARED = "bytes are as declared"


def is_refused(line: str) -> bool:
    """Whether a certificate's line excludes an estimator from the ranking."""
    return line.startswith("failed")


def failed_check(line: str) -> str:
    """The name of the check that a refused estimator failed."""
    return line.partition(": ")[2].partition(":")[0]


def short_certificate(line: str) -> str:
    """A certificate's line in a few words: "✓ 16 checks", "✓ 15 of 16 checks; axes", "✗ causality", "unchecked"."""
    line, _, learned = line.partition(TRAINED)
    status, _, found = line.partition(": ")
    count, *exempt = found.split("; ")
    passed = "; ".join([f"✓ {count}", *filter(None, (_brief(one) for one in exempt))])
    said = {"passed": passed, "failed": f"✗ {failed_check(line)}"}.get(status, status)
    return f"{said}; trained on {learned}" if learned else said


def certificate_remarks(table: pd.DataFrame) -> list[str]:
    """A sentence on each estimator in a table of `compare` that did not pass its checks."""
    once = table.drop_duplicates("estimator")
    lines = zip(once["estimator"], once["certificate"], strict=True)
    return [_remark(name, line) for name, line in lines if line and not _whole(line)]


def _whole(line: str) -> bool:
    """Whether every check passed without an exemption."""
    return line.startswith("passed") and "; " not in line


def _brief(exemption: str) -> str:
    """The name of what is exempt; of a team whose traffic the runner does not carry, what that means."""
    name, _, why = exemption.partition(": ")
    return DECLARED if why.endswith(DECLARED) else name if why else ""


def _remark(name: str, line: str) -> str:
    status, _, found = line.partition(": ")
    if status == "passed":
        return f"{name} passed {found}"
    return f"{name} failed a check and is not ranked: {found}" if status == "failed" else f"{name} is {status}: {found}"


# Which estimators qualify as best, mean ranks and groups over trials, and the Pareto front of accuracy and cost.

ALPHA = 1 - statistics.LEVEL


def disqualifications(row: Mapping[Any, Any]) -> list[str]:
    """Why an estimator does not qualify as best in a scenario, from its row of `compare`; empty where it does.

    To qualify it must have passed its checks, be distributed, have seen no reading before its time, have failed in no
    trial, and have a covariance that was assessed and found neither over-wide nor over-confident: not by its interval,
    nor by an ANEES above `DOUBTFUL`, however wide.
    """
    flag, offline = row["consistency"], bool(row.get("offline", False))
    reasons = {
        f"failed the check {failed_check(row['certificate'])}": is_refused(row["certificate"]),
        "a bound": bool(row["bound"]),
        "offline": offline,
        "centralised": bool(row["centralised"] and not row["bound"] and not offline),
        "over-confident": flag == "over-confident",
        "probably over-confident": flag == "not shown" and row["anees"] > DOUBTFUL,
        "over-wide": flag == "over-wide",
        "consistency not assessed": flag == "not assessed",
        f"{row['failed']} trial{'' if row['failed'] == 1 else 's'} failed": row["failed"] > 0,
    }
    return [reason for reason, holds in reasons.items() if holds]


def rank_groups(mse: pd.DataFrame, stopping: Stopping = FIXED) -> tuple[dict[str, float], dict[str, str]]:
    """Mean ranks of estimators and their `letters`, from squared errors: a row per trial, a column per estimator.

    No ranks in a run that may have stopped at any look: its estimators have different numbers of trials, and a mean of
    ranks over the few that all have would leave out the others. There are no letters below two estimators or
    `statistics.LEAST_TRIALS` trials.
    """
    ranks = mse.rank(axis=1).mean().to_dict() if stopping is FIXED else {}
    enough = len(mse) >= statistics.LEAST_TRIALS and mse.shape[1] > 1
    return {str(name): float(r) for name, r in ranks.items()}, letters(mse, stopping) if enough else {}


def letters(mse: pd.DataFrame, stopping: Stopping = FIXED) -> dict[str, str]:
    """Letters of estimators from squared errors; those that share one do not differ significantly at 5 %.

    All pairs by the test of the change of RMSE, each over the trials that both have (nan: has not), adjusted by Holm:
    the rule by which everything else is decided, so that letters never contradict an interval.
    """
    names = [str(name) for name in mse.columns]
    values = mse.to_numpy(float).T
    pairs = list(combinations(range(len(names)), 2))
    p = statistics.holm(np.array([stopping.p_of_difference(*_shared(values[[i, j]])) for i, j in pairs]))
    if not (p < ALPHA).any():
        return dict.fromkeys(names, "a")
    import scikit_posthocs

    square = np.ones((len(names), len(names)))
    for (i, j), one in zip(pairs, np.nan_to_num(p, nan=1.0), strict=True):
        square[i, j] = square[j, i] = one
    found = scikit_posthocs.compact_letter_display(pd.DataFrame(square, names, names), alpha=ALPHA)
    return {str(name): str(marks).replace(" ", "") for name, marks in found.items()}


def _shared(pair: Array) -> Array:
    """The trials (2, k) that both have."""
    both: Array = pair[:, ~np.isnan(pair).any(0)]
    return both


def pareto_front(rmse: Array, cost: Array) -> Mask:
    """The Pareto front (k,): True where no other is as good in both RMSE and cost and better in one; False at a nan."""
    known = np.isfinite(rmse) & np.isfinite(cost)
    no_worse = (rmse <= rmse[:, None]) & (cost <= cost[:, None]) & known  # (i, j): j is no worse than i
    better = no_worse & ((rmse < rmse[:, None]) | (cost < cost[:, None]))
    efficient: Mask = known & ~better.any(1)
    return efficient

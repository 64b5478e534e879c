"""Reasons why an estimator does not qualify as best; mean ranks and groups over trials; the front of error and cost.

The line of a certificate is "passed: 12 checks", "passed: 11 of 12 checks; axes: why", "failed: causality: why" or
"unchecked: why"; each may end with "; trained on: what". It is empty for a built-in estimator.
"""

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.consistency import DOUBTFUL
from cooploc.analysis.metrics.errors import TRAINED
from cooploc.analysis.metrics.statistics import FIXED, Stopping
from cooploc.estimators.interface import Array
from cooploc.estimators.label_syntax import shorten_labels
from cooploc.scenarios.check_harness import TIME_OVER

ALPHA = 1 - statistics.LEVEL


def is_refused(line: str) -> bool:
    """Return whether a certificate's line excludes an estimator from the ranking."""
    return line.startswith("failed")


def missing_checks(line: str) -> str:
    """Return what a certificate's line lacks: "was not checked", or in full; empty where all checks were made."""
    if line.startswith("unchecked"):
        return "was not checked"
    return "was not checked in full, as time was over" if TIME_OVER in line else ""


def short_certificate(line: str) -> str:
    """Return a certificate's line in a few words: "✓ 12 checks", "✓ 11 of 12 checks, not axes", "✗ causality"."""
    line, _, learned = line.partition(TRAINED)
    status, _, found = line.partition(": ")
    said = status
    if status == "passed":
        count, *exempt = found.split("; ")  # an exemption is "axes: why"
        parted = [one.partition(": ") for one in exempt]
        names = [name if name.endswith(" skipped") else f"not {name}" for name, _, why in parted if why]
        said = ", ".join([f"✓ {count}", *names])
    elif status == "failed":
        said = f"✗ {_failed_check(line)}"
    return f"{said}; trained on {learned}" if learned else said


def certificate_remarks(table: pd.DataFrame) -> list[str]:
    """Return a sentence on each estimator in a table of `compare` that did not pass its checks."""
    once, out = table.drop_duplicates("estimator"), []
    for name, line in zip(once["estimator"], once["certificate"], strict=True):
        name, (status, _, found) = shorten_labels(name), line.partition(": ")
        if status == "failed":
            out.append(f"{name} failed a check and is not ranked: {found}")
        elif status == "passed":
            out += [f"{name} passed {found}"] if "; " in line else []
        elif line:
            out.append(f"{name} is {status}: {found}")
    return out


def _failed_check(line: str) -> str:
    return line.partition(": ")[2].partition(":")[0]


def disqualifications(row: Mapping[Any, Any]) -> list[str]:
    """Return why an estimator does not qualify as best in a scenario, from its row of `compare`; empty where it does.

    To qualify it must have passed its checks, be distributed, have seen no reading before its time, have failed in no
    trial, and have a covariance that was assessed and found neither over-wide nor over-confident.
    """
    flag, offline = row["consistency"], bool(row.get("offline", False))
    reasons = {
        f"failed the check {_failed_check(row['certificate'])}": is_refused(row["certificate"]),
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
    """Return mean ranks of estimators and their `letters`, from squared errors (trial, estimator).

    No ranks in a run that may have stopped at any look, whose estimators have different numbers of trials; no letters
    below two estimators or `statistics.LEAST_TRIALS` trials, or where the alphabet is too short.
    """
    ranks = mse.rank(axis=1).mean().to_dict() if stopping is FIXED else {}
    enough = len(mse) >= statistics.LEAST_TRIALS and 1 < mse.shape[1] <= MOST_LETTERS
    return {str(name): float(r) for name, r in ranks.items()}, letters(mse, stopping) if enough else {}


MOST_LETTERS = 52  # of the alphabet, in both cases


def letters(mse: pd.DataFrame, stopping: Stopping = FIXED) -> dict[str, str]:
    """Return letters of estimators from squared errors; those of one letter do not differ significantly at 5 %.

    All pairs by the test of the change of RMSE, each over the trials that both have (nan: has not), adjusted by Holm.
    """
    return _letters([str(name) for name in mse.columns], statistics.holm(_pairwise_p(mse, stopping)), ALPHA)


SEPARATED = 0.01  # of a board: with an adjusted p of 5 %, up to 11 % of boards of ten equal methods showed a separation
FEWEST_SEPARATED = 10  # trials; with fewer, skewed errors are called different too often at any usual level


def board_letters(parts: Mapping[str, pd.DataFrame], stopping: Stopping = FIXED) -> dict[str, dict[str, str]]:
    """Return `letters` of every scenario of a board, "a" for the lowest error: one family of all pairs of all of them.

    Two are separated where Holm's adjusted p is below `SEPARATED`, over at least `FEWEST_SEPARATED` common trials.
    """
    p = [_pairwise_p(mse, stopping, FEWEST_SEPARATED) for mse in parts.values()]
    ends = np.cumsum([len(one) for one in p])[:-1]
    out = {}
    for (name, mse), adjusted in zip(parts.items(), np.split(statistics.holm(np.concatenate(p)), ends), strict=True):
        marks = _letters([str(one) for one in mse.columns], adjusted, SEPARATED)
        error = {str(one): float(value) for one, value in mse.mean().items()}
        used = sorted({*"".join(marks.values())}, key=lambda x: sorted(error[e] for e in marks if x in marks[e]))
        renamed = dict(zip(used, sorted(used), strict=True))
        out[name] = {one: "".join(sorted(map(renamed.__getitem__, mark))) for one, mark in marks.items()}
    return out


def _pairwise_p(mse: pd.DataFrame, stopping: Stopping, least: int = 0) -> Array:
    """Return p against equal RMSE of all pairs of columns; nan below `least` common trials."""
    values = mse.to_numpy(float).T
    pairs = (values[[i, j]] for i, j in combinations(range(len(values)), 2))
    both = (pair[:, ~np.isnan(pair).any(0)] for pair in pairs)  # trials that both have
    return np.array([stopping.p_of_difference(a, b) if len(a) >= least else np.nan for a, b in both])


def _letters(names: list[str], p: Array, alpha: float) -> dict[str, str]:
    """Return letters from the adjusted p of all pairs."""
    if not (p < alpha).any():
        return dict.fromkeys(names, "a")
    import scikit_posthocs

    square = np.ones((len(names), len(names)))
    for (i, j), one in zip(combinations(range(len(names)), 2), np.nan_to_num(p, nan=1.0), strict=True):
        square[i, j] = square[j, i] = one
    try:
        found = scikit_posthocs.compact_letter_display(pd.DataFrame(square, names, names), alpha=alpha)
    except ValueError:  # there are more groups
        return {}
    return {str(name): str(marks).replace(" ", "") for name, marks in found.items()}

"""What failed in a run, each different failure once."""

from typing import NamedTuple

import pandas as pd

from cooploc.analysis.formats import counted

SHOWN = 10  # trials that are named
FEW = 3  # scenarios that are named


def failures(rows: pd.DataFrame) -> list[tuple[str, str]]:
    """Each different failure of an estimator in a line with its trials, and where it was raised."""
    failed = rows[rows["failure"].notna()].drop_duplicates(["scenario", "estimator", "trial"])
    out = []
    for (estimator, failure), part in failed.groupby(["estimator", "failure"], sort=False):
        out.append((f"{estimator}, {_where(part)}: {failure}", str(part["traceback"].iloc[0])))
    return out


def _where(part: pd.DataFrame) -> str:
    """The trials of one scenario, or how many there are in which scenarios."""
    scenarios = list(dict.fromkeys(part["scenario"]))
    if len(scenarios) == 1:
        trials = ", ".join(map(str, sorted(part["trial"])[:SHOWN])) + " ..." * (len(part) > SHOWN)
        return f"{scenarios[0]}, trial {trials}"
    named = ", ".join(scenarios[:FEW]) + " ..." * (len(scenarios) > FEW)
    return f"{counted(len(part), 'trial')} of {counted(len(scenarios), 'scenario')} ({named})"


class FailureKind(NamedTuple):
    """A failure that occurred in one trial or in many, whatever numbers its message holds."""

    message: str  # of its first trial
    trials: int
    where: list[tuple[str, str, int]]  # scenario, estimator, trials
    traceback: str  # of its first trial


def failure_kinds(rows: pd.DataFrame) -> list[FailureKind]:
    """Each kind of failure once, the most frequent first."""
    failed = rows[rows["failure"].notna()].drop_duplicates(["scenario", "estimator", "trial"])
    kinds = failed["failure"].astype(str).str.replace(r"\d+(\.\d+)?(e[-+]?\d+)?", "0", regex=True)
    found = []
    for _, part in failed.groupby(kinds, sort=False):
        cells = part.groupby(["scenario", "estimator"], sort=False)
        where = [(str(scenario), str(estimator), len(one)) for (scenario, estimator), one in cells]
        found.append(FailureKind(str(part["failure"].iloc[0]), len(part), where, str(part["traceback"].iloc[0])))
    return sorted(found, key=lambda kind: -kind.trials)

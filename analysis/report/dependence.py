"""What results depend on, in two sentences per swept parameter, made from the table of sensitivity alone."""

from typing import Any

import pandas as pd

from cooploc.analysis.formats import counted, interval, listed, metres


def sentences(table: pd.DataFrame, baseline: str = "arl") -> list[tuple[str, str]]:
    """For each swept parameter: (parameter, who depends on it most and least, and who beats the baseline where).

    Args:
        table: from `cl.sensitivity`.
        baseline: the estimator that its changes are against.

    """
    groups = table.groupby("parameter", sort=False)
    return [(str(name), f"{_range(part)} {_against(part, baseline)}") for name, part in groups]


def _range(part: pd.DataFrame) -> str:
    """Whose largest error is the largest multiple of the smallest one, and whose is the smallest multiple."""
    error = part.groupby("estimator", sort=False)["rmse"]
    factor = (error.max() / error.min()).dropna()
    if len(factor) < 2:
        return "Fewer than two estimators were run."
    most, least = str(factor.idxmax()), str(factor.idxmin())
    return f"{most} depends on it most, with {_ends(part, most)}; {least} least, with {_ends(part, least)}."


def _ends(part: pd.DataFrame, name: str) -> str:
    """The smallest and the largest error of an estimator, with the values where they are."""
    mine = part[(part["estimator"] == name) & part["rmse"].notna()].sort_values("rmse").to_dict("records")
    return f"{_error(mine[0])} and {_error(mine[-1])}"


def _error(row: dict[Any, Any]) -> str:
    ends = interval(metres)(row["rmse_low"], row["rmse_high"])
    return f"{metres(row['rmse'])} m{f' ({ends})' if ends else ''} at {row['value']:g}"


def _against(part: pd.DataFrame, baseline: str) -> str:
    """At how many values each estimator's error is below the baseline's, and above it, by the paired interval."""
    counts: dict[tuple[int, int, int], list[str]] = {}
    for name in (str(each) for each in dict.fromkeys(part["estimator"]) if each != baseline):
        mine = part[part["estimator"] == name]
        better, worse = int((mine["change_high"] < 0).sum()), int((mine["change_low"] > 0).sum())
        counts.setdefault((better, worse, len(mine)), []).append(name)
    if not counts:
        return f"Only {baseline} was run."
    said = [_standing(names, baseline, *where) for where, names in sorted(counts.items(), reverse=True)]
    return f"By paired intervals, {'; '.join(said)}."


def _standing(names: list[str], baseline: str, better: int, worse: int, n: int) -> str:
    one = len(names) == 1
    beat, lose = ("beats", "loses") if one else ("beat", "lose")
    wins = f"{beat} {baseline} at {_of(better, n)}"
    loses = f"{lose} to it at {_of(worse, n)}" if better else f"{lose} to {baseline} at {_of(worse, n)}"
    if not (better or worse):
        return f"{listed(names)} neither {beat} {baseline} nor {lose} to it at any of {counted(n, 'value')}"
    return f"{listed(names)} {' and '.join([wins] * bool(better) + [loses] * bool(worse))}"


def _of(some: int, n: int) -> str:
    return f"all {counted(n, 'value')}" if some == n else f"{some} of {counted(n, 'value')}"

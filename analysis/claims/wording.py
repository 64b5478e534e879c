"""Verdicts in words: sentences made from the numbers alone."""

from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.formats import change, fixed, interval, ratio

# kind -> what is said of a number above 0, and of one below; {} is its size without a sign
WORDS = {
    "change": (
        "the RMSE of {of} is {} higher than that of {than}",
        "the RMSE of {of} is {} lower than that of {than}",
    ),
    "trend": ("the RMSE of {of} grows by {}", "the RMSE of {of} falls by {}"),
    "all": (
        "the worst case: the RMSE of {of} is {} higher than that of {than}",
        "the narrowest case: the RMSE of {of} is {} lower than that of {than}",
    ),
    "same": ("the largest change: the RMSE of {of} grows by {}", "the largest change: the RMSE of {of} falls by {}"),
    "growth": (
        "the RMSE of {of} grows by {} for each further unit of what is swept",
        "the RMSE of {of} falls by {} for each further unit of what is swept",
    ),
    "interaction": (
        "the RMSE of {of} grows by a factor {} larger than that of {than}",
        "the RMSE of {of} grows by a factor {} smaller than that of {than}",
    ),
    "level": ("the RMSE of {of} is {}",) * 2,
    "time": ("the computing time of {of} per robot and tick is {}",) * 2,
    "consistency": ("the ANEES of {of} is {}",) * 2,
    "slope": ("the seconds of {of} per robot and tick grow with the number of robots to the power {}",) * 2,
    "cost": ("{of} takes {} more time than {than}", "{of} takes {} less time than {than}"),
}
MANY = 100_000  # trials; a plan for more of them is useless
UNITS = {"level": " m", "slope": "", "consistency": "", "time": " s"}  # all others are relative changes
PARTS = {"slope": "sizes", "cost": "parts of the run", "time": "parts of the run"}  # that a number is over; else trials


def sentence(row: "pd.Series[Any]") -> str:
    """One verdict in words."""
    if row["verdict"] == "not testable":
        return f"Not testable: {row['remark']}."
    if row["verdict"] == "not run":
        return f"Not run: {row['remark']}."
    where, n = row["scenario"], f"{row['trials']:.0f}"
    kind, value, low, high = str(row["kind"]), float(row["value"]), float(row["low"]), float(row["high"])
    if value == low == high == 0:
        same = f"equals that of {row['than']}" if row["than"] else "stays the same"
        return f"{where}: the RMSE of {row['of']} {same} in each of {n} trials. {verdict(row)}."
    if np.isnan(value):
        return f"{where}: an RMSE of 0 leaves no number to give ({n} trials). {verdict(row)}."
    said = WORDS[kind][value < 0].format(number(value, kind).lstrip("+-"), of=row["of"], than=row["than"])
    size, by_ratio = float(row["size"]), ", as a ratio of errors" * (row["definition"] == "ratio")
    claimed = f" Claimed{by_ratio}: {number(size, kind)}." if size == size else ""
    counted = PARTS.get(kind, "trials")
    ends = "no 95 % interval" if np.isnan(low) else f"95 % interval {between(low, high, kind)}"
    otherwise = f" Read {row['otherwise']}." if row.get("otherwise") else ""
    return f"{where}: {said} ({ends}, {n} {counted}).{claimed} {verdict(row)}.{otherwise}"


def span(part: pd.DataFrame) -> tuple[str, str]:
    """What is claimed, and the numbers found in the cases of one claim and reading: from the least to the largest.

    Of a single case its interval is given.
    """
    part = part[part["value"].notna()]
    if part.empty:
        return "", ""
    kind, claimed = str(part["kind"].iloc[0]), number(float(part["size"].iloc[0]), str(part["kind"].iloc[0]))
    values = [number(float(value), kind) for value in (part["value"].min(), part["value"].max())]
    if len(part) == 1 and part["low"].notna().all():
        return claimed, f"{values[0]} ({between(float(part['low'].iloc[0]), float(part['high'].iloc[0]), kind)})"
    return claimed, " to ".join(dict.fromkeys(values))


def verdict(row: "pd.Series[Any]") -> str:
    """A verdict, the look at which a run reached it, and how many trials would decide an undecided one."""
    needed = float(row["needed"])
    if row["verdict"] != "undecided":
        return str(row["verdict"]).capitalize() + (f" at n = {row['look']:.0f}" if row.get("look", 0) > 0 else "")
    if not needed < MANY:
        return "Undecided" if needed != needed else f"Undecided; more than {MANY} trials would decide"
    return f"Undecided; about {needed:.0f} trials would decide"


def number(value: float, kind: str) -> str:
    """The number that a kind of claim is about, with its unit; a change has its sign."""
    if kind == "time":
        return f"{fixed(1e3 * value, 2)} ms" if value == value else ""
    if kind in UNITS:
        return ratio(value) + (UNITS[kind] if value == value else "")
    return change(value)


def between(low: float, high: float, kind: str) -> str:
    """Both ends of its 95 % interval; nothing where there is none."""
    return interval(lambda end: number(end, kind))(low, high) if np.isfinite(low) else ""

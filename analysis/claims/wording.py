"""Verdicts in words and in a table: sentences made of the numbers, that say no more than they do."""

from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from cooploc.analysis.claims.ledger import Ledger

STYLES = {"supported": "green", "direction only": "yellow", "contradicted": "red", "undecided": "cyan"}
# kind -> what is said of a positive number, and of a negative one; {} is its size
WORDS = {
    "improvement": (
        "the RMSE of {of} is {} lower than that of {than}",
        "the RMSE of {of} is {} higher than that of {than}",
    ),
    "improvement, ratio": (
        "the RMSE of {than} is {} higher than that of {of}",
        "the RMSE of {than} is {} lower than that of {of}",
    ),
    "trend": ("the RMSE of {of} falls by {}", "the RMSE of {of} grows by {}"),
    "trend, ratio": ("the RMSE of {of} is {} higher in the first", "the RMSE of {of} is {} lower in the first"),
    "all": (
        "the narrowest case: the RMSE of {of} is {} lower than that of {than}",
        "the worst case: the RMSE of {of} is {} higher than that of {than}",
    ),
    "same": ("the largest change: the RMSE of {of} falls by {}", "the largest change: the RMSE of {of} grows by {}"),
    "growth": (
        "the RMSE of {of} grows by {} for each further unit of what is swept",
        "the RMSE of {of} falls by {} for each further unit of what is swept",
    ),
    "interaction": (
        "the RMSE of {of} grows by a factor {} larger than that of {than}",
        "the RMSE of {of} grows by a factor {} smaller than that of {than}",
    ),
    "level": ("the RMSE of {of} is {}", ""),
    "slope": ("the seconds of {of} per robot and tick grow with the number of robots to the power {}", ""),
    "cost": ("{of} takes {} less time than {than}", "{of} takes {} more time than {than}"),
}
MANY = 100_000  # trials; a plan for more of them is none
UNITS = {"level": " m", "slope": ""}  # all others are shares


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
        return f"{where}: the RMSE of {row['of']} {same} in each of {n} trials. {_verdict(row)}."
    if not np.isfinite(value):
        return f"{where}: an RMSE that is 0 or not finite leaves no number to give ({n} trials). {_verdict(row)}."
    words = WORDS[kind + (", ratio" if row["definition"] == "ratio" else "")]
    turned = value < 0 and bool(words[1])
    if turned:
        value, low, high = -value, -high, -low
    said = words[turned].format(_number(value, kind), of=row["of"], than=row["than"])
    size = float(row["size"])
    claimed = f" Claimed: {_number(size, kind)}." if size == size else ""
    counted = "sizes" if kind == "slope" else "parts of the run" if kind == "cost" else "trials"
    return f"{where}: {said} ({_within(low, high, kind)}, {n} {counted}).{claimed} {_verdict(row)}."


def _within(low: float, high: float, kind: str) -> str:
    """The 95 % interval in words; an end that lies at infinity is no end."""
    if np.isnan(low):
        return "no 95 % interval"
    if np.isinf(low) and np.isinf(high):
        return "95 % interval without ends"
    if np.isinf(high):
        return f"95 % interval {_number(low, kind)} or more, without an upper end"
    if np.isinf(low):
        return f"95 % interval {_number(high, kind)} or less, without a lower end"
    return f"95 % interval {_number(low, kind)} to {_number(high, kind)}"


def span(part: pd.DataFrame) -> tuple[str, str]:
    """What is claimed, and the numbers found in the cases of one claim and reading: from the least to the largest.

    One case is told with its interval. Of the two definitions of an improvement, the reduction.
    """
    part = part[part["value"].notna()]
    part = part[part["definition"] != "ratio"] if (part["definition"] != "ratio").any() else part
    if part.empty:
        return "", ""
    kind, claimed = str(part["kind"].iloc[0]), _number(float(part["size"].iloc[0]), str(part["kind"].iloc[0]))
    values = [_number(float(value), kind) for value in (part["value"].min(), part["value"].max())]
    if len(part) == 1 and part["low"].notna().all():
        low, high = (_number(float(part[end].iloc[0]), kind) for end in ("low", "high"))
        return claimed, f"{values[0]} ({low} to {high})"
    return claimed, " to ".join(dict.fromkeys(values))


def table(verdicts: pd.DataFrame) -> Table:
    """The cases of one claim; variants that were not run are left out."""
    shown = verdicts[(verdicts["verdict"] != "not run") | (verdicts["variant"] == verdicts["variant"].iloc[0])]
    rows = dict.fromkeys((_cells(row), STYLES.get(str(row["verdict"]), "dim")) for _, row in shown.iterrows())
    out = Table(header_style="bold", box=None, padding=(0, 1))
    said = [i for i in range(len(HEADS)) if any(cells[i] for cells, _ in rows)]  # without columns that say nothing
    for i in said:
        out.add_column(HEADS[i], justify="right" if SIDES[i] == "r" else "left", no_wrap=True)
    for cells, style in rows:
        out.add_row(*(cells[i] for i in said), style=style)
    return out


HEADS = ("reading", "scenario", "of", "than", "claimed", "found", "95 %", "trials", "verdict", "")
SIDES = "llllrrrrll"


def show(verdicts: pd.DataFrame, ledger: Ledger, console: Console | None = None) -> None:
    """Print a table for every claim, then the variants and what the words mean."""
    # Wide: a terminal may wrap a row, but numbers are never cut off.
    console = console or Console(highlight=False, markup=False, width=400)
    console.print(ledger.paper)
    for _, part in verdicts.groupby("claim", sort=False):
        first = part.iloc[0]
        where = f" ({first['where']})" if first["where"] else ""
        console.print(f"\n{first['claim']}. {first['says']}{where}", style="bold", soft_wrap=True)
        console.print(table(part))
        if part["open"].iloc[0]:
            console.print(f" open: {part['open'].iloc[0]}", style="dim", soft_wrap=True)
    console.print()
    for name, variant in ledger.variants.items():
        console.print(f"{name}: {variant.about}", style="dim", soft_wrap=True)
    console.print(_legend(verdicts), style="dim", soft_wrap=True)


def _legend(verdicts: pd.DataFrame) -> str:
    decided = int(verdicts["verdict"].isin(("supported", "direction only", "contradicted")).sum())
    return (
        "(r): ratio a/b - 1, else reduction 1 - b/a. At worst a verdict is wrong in one of twenty repetitions: of "
        f"these {decided}, some {decided / 20:.0f}."
    )


def _cells(row: "pd.Series[Any]") -> tuple[str, ...]:
    kind, mark = str(row["kind"]), " (r)" if row["definition"] == "ratio" else ""
    size, value, low, high = (_number(float(row[name]), kind) for name in ("size", "value", "low", "high"))
    scenario, of, than, remark = (_text(row[name]) for name in ("scenario", "of", "than", "remark"))
    trials = "" if pd.isna(row["trials"]) else f"{row['trials']:.0f}"
    between = f"{low} to {high}" if low else ""
    return (row["variant"], scenario, of, than, size, value and value + mark, between, trials, _verdict(row), remark)


def _text(value: Any) -> str:
    return value if isinstance(value, str) else ""


def _verdict(row: "pd.Series[Any]") -> str:
    needed = float(row["needed"])
    if row["verdict"] != "undecided":
        return str(row["verdict"]).capitalize()
    if not needed < MANY:
        return "Undecided" if needed != needed else f"Undecided; more than {MANY} trials would decide"
    return f"Undecided; about {needed:.0f} trials would decide"


def _number(value: float, kind: str) -> str:
    if np.isnan(value):
        return ""
    if np.isinf(value):
        return "∞" if value > 0 else "-∞"
    if kind in UNITS:
        return f"{value:.2f}{UNITS[kind]}"
    return f"{100 * value + 0.0:.{_digits(value)}f} %"


def _digits(share: float) -> int:
    """Decimals of a percentage: two digits that say something, of what is nearly all as well as of what is little."""
    if 0.99 <= share < 1:
        return min(4, 1 - int(np.floor(np.log10(100 * (1 - share)))))
    return 0 if abs(share) >= 0.1 else 1 if abs(share) >= 0.01 or share == 0 else 2

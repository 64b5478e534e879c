"""Verdicts in words and in a table: sentences made from the numbers alone."""

from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from cooploc.analysis.claims.ledger import Ledger

STYLES = {"supported": "green", "direction only": "yellow", "contradicted": "red", "undecided": "cyan"}
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
    "slope": ("the seconds of {of} per robot and tick grow with the number of robots to the power {}",) * 2,
    "cost": ("{of} takes {} more time than {than}", "{of} takes {} less time than {than}"),
}
MANY = 100_000  # trials; a plan for more of them is useless
UNITS = {"level": " m", "slope": ""}  # all others are relative changes


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
    if np.isnan(value):
        return f"{where}: an RMSE of 0 leaves no number to give ({n} trials). {_verdict(row)}."
    said = WORDS[kind][value < 0].format(_number(value, kind).lstrip("+-"), of=row["of"], than=row["than"])
    size, ratio = float(row["size"]), ", as a ratio of errors" * (row["definition"] == "ratio")
    claimed = f" Claimed{ratio}: {_number(size, kind)}." if size == size else ""
    counted = "sizes" if kind == "slope" else "parts of the run" if kind == "cost" else "trials"
    interval = "no 95 % interval" if np.isnan(low) else f"95 % interval {_range(low, high, kind)}"
    return f"{where}: {said} ({interval}, {n} {counted}).{claimed} {_verdict(row)}."


def _range(low: float, high: float, kind: str) -> str:
    return f"{_number(low, kind)} to {_number(high, kind)}" if np.isfinite(low) else ""


def span(part: pd.DataFrame) -> tuple[str, str]:
    """What is claimed, and the numbers found in the cases of one claim and reading: from the least to the largest.

    Of a single case its interval is given. Of a size that is claimed by two definitions, that of the change.
    """
    part = part[part["value"].notna()]
    part = part[part["definition"] == part["definition"].min()]
    if part.empty:
        return "", ""
    kind, claimed = str(part["kind"].iloc[0]), _number(float(part["size"].iloc[0]), str(part["kind"].iloc[0]))
    values = [_number(float(value), kind) for value in (part["value"].min(), part["value"].max())]
    if len(part) == 1 and part["low"].notna().all():
        return claimed, f"{values[0]} ({_range(float(part['low'].iloc[0]), float(part['high'].iloc[0]), kind)})"
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
        "Changes are b/a - 1: negative where the error falls. (r): claimed as a ratio of errors a/b. At worst a "
        f"verdict is wrong in one of twenty repetitions: of these {decided}, some {decided / 20:.0f}."
    )


def _cells(row: "pd.Series[Any]") -> tuple[str, ...]:
    kind, mark = str(row["kind"]), " (r)" if row["definition"] == "ratio" else ""
    size, value = (_number(float(row[name]), kind) for name in ("size", "value"))
    between = _range(float(row["low"]), float(row["high"]), kind)
    scenario, of, than, remark = (_text(row[name]) for name in ("scenario", "of", "than", "remark"))
    trials = "" if pd.isna(row["trials"]) else f"{row['trials']:.0f}"
    return (row["variant"], scenario, of, than, size and size + mark, value, between, trials, _verdict(row), remark)


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
    """A number with its unit; a change as a percentage with its sign."""
    if np.isnan(value):
        return ""
    if kind in UNITS:
        return f"{value:.2f}{UNITS[kind]}"
    written = f"{100 * value:+.{_digits(abs(value))}f} %"
    return written.lstrip("+-") if float(written[:-2]) == 0 else written


def _digits(share: float) -> int:
    """Decimals of a percentage: two significant ones, also of a share that is nearly all."""
    if 0.99 <= share < 1:
        return min(4, 1 - int(np.floor(np.log10(100 * (1 - share)))))
    return 0 if share >= 0.1 else 1 if share >= 0.01 or share == 0 else 2

"""Verdicts in words and in a table: sentences made of the numbers, that say no more than they do."""

from typing import Any

import pandas as pd
from rich.console import Console
from rich.table import Table

from cooploc.analysis.ledger import Ledger

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
        "the RMSE of {of} grows by {} with every step of 1 of what is swept",
        "the RMSE of {of} falls by {} with every step of 1 of what is swept",
    ),
    "interaction": (
        "the RMSE of {of} grows by a factor {} larger than that of {than}",
        "the RMSE of {of} grows by a factor {} smaller than that of {than}",
    ),
    "level": ("the RMSE of {of} is {}", ""),
    "slope": ("the seconds of {of} per robot and tick grow with the number of robots to the power {}", ""),
    "cost": ("{of} takes {} less time than {than}", "{of} takes {} more time than {than}"),
}
UNITS = {"level": " m", "slope": ""}  # all others are shares


def sentence(row: "pd.Series[Any]") -> str:
    """One verdict in words."""
    if row["verdict"] == "not testable":
        return f"Not testable: {row['remark']}."
    if row["verdict"] == "not run":
        return f"Not run: {row['remark']}."
    kind, value, low, high = str(row["kind"]), float(row["value"]), float(row["low"]), float(row["high"])
    words = WORDS[kind + (", ratio" if row["definition"] == "ratio" else "")]
    turned = value < 0 and bool(words[1])
    if turned:
        value, low, high = -value, -high, -low
    said = words[turned].format(_number(value, kind), of=row["of"], than=row["than"])
    within = f"95 % interval {_number(low, kind)} to {_number(high, kind)}, " if low == low else ""
    size = float(row["size"])
    claimed = f" Claimed: {_number(size, kind)}." if size == size else ""
    counted = "sizes" if kind == "slope" else "parts of the run" if kind == "cost" else "trials"
    return f"{row['scenario']}: {said} ({within}{row['trials']:.0f} {counted}).{claimed} {_verdict(row)}."


def table(verdicts: pd.DataFrame, ledger: Ledger) -> Table:
    """Every case that was run, under its claim; variants that were not run are left out."""
    out = Table(title=ledger.paper, title_justify="left", box=None, padding=(0, 1), header_style="bold")
    for head, side in zip(HEADS, SIDES, strict=True):
        out.add_column(head, justify="right" if side == "r" else "left", overflow="fold")
    for (claim, says), part in verdicts.groupby(["claim", "says"], sort=False):
        out.add_row(str(claim), f"[bold]{says}[/bold]", end_section=False)
        shown = part[(part["verdict"] != "not run") | (part["variant"] == part["variant"].iloc[0])]
        for _, row in shown.iterrows():
            out.add_row(*_cells(row), style=STYLES.get(str(row["verdict"]), "dim"))
    return out


HEADS = ("", "", "of", "than", "claimed", "found", "95 %", "trials", "verdict", "")
SIDES = "llllrrrrll"


def show(verdicts: pd.DataFrame, ledger: Ledger, console: Console | None = None) -> None:
    """Print the table, the variants, and what the words mean."""
    console = console or Console(highlight=False, width=220)
    console.print(table(verdicts, ledger))
    for name, variant in ledger.variants.items():
        console.print(f"{name}: {variant.about}", soft_wrap=True, markup=False)
    cases = int(verdicts["verdict"].isin(("supported", "direction only", "contradicted")).sum())
    console.print(
        "Each verdict is wrong in at most 1 of 20 repetitions, so of these "
        f"{cases} decided ones up to {cases / 20:.0f} may be. (r): ratio a/b - 1, else reduction 1 - b/a.",
        soft_wrap=True,
    )


def _cells(row: "pd.Series[Any]") -> tuple[str, ...]:
    where = f"{row['variant']}: {row['scenario']}" if isinstance(row["scenario"], str) else str(row["variant"])
    kind, mark = str(row["kind"]), " (r)" if row["definition"] == "ratio" else ""
    numbers = {name: float(row[name]) for name in ("size", "value", "low", "high", "trials")}
    told = {name: "" if v != v else _number(v, kind) for name, v in numbers.items()}
    between = f"{told['low']} – {told['high']}" if told["low"] else ""
    trials = f"{numbers['trials']:.0f}" if told["trials"] else ""
    names = ("" if not isinstance(row[key], str) else str(row[key]) for key in ("of", "than"))
    found = told["value"] and told["value"] + mark
    return ("", where, *names, told["size"], found, between, trials, _verdict(row), str(row["remark"] or ""))


def _verdict(row: "pd.Series[Any]") -> str:
    needed = float(row["needed"])
    if row["verdict"] != "undecided":
        return str(row["verdict"]).capitalize()
    return f"Undecided; about {needed:.0f} trials would decide" if needed == needed else "Undecided"


def _number(value: float, kind: str) -> str:
    if kind in UNITS:
        return f"{value:.2f}{UNITS[kind]}"
    share = 100 * value
    digits = 0 if abs(share) >= 10 else 1 if abs(share) >= 1 or share == 0 else 2
    return f"{share + 0.0:.{digits}f} %"

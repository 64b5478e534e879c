"""A run's numbers as `Table`s: who is best, who is over-confident, every experiment, the claims."""

from collections import Counter
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.claims import wording
from cooploc.analysis.claims.ledger import BASE, Ledger
from cooploc.analysis.metrics.certificate_line import mark, refused
from cooploc.analysis.report.summaries import Change, Standing, sentence
from cooploc.analysis.report.tables import Cell, Column, Table, interval, number, text

RESULTS = (
    Column("scenario", ("scenario",), False),
    Column("estimator", ("estimator",), False),
    Column("checks", ("certificate",), False),
    Column("RMSE [m]", ("rmse",)),
    Column("95 %", ("rmse_low", "rmse_high")),
    Column("rank", ("rank",)),
    Column("group", ("group",), False),
    Column("change", ("change",)),
    Column("95 %", ("change_low", "change_high")),
    Column("p (Holm)", ("p_holm",)),
    Column("ANEES", ("anees",)),
    Column("95 %", ("anees_low", "anees_high")),
    Column("in 95 %", ("coverage95",)),
    Column("diverged", ("diverged",)),
    Column("messages", ("messages",)),
    Column("bytes", ("bytes",)),
    Column("µs", ("seconds",)),
    Column("trials", ("trials",)),
    Column("remark", ("consistency", "bound", "failed", "baseline", "stream"), False),
)


FLAGS = ("over-confident", "consistent", "conservative", "undecided", "not assessed")
Ranks = dict[str, tuple[dict[str, float], dict[str, str]]]  # scenario -> mean ranks, and letters, by estimator


def results(name: str, part: pd.DataFrame, ranks: Ranks, about: str) -> Table:
    """One row per (scenario, estimator) of `compare`."""
    baselines = set(part["baseline"])
    against = f"vs {baselines.pop()}" if len(baselines) == 1 else "vs baseline"
    columns = tuple(replace(c, head=against) if c.head == "change" else c for c in RESULTS)
    rows = tuple(_result(row, ranks) for row in part.to_dict("records"))
    marks = tuple(_marks(row) for row in part.to_dict("records"))
    if not part["certificate"].any():  # all are built in
        columns, rows = columns[:2] + columns[3:], tuple(cells[:2] + cells[3:] for cells in rows)
    return Table(name, about, columns, rows, marks)


def _marks(row: dict[Any, Any]) -> dict[str, str]:
    named = {"data-scenario": row["scenario"], "data-estimator": row["estimator"]}
    certificate = {"data-certificate": row["certificate"].partition(":")[0]} if row["certificate"] else {}
    return {**named, "data-consistency": row["consistency"], **certificate}


def _result(row: dict[Any, Any], ranks: Ranks) -> tuple[Cell, ...]:
    mean, letters = ranks[row["scenario"]]
    v = {key: float(value) for key, value in row.items() if isinstance(value, int | float)}
    other = row["estimator"] != row["baseline"]
    flag = str(row["consistency"])
    remark = ["not ranked"] if refused(row["certificate"]) else []
    remark += [flag] if flag in ("over-confident", "conservative", "undecided") else []
    remark += ["bound"] if row["bound"] else []
    remark += [f"{row['failed']} failed"] if row["failed"] else []
    change = number(v["change"], 0, " %", 100)
    between = interval(v["change_low"], v["change_high"], 0, " %", 100)
    return (
        text(row["scenario"]),
        text(row["estimator"]),
        Cell(mark(row["certificate"]), (row["certificate"],)),
        number(v["rmse"], 3),
        interval(v["rmse_low"], v["rmse_high"], 3),
        number(mean.get(row["estimator"], np.nan), 1),
        text(letters.get(row["estimator"], "")),
        change if other else change._replace(text=""),
        between if other else between._replace(text=""),
        Cell(_p(v["p_holm"]), (v["p_holm"],)),
        number(v["anees"]),
        interval(v["anees_low"], v["anees_high"]),
        number(v["coverage95"], 0, " %", 100),
        number(v["diverged"], 1, " %", 100),
        number(v["messages"]),
        number(v["bytes"], 0),
        number(v["seconds"], 0, "", 1e6),
        text(row["trials"]),
        Cell(", ".join(remark), (flag, row["bound"], row["failed"], row["baseline"], row["stream"])),
    )


def where(found: dict[str, list[Standing]]) -> Table:
    """Who is best in how many scenarios of each experiment, among its estimators."""
    columns = (
        Column("experiment", ("experiment",), False),
        Column("scenarios", ("scenarios",)),
        Column("best alone", ("best",), False),
        Column("lowest RMSE, tied with others", ("tied",), False),
        Column("the only one that may be called best", ("only",), False),
        Column("nobody", ("nobody",)),
    )
    rows = []
    for name, ones in found.items():
        told = [_counted([one.best for one in ones if one.word == word]) for word in ("best", "tie", "the only one")]
        nobody = sum(one.word == "nobody" for one in ones)
        rows.append((text(name), text(len(ones)), *map(text, told), text(nobody)))
    about = (
        "Estimators and in how many scenarios of the experiment; among the estimators that the experiment has there, "
        "those that may be called best: no bounds, not over-confident nor probably so, no trial failed."
    )
    return Table("where", about, columns, tuple(rows))


def _counted(names: list[str]) -> str:
    return ", ".join(f"{name} ({count})" for name, count in Counter(names).most_common())


def best(found: list[Standing]) -> Table:
    """Who is best where."""
    columns = (
        Column("scenario", ("scenario",), False),
        Column("", ("standing",), False),
        Column("of those that may be called best", ("estimator",), False),
        Column("RMSE [m]", ("rmse",)),
        Column("95 %", ("rmse_low", "rmse_high")),
        Column("ANEES", ("anees",)),
        Column("95 %", ("anees_low", "anees_high")),
        Column("ties with", ("ties",), False),
        Column("as accurate or more, not called best", ("barred",), False),
    )
    rows = tuple(
        (
            text(one.scenario),
            text(one.word),
            text(one.best),
            number(one.rmse.value, 3),
            interval(one.rmse.low, one.rmse.high, 3),
            number(one.anees.value),
            interval(one.anees.low, one.anees.high),
            text(", ".join((*(f"{name} (equal)" for name in one.equal), *one.tied))),
            Cell(_some(one.barred), (", ".join(one.barred),)),
        )
        for one in found
    )
    marks = tuple(
        {"data-scenario": one.scenario, "data-best": one.best if one.alone else "", "title": sentence(one)}
        for one in found
    )
    about = (
        "Smallest RMSE of those that may be called best; who ties is not told apart from it by the 95 % interval of "
        "the paired change; equal: within 5 %, by two one-sided t tests."
    )
    return Table("best", about, columns, rows, marks)


def _some(names: tuple[str, ...]) -> str:
    """The first two; a list that is longer than a line is for programs."""
    return ", ".join(names[:2]) + (f" and {len(names) - 2} more" if len(names) > 2 else "")


def confidence(table: pd.DataFrame) -> Table:
    """Who is over-confident, over all scenarios."""
    columns = (
        Column("estimator", ("estimator",), False),
        Column("scenarios", ("scenarios",)),
        Column("over-confident", ("over_confident",)),
        Column("consistent", ("consistent",)),
        Column("conservative", ("conservative",)),
        Column("undecided", ("undecided",)),
        Column("not assessed", ("not_assessed",)),
        Column("largest ANEES", ("anees",)),
        Column("in", ("scenario",), False),
    )
    rows = []
    for name, part in table.groupby("estimator", sort=False):
        counts = part["consistency"].value_counts()
        flags = [text(int(counts.get(flag, 0))) for flag in FLAGS]
        largest = (
            None if part["anees"].isna().all() else part.sort_values("anees").iloc[len(part.dropna(subset="anees")) - 1]
        )
        worst = (
            (number(float("nan")), text(""))
            if largest is None
            else (number(largest["anees"]), text(largest["scenario"]))
        )
        rows.append((text(name), text(len(part)), *flags, *worst))
    about = (
        "Scenarios by ANEES: over-confident where its 95 % interval lies all above 1.5, conservative all below 0.67, "
        "consistent where ANEES lies between, undecided where it does not and the interval does not tell."
    )
    return Table("consistency", about, columns, tuple(rows))


def sweep(name: str, found: list[Change], parameter: str) -> Table:
    """How RMSE changes over a sweep."""
    columns = (
        Column("estimator", ("estimator",), False),
        Column("RMSE [m], first", ("first",)),
        Column("last", ("last",)),
        Column("change", ("change",)),
        Column("95 %", ("change_low", "change_high")),
        Column("trials", ("trials",)),
    )
    rows = tuple(
        (
            text(one.estimator),
            number(one.first, 3),
            number(one.last, 3),
            number(one.share.value, 0, " %", 100),
            interval(one.share.low, one.share.high, 0, " %", 100),
            text(one.trials),
        )
        for one in found
    )
    about = f"From the first to the last value of {parameter}; jackknife intervals over trials, not adjusted."
    return Table(name, about, columns, rows)


def claims(verdicts: pd.DataFrame, paper: str) -> Table:
    """The ledger: one row per claim, reading and case."""
    columns = (
        Column("claim", ("claim",), False),
        Column("says", ("says", "where"), False),
        Column("reading", ("variant", "kind", "definition"), False),
        Column("found", ("scenario", "of", "than", "value", "low", "high", "trials"), False),
        Column("verdict", ("verdict", "needed"), False),
        Column("remark", ("remark",), False),
        Column("left open by the paper", ("open",), False),
    )
    rows, marks = [], []
    for _, row in _shown(verdicts).iterrows():
        where = f"{row['says']} ({row['where']})" if row["where"] else row["says"]
        found = tuple(row[key] for key in columns[3].keys)
        said = row["verdict"] in ("not run", "not testable")  # the sentence gives the reason
        rows.append(
            (
                text(row["claim"]),
                Cell(where, (row["says"], row["where"])),
                Cell(str(row["variant"]), (row["variant"], row["kind"], row["definition"])),
                Cell(wording.sentence(row), found),
                Cell(str(row["verdict"]), (row["verdict"], row["needed"])),
                Cell("" if said else _text(row["remark"]), (_text(row["remark"]),)),
                text(row["open"]),
            )
        )
        marks.append({"data-claim": str(row["claim"]), "data-verdict": str(row["verdict"])})
    return Table("claims", f"Verdicts on the claims of {paper}", columns, tuple(rows), tuple(marks))


class Part(NamedTuple):
    """A claim of the ledger."""

    head: str
    open: str  # what the paper leaves open
    table: Table  # its rows of the ledger
    run: bool  # whether any case of it was


def by_claim(ledger: Table, verdicts: pd.DataFrame) -> list[Part]:
    """The ledger's table claim by claim, without the columns that say the same in every row."""
    out: list[Part] = []
    for claim, part in verdicts.groupby("claim", sort=False):
        rows = [i for i, marks in enumerate(ledger.marks) if marks["data-claim"] == str(claim)]
        first = part.iloc[0]
        told = part.loc[part["variant"] == first["variant"], "verdict"].value_counts()
        verdict = ", ".join(f"{count} {name}" if len(told) > 1 else str(name) for name, count in told.items())
        where = f" ({first['where']})" if first["where"] else ""
        table = Table(
            f"claims-{len(out) + 1}",
            f"Claim {claim}: every reading and case that was run.",
            ledger.columns[2:-1],
            tuple(ledger.rows[i][2:-1] for i in rows),
            tuple(ledger.marks[i] for i in rows),
        )
        out.append(
            Part(
                f"{claim}. {first['says']}{where}: {verdict}",
                str(first["open"]),
                table,
                bool((part["verdict"] != "not run").any()),
            )
        )
    return out


def overview(found: pd.DataFrame, verdicts: pd.DataFrame, ledger: Ledger) -> Table:
    """Claims by readings, with the numbers of the first."""
    columns = (
        Column("", ("claim",), False),
        Column("the paper says", ("says",), False),
        Column("claimed", ("claimed",)),
        Column("found", ("found",)),
        *(Column("verdict" if name == BASE else str(name), (str(name),), False) for name in found),
    )
    says = {claim.id: claim.says for claim in ledger.claims}
    numbers = {c: wording.span(part) for c, part in verdicts[verdicts["variant"] == BASE].groupby("claim", sort=False)}
    rows = tuple(
        tuple(text(told) for told in (claim, says[claim], *numbers.get(claim, ("", "")), *row))
        for claim, row in zip(found.index, found.to_numpy(), strict=True)
        if any(row)
    )
    about = (
        "Verdicts by claim: as the paper states it, then in other readings; counts where cases differ; without claims "
        "of which nothing was run. Found: from the least to the largest of the cases, as the paper states it; of one "
        "case, with its 95 % interval."
    )
    return Table("verdicts", about, columns, rows)


def _shown(verdicts: pd.DataFrame) -> pd.DataFrame:
    """Without variants that were not run, and what was not run once for each reason."""
    first = verdicts.groupby("claim", sort=False)["variant"].transform("first")
    run = verdicts["verdict"] != "not run"
    return verdicts[run | ((verdicts["variant"] == first) & ~verdicts.duplicated(["claim", "verdict", "remark"]))]


def _text(value: object) -> str:
    return value if isinstance(value, str) else ""


def _p(value: float) -> str:
    if value != value:
        return ""
    return f"{value:.3f}" if value >= 0.001 else "<0.001"

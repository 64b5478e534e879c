"""A ledger's claims and their verdicts as `Table`s."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pandas as pd

from cooploc.analysis.claims import multiverse, verdicts
from cooploc.analysis.claims.ledger import BASE, Ledger, load
from cooploc.analysis.claims.verdicts import (
    DECIDED,
    JUDGED,
    interval_text,
    number_text,
    span_text,
    verdict_sentence,
    verdict_text,
)
from cooploc.analysis.execution.run_directory import StoredRun
from cooploc.analysis.formats import count, p_value
from cooploc.analysis.metrics.sequential import ANYTIME
from cooploc.analysis.metrics.statistics import FIXED
from cooploc.analysis.report.tables import Table, number_column, text_column, words
from cooploc.estimators.errors import count_of

SHOWN = 3  # reasons why cases of a claim were not run


def _stands(stands: bool, verdict: str, p: float) -> str:
    return ("yes" if stands else "no") if verdict in DECIDED and p == p else ""


HOLM = (
    number_column("p (Holm)", "p_holm", "p", of=("p_holm",), form=p_value),
    text_column("stands", of=("stands", "verdict", "p_holm"), form=_stands),
)


def claims(verdicts: pd.DataFrame, ledger: Ledger) -> Table:
    """Return the ledger: one row per claim, reading and case; of cases that were not run, one for each reason."""
    found = ("scenario", "of", "than", "value", "low", "high", "trials")
    columns = (
        text_column("claim"),
        text_column("says", "head"),
        text_column("reading", "variant", "kind", "definition", "size", of=("variant",)),
        text_column("found", *found, of=("sentence",)),
        text_column("verdict", "verdict", "needed", "otherwise", of=("verdict",)),
        *HOLM,
        text_column("remark", of=("verdict", "remark"), form=_remark),
        text_column("left open by the paper", "open", collapsed=True),
    )
    first = verdicts.groupby("claim", sort=False)["variant"].transform("first")
    run = verdicts["verdict"] != "not run"
    shown = verdicts[run | ((verdicts["variant"] == first) & ~verdicts.duplicated(["claim", "verdict", "remark"]))]
    rows = shown.assign(
        sentence=[verdict_sentence(row) for _, row in shown.iterrows()],
        head=[f"{claim}. {name_claim(*said)}" for claim, *said in shown[["claim", "says", "where"]].to_numpy()],
        quote=shown["claim"].map({claim.id: claim.quote for claim in ledger.claims}),
    ).to_dict("records")
    marks = {"data-claim": "claim", "data-verdict": "verdict", "title": "quote"}
    return Table("claims", f"Verdicts on the claims of {ledger.paper}", columns, rows, marks)


def cases(part: pd.DataFrame) -> Table:
    """Return the cases of one claim that were run, for a terminal."""
    found = part[part["verdict"] != "not run"]
    readings = (text_column("reading", "variant"),) if found["variant"].nunique() > 1 else ()
    columns = (
        text_column("scenario"),
        *(text_column(head, second_line=True) for head in ("of", "than")),
        *readings,
        number_column("claimed", "size", of=("size", "kind"), form=number_text),
        number_column("found", "value", of=("value", "kind"), form=number_text),
        number_column("95 %", "low", "high", of=("low", "high", "kind"), form=interval_text, second_line=True),
        number_column("trials", form=count),
        text_column("verdict", of=("decision",)),
        text_column("", "otherwise", second_line=True),
        text_column("", "remark", second_line=True),
        *HOLM,
    )
    rows = found.assign(decision=[verdict_text(row) for _, row in found.iterrows()])
    return Table("cases", "", columns, rows.drop_duplicates().to_dict("records"))


def cases_not_run(part: pd.DataFrame) -> str:
    """Return how many cases of one claim, as the paper states it, were not run, and why; nothing where all were."""
    stated = part[part["variant"] == part["variant"].iloc[0]]
    reasons = stated.loc[stated["verdict"] == "not run", "remark"]
    kinds = list(dict.fromkeys(one if "did you mean" in one else one.partition(";")[0] for one in reasons))
    more = f"; and {count_of(len(kinds) - SHOWN, 'reason')} more" if len(kinds) > SHOWN else ""
    return f"not run: {len(reasons)} of {count_of(len(stated), 'case')}: {'; '.join(kinds[:SHOWN])}{more}" * bool(kinds)


def overview(found: pd.DataFrame, verdicts: pd.DataFrame, ledger: Ledger, readings: Mapping[str, str] = {}) -> Table:
    """Return claims by readings, with the numbers of the first, and the sentences of `multiverse.sentences`."""
    columns = (
        text_column("claim"),
        text_column("the paper says", "says"),
        *(replace(text_column(head), right=True) for head in ("claimed", "found")),
        *(text_column("verdict" if name == BASE else str(name), str(name)) for name in found),
        *([text_column("over all readings", "readings")] if readings else []),
    )
    says = {claim.id: claim.says for claim in ledger.claims}
    spans = {c: span_text(part) for c, part in verdicts[verdicts["variant"] == BASE].groupby("claim", sort=False)}
    rows = []
    for claim, verdict in found.to_dict("index").items():
        claimed, value = spans.get(str(claim), ("", ""))
        if any(verdict.values()):
            known = {"claimed": claimed, "found": value, "readings": readings.get(str(claim), "")}
            rows.append(verdict | {"claim": claim, "says": says[str(claim)], **known})
    return Table("verdicts", words("captions")["claims"], columns, rows)


def over_readings(shares: pd.DataFrame) -> Table:
    """Return the map of a ledger over the readings of its paper, from `multiverse.shares`: one row per claim."""
    numbers = ("specifications", "implausible", *JUDGED, *multiverse.AFTER_HOLM.values())
    columns = (
        text_column("claim"),
        *(number_column(head, form=count) for head in numbers),
        *map(text_column, ("letter", "code", "preset", "scenarios")),
        text_column("choices that matter", "dimensions"),
    )
    return Table("readings", "", columns, shares.to_dict("records"))


def name_claim(says: str, where: str) -> str:
    """Return a claim, and where the paper makes it."""
    return f"{says} ({where})" if where else says


def _remark(verdict: str, remark: object) -> str:
    """Return the remark; nothing where the sentence gives the reason already."""
    return remark if isinstance(remark, str) and verdict != "not run" else ""


# ------------------------------------------------------------------------------------------------ on the page


def claims_shown(kept: StoredRun, ledger: Ledger) -> dict[str, Any] | None:
    """Return the page's section on claims; None where the run touches no claim of the ledger that is shipped."""
    judged = verdicts.judge_run(ledger, kept.rows, kept.looks)
    if not judged["verdict"].isin(JUDGED).any() and ledger == load():
        return None
    readings = multiverse.sentences(multiverse.judge(ledger, kept.rows, ANYTIME if kept.looks else FIXED))
    table = claims(judged, ledger)
    columns = tuple(column for column in table.columns if column.head not in ("claim", "says"))
    ran = set(judged.loc[judged["verdict"] != "not run", "claim"])
    parts = [[row for row in table.rows if (row["claim"] in ran) == there] for there in (True, False)]
    run, rest = (replace(table, name=f"claims-{i}", columns=columns, rows=rows) for i, rows in enumerate(parts))
    return {
        "paper": ledger.paper,
        "sentence": f"{len(ran)} of {count_of(judged['claim'].nunique(), 'claim')} could be looked at.",
        "overview": overview(verdicts.overview(judged), judged, ledger, readings),
        "run": run,
        "not_run": rest,
        "missing": judged["claim"].nunique() - len(ran),
        "family": str(verdicts.count_verdicts(judged)),
        "table": table,
    }

"""A ledger judged over the interpretations that its paper allows: for every claim a map of verdicts instead of one.

A *specification* of a claim is one of its cases (estimators, scenario) in one interpretation, judged by the first
definition of its size. Interpretations that differ only in what does not touch the case are one specification; so are
cases with the same numbers to the last bit, such as signal strengths in worlds that differ in their ranges alone.

Sources: U. Simonsohn, J. Simmons, L. Nelson, "Specification curve analysis", Nature Human Behaviour 4, 2020;
S. Steegen et al., "Increasing transparency through a multiverse analysis", 2016.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.claims import interpretations
from cooploc.analysis.claims.interpretations import Dimensions, Interpretation
from cooploc.analysis.claims.kinds import Case, cases
from cooploc.analysis.claims.ledger import Ledger
from cooploc.analysis.claims.trial_table import Missing, TrialTable, collect
from cooploc.analysis.claims.verdicts import COLUMNS, DECIDED, JUDGED, judge_case, tally
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.errors import demand_same_streams
from cooploc.analysis.metrics.statistics import FIXED, Stopping
from cooploc.estimators.errors import BadInput
from cooploc.estimators.label_syntax import parse, write_label

ENDS = ("letter", "preset", "code")  # readings that have a name
LEVELS = ("error", "baseline", "dead_reckoning")  # RMSE [m]
ADDED = ("readings", *ENDS, *LEVELS, "implausible")
AFTER_HOLM = {name: f"{name} after Holm" for name in ("supported", "contradicted")}
OF_LEDGERS = ("variant", "otherwise", "look")  # columns of verdicts that a map does not have
SHOWN = [name for name in COLUMNS if name not in OF_LEDGERS] + list(ADDED)


def judge(ledger: Ledger, rows: pd.DataFrame, stopping: Stopping = FIXED) -> pd.DataFrame:
    """Return one row per claim and specification that was run.

    Columns are those of `verdicts.judge` without those of `OF_LEDGERS`; `readings`, how many readings of the design
    come down to this specification, and whether those of the `letter`, the `preset` and public `code` do; the RMSE [m]
    of the estimator (`error`), of the one compared with (`baseline`) and of `dead_reckoning`, nan where not
    run; `implausible` where the baseline is worse than dead reckoning; and one for every dimension, with the choice, or
    empty where it makes no difference. Estimators and scenarios are called as in the ledger.
    """
    dimensions = ledger.dimensions
    if taken := [name for name in dimensions if name in (*COLUMNS, *ADDED)]:
        raise BadInput(f"dimension {taken[0]!r} is named like a column of the verdicts: rename it in the ledger")
    demand_same_streams(rows)
    table, design = collect(rows, stopping), interpretations.design(dimensions)
    ends = {end: design.index(getattr(interpretations, end)(dimensions)) for end in ENDS}
    out: list[dict[str, Any]] = []
    for claim in ledger.claims:
        for case in cases(claim):
            for read, (choices, numbers) in specifications(case, design, dimensions).items():
                row = judge_case(read, claim, table)
                if row["verdict"] in JUDGED:
                    named = _name_as_ledger(row, case, read)
                    is_end = {end: number in numbers for end, number in ends.items()}
                    levels = _levels(read, row, table)
                    implausible = levels["baseline"] > levels["dead_reckoning"]
                    added = {"readings": len(numbers), **is_end, **levels, "implausible": implausible}
                    out.append({**row, **named, **added, **choices})
    found = pd.DataFrame(out, columns=[*SHOWN, *dimensions])
    same = found.duplicated(["claim", "of", "than", "value", "low", "high", *dimensions]) & found["value"].notna()
    found = found[~same].reset_index(drop=True)
    p_holm = statistics.holm(found["p"].to_numpy(float))
    return found.assign(p_holm=p_holm, stands=found["verdict"].isin(DECIDED) & (p_holm <= 1 - statistics.LEVEL))


def _levels(read: Case, row: dict[str, Any], table: TrialTable) -> dict[str, float]:
    """Return the RMSE [m] of a specification's estimators, and of dead reckoning, where its number is of."""
    where, than = row["scenario"].split(" to ")[-1], row["than"] if row["than"] in read.than else "".join(read.than[:1])

    def rmse(label: str) -> float:
        try:
            return float(np.sqrt(table.mse((where, label)).mean())) if label else np.nan
        except Missing:
            return np.nan

    return dict(zip(LEVELS, map(rmse, (read.of, than, "dead-reckoning")), strict=True))


def dimensions_of(found: pd.DataFrame) -> list[str]:
    """Return the dimensions that make a difference to some of these specifications."""
    return [name for name in found.columns if name not in SHOWN and (found[name] != "").any()]


def specifications(
    case: Case, design: Sequence[Interpretation], dimensions: Dimensions
) -> dict[Case, tuple[Interpretation, list[int]]]:
    """Return the specifications of a case over a design: the choices that matter, and the numbers of its readings."""
    preset = interpretations.preset(dimensions)
    matters = {
        name
        for name, one in dimensions.items()
        if any(substitute(case, {**preset, name: choice}, dimensions) != case for choice in one.choices)
    }
    found: dict[Case, tuple[Interpretation, list[int]]] = {}
    for number, reading in enumerate(design):
        shown = matters - interpretations.find_settled(reading, dimensions)
        choices = {name: choice if name in shown else "" for name, choice in reading.items()}
        found.setdefault(substitute(case, reading, dimensions), (choices, []))[1].append(number)
    return found


def substitute(case: Case, reading: Interpretation, dimensions: Dimensions) -> Case:
    """Return the case under an interpretation, in every estimator and scenario alike."""
    return case._replace(
        of=interpretations.estimator(case.of, reading, dimensions),
        than=tuple(interpretations.estimator(label, reading, dimensions) for label in case.than),
        scenarios=tuple(interpretations.scenario(label, reading, dimensions) for label in case.scenarios),
    )


def _name_as_ledger(row: dict[str, Any], case: Case, read: Case) -> dict[str, str]:
    """Return estimators and scenarios of a row by the ledger's labels."""
    than = dict(zip((*read.than, ", ".join(read.than)), (*case.than, ", ".join(case.than)), strict=True))
    kept = {key for label in case.scenarios for key in parse(label)[1]}
    where = []
    for label in row["scenario"].split(" to "):
        path, options = parse(label)
        where.append(write_label(path, {key: value for key, value in options.items() if key in kept}))
    return {"of": case.of, "than": than.get(row["than"], row["than"]), "scenario": " to ".join(where)}


# ---- how many specifications support a claim, and what these have in common


def shares(found: pd.DataFrame) -> pd.DataFrame:
    """Return one row per claim: how many specifications there are, how many have each verdict, and a sentence.

    `implausible` counts those whose baseline is worse than dead reckoning, which the verdicts count, too; `letter`,
    `preset` and `code` are the verdicts in these interpretations, `dimensions` those that make a difference.
    """
    out = []
    for claim, part in found.groupby("claim", sort=False):
        dimensions, counts = dimensions_of(part), part["verdict"].value_counts()
        standing = part.loc[part["stands"].eq(True), "verdict"].value_counts()
        out.append(
            {
                "claim": claim,
                "says": part["says"].iloc[0],
                "scenarios": ", ".join(dict.fromkeys(part["scenario"])),
                "specifications": len(part),
                "implausible": int(part["implausible"].sum()),
                **{verdict: int(counts.get(verdict, 0)) for verdict in JUDGED},
                **{after: int(standing.get(verdict, 0)) for verdict, after in AFTER_HOLM.items()},
                **{end: tally(part.loc[part[end], "verdict"]) for end in ENDS},
                "dimensions": ", ".join(dimensions),
                "sentence": shared_assumptions(part, dimensions),
            }
        )
    columns = ["claim", "says", "scenarios", "specifications", "implausible", *JUDGED, *AFTER_HOLM.values()]
    return pd.DataFrame(out, columns=[*columns, *ENDS, "dimensions", "sentence"])


def sentences(found: pd.DataFrame) -> dict[str, str]:
    """Return in how many specifications each claim holds that was run in more than the preset's."""
    beyond = set(found.loc[~found["preset"].astype(bool), "claim"])
    rows = shares(found[found["claim"].isin(beyond)]).to_dict("records")
    return {row["claim"]: f"{row['sentence']} (cl.readings)" for row in rows}


# besides the dimensions of the readings, in what specifications differ
WORDS = {"scenario": "in {}", "of": "of {}", "than": "against {}", "definition": "read as a {}"}
LEAST = 0.1  # share of the other specifications that a choice must exclude to be worth naming


def shared_assumptions(part: pd.DataFrame, dimensions: list[str]) -> str:
    """Return in how many specifications of a claim it holds, and the choice that sets these, or the others, apart."""
    holds = part["verdict"] == "supported"
    n, k = len(part), int(holds.sum())
    if k == n:
        return f"holds in all {n} specifications" if n > 1 else "holds in the only specification that was run"
    if k == 0:
        direction, open_ = (int((part["verdict"] == name).sum()) for name in ("direction only", "undecided"))
        if open_ == n:
            return f"left open in all {n} specifications"
        return f"holds in 0 of {n} specifications" + f"; its direction alone in {direction}" * (direction > 0)
    who, chosen = ("the others are", ~holds) if 2 * k > n else ("all of them" if k > 1 else "the one", holds)
    shared, most = "", LEAST * int((~chosen).sum())
    for name in [*dimensions, *WORDS]:
        choices = list(dict.fromkeys(part.loc[chosen, name]))
        excluded = int((~part.loc[~chosen, name].isin([*choices, ""])).sum())  # empty: it makes no difference
        if "" not in choices and excluded > most:
            listed = WORDS.get(name, f"with {name} = {{}}").format(" or ".join(choices))
            shared, most = f": {who} {listed}", excluded
    return f"holds in {k} of {n} specifications{shared}"

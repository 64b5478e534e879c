"""Verdicts on a ledger's claims, computed from the rows of a run and never written by hand.

A verdict holds where its zone of numbers (`kinds`) holds the whole 95 % interval of the claim's number: alone it is
false in at most one of twenty repetitions (measured in `reports/statistics.md`): *supported* in direction and size;
*direction only*; *flat*, a growth within the claim's margin; *contradicted*, the other direction or no difference at
all; else *undecided*, or *not run*.

No estimator gains by failing: where one of a case failed in a trial or a check, the case is undecided, with a p of 1,
unless it is contradicted in favour of one that did not fail. A verdict *stands* where `p_holm`, adjusted over all
cases in all variants, is at most 0.05 still: the chance that any standing verdict is false is 5 % at most (Holm 1979).
Claims about computing time never make a run go on.
"""

import re
from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.claims import kinds
from cooploc.analysis.claims.kinds import KINDS, RELATIVE, TIMED, Case, CaseVerdict, Claim, cases, definitions
from cooploc.analysis.claims.ledger import Ledger, variants
from cooploc.analysis.claims.trial_table import Missing, TrialTable, canonical, collect
from cooploc.analysis.formats import change, interval, ratio
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.compare import FAR, mark_outliers
from cooploc.analysis.metrics.consistency import flag
from cooploc.analysis.metrics.errors import demand_same_streams
from cooploc.analysis.metrics.sequential import ANYTIME
from cooploc.analysis.metrics.statistics import FIXED, Stopping
from cooploc.estimators.errors import count_of

VERDICTS = ("supported", "direction only", "flat", "contradicted", "undecided", "not run")
DECIDED, JUDGED = VERDICTS[:4], VERDICTS[:5]
WOULD_BE = "it would be "  # begins the remark of a case that failures leave undecided
CASE = ["claim", "scenario", "of", "than", "definition"]  # what makes a case of a ledger
MANY = 100_000  # trials; a plan for more of them is useless
COLUMNS = {
    "claim": "its id in the ledger",
    "says": "the claim, in the ledger's words",
    "where": "where the paper says so",
    "kind": "how it is judged",
    "variant": "the reading: paper, or a variant of the ledger",
    "scenario": "where it was looked for; of several, the one that the number is of",
    "of": "the estimator it is about",
    "than": "the one it is compared with",
    "definition": "by which it is judged, of the size: change (b/a - 1 is -0.66) or ratio (a/b - 1 is 0.66)",
    "size": "what is claimed, as a change where the number is one",
    "value": "the number found; a change is b/a - 1, negative where the error or the time is smaller",
    "low": "its 95 % interval",
    "high": "",
    "trials": "trials it is over (slope: sizes of the team; cost: parts of the run)",
    "verdict": "one of " + ", ".join(VERDICTS),
    "p": "of the verdict, by the test that its interval inverts: at most 0.05 where decided",
    "p_holm": "p, adjusted by Holm over all judged cases of the ledger",
    "stands": "whether the verdict is decided and p_holm is at most 0.05",
    "otherwise": "the verdict by another definition of the size, with the size as a change, or by other sizes [m]",
    "needed": "trials that would decide, where undecided",
    "remark": "what is missing, over-confident, over-wide, failed, centralised, or rarely far worse than usual",
    "look": "trials after which a run until decided reached the verdict, or last looked; 0 of another run",
    "open": "conditions that the paper leaves open",
}


def judge(ledger: Ledger, rows: pd.DataFrame, stopping: Stopping = FIXED) -> pd.DataFrame:
    """Return one row per claim, variant and case, with `COLUMNS`."""
    demand_same_streams(rows)
    table = collect(rows, stopping)
    out = []
    for claim in ledger.claims:
        for variant, read in variants(claim, ledger):
            out += [{"variant": variant, "look": 0, **row} for row in judge_claim(read, table)]
    return adjust(pd.DataFrame(out, columns=list(COLUMNS)))


def adjust(found: pd.DataFrame) -> pd.DataFrame:
    """Add p adjusted over all cases, each counted once in however many variants, and whether their verdicts stand."""
    p = found["p"].mask(found.duplicated(CASE)).to_numpy(float)
    known = found.assign(p_holm=statistics.holm(p)).groupby(CASE, sort=False, dropna=False)["p_holm"]
    p_holm = known.transform("first")
    return found.assign(p_holm=p_holm, stands=found["verdict"].isin(DECIDED) & (p_holm <= 1 - statistics.LEVEL))


def overview(verdicts: pd.DataFrame) -> pd.DataFrame:
    """Return claims x variants: the verdicts in each, with counts where they differ; empty where nothing was run."""
    run = verdicts[verdicts["verdict"] != "not run"]
    cells = run.groupby(["claim", "variant"], sort=False)["verdict"].agg(tally).unstack("variant")
    order = [list(dict.fromkeys(verdicts[column])) for column in ("claim", "variant")]
    return cells.reindex(index=order[0], columns=[name for name in order[1] if name in cells]).fillna("")


def tally(found: "pd.Series[str]") -> str:
    """Return verdicts with their counts, "2 supported, 1 undecided"; of one kind, the verdict alone."""
    counts = found.value_counts()
    ordered = [name for name in VERDICTS if name in counts.index]
    return ordered[0] if len(ordered) == 1 else ", ".join(f"{counts[name]} {name}" for name in ordered)


def judge_claim(claim: Claim, table: TrialTable) -> list[dict[str, object]]:
    """Return a row for every case of a claim, with its verdict by other definitions of its size."""
    out = []
    for case in cases(claim):
        first, *others = (judge_case(case._replace(definition=d), claim, table) for d in definitions(claim))
        others = [row for row in others if row["verdict"] in JUDGED]
        said = [f"as a {row['definition']} ({change(row['size'])}): {row['verdict']}" for row in others]
        for size in claim.also if first["verdict"] in JUDGED else ():
            row = judge_case(case, claim.model_copy(update={"size": size}), table)
            said.append(f"up to {size:g} m: {row['verdict']}")
        out.append({**first, "otherwise": "; ".join(said)})
    return out


def judge_case(case: Case, claim: Claim, table: TrialTable) -> dict[str, Any]:
    """Return the row of a case of a claim."""
    size = kinds.size_as_change(claim.size, case.definition)
    asked = {"of": case.of, "than": ", ".join(case.than), "definition": case.definition, "size": size}
    asked |= {"claim": claim.id, "open": "; ".join(claim.open), **claim.model_dump(include={"says", "where", "kind"})}
    try:
        scenarios = tuple(dict.fromkeys(s for label in case.scenarios for s in table.expand_label(label)))
        case = case._replace(scenarios=scenarios)
        found = KINDS[claim.kind].judge(case, claim, table)
    except Missing as e:
        return {**asked, "scenario": ", ".join(case.scenarios), "verdict": "not run", "remark": str(e)}
    lost = find_lost(case, claim, table, found) if found.verdict in DECIDED else []
    doubt = [f"{WOULD_BE}{found.verdict}, but {' and '.join(lost)} failed"] * bool(lost)
    if lost:
        found = found._replace(verdict="undecided", needed=np.nan, p=1.0)
    return {
        **asked,
        **found._asdict(),
        **found.interval._asdict(),
        "scenario": found.scenario or " to ".join(dict.fromkeys((scenarios[0], scenarios[-1]))),
        "than": found.than or asked["than"],
        "remark": "; ".join([*(doubt or _about_interval(claim, found)), *_about_estimators(case, table)]),
    }


def find_lost(case: Case, claim: Claim, table: TrialTable, found: CaseVerdict) -> list[str]:
    """Return the estimators that failed and that a verdict favours."""
    lost = [
        name
        for name in dict.fromkeys((case.of, *case.than))
        if canonical(name) in table.refused or any(table.count_failures((s, name)) for s in case.scenarios)
    ]
    if found.verdict != "contradicted":
        return lost
    upwards = claim.size is not None and claim.size > 0 and claim.kind in RELATIVE
    return [name for name in lost if name in ({case.of} if upwards else case.than)]


def _about_interval(claim: Claim, found: CaseVerdict) -> list[str]:
    """Return why an interval is missing; or, of a verdict that is left open, what its interval alone would say."""
    low, high = found.interval.low, found.interval.high
    if np.isnan(low):
        few = found.trials < statistics.LEAST_TRIALS
        return [
            f"fewer than {statistics.LEAST_TRIALS} {KINDS[claim.kind].over}" if few else "the interval is unbounded"
        ]
    direction = low > 0 if claim.size is not None and claim.size > 0 else high < 0
    if found.verdict == "undecided" and claim.kind in RELATIVE and direction:
        return ["the direction is decided, the size is not"]
    if claim.kind == "slope" and -claim.margin <= low and high <= claim.margin:
        return [f"flat: the exponent lies within {claim.margin:g} of 0"]
    return []


def _about_estimators(case: Case, table: TrialTable) -> list[str]:
    """Return which of a case's estimators are over-confident, too wide, failed, are centralised, or rarely diverge."""
    out = []
    for name in dict.fromkeys((case.of, *case.than)):
        keys = [(scenario, name) for scenario in case.scenarios]
        flags = []
        for key in keys:
            anees, coverage = table.anees(key), table.values("coverage95", key)[:, 0]
            flags.append(flag(len(anees), FIXED.mean_of_positive(anees), FIXED.mean(coverage)))
        counts = {word: flags.count(word) for word in ("over-confident", "over-wide", "conservative")}
        out += [f"{name} {word}" + (len(keys) > 1) * f" in {k} of {len(keys)}" for word, k in counts.items() if k]
        failed = sum(table.count_failures(key) for key in keys)
        far = int(sum(mark_outliers(table.mse(key)[:, 0]).sum() for key in keys))
        errs = f"{'errs' if far == 1 else 'err'} {FAR:g} times as much as the median one: intervals are too narrow"
        remarks = {
            f"{count_of(failed, 'trial')} of {name} failed": failed > 0,
            f"{name} failed a check": canonical(name) in table.refused,
            f"{count_of(far, 'trial')} of {name} {errs}": far > 0,
            f"{name} is centralised": canonical(name) in table.centralised,
        }
        out += [remark for remark, holds in remarks.items() if holds]
    return out


# ---- a run that stops when its questions are decided


def judge_run(ledger: Ledger, rows: pd.DataFrame, at: Sequence[int]) -> pd.DataFrame:
    """Return the verdicts on a run: after all of these looks, or at the end where there were none."""
    found = None
    for n in at:
        found = judge_at_look(ledger, rows, n, found)
    return judge(ledger, rows) if found is None else found


def judge_at_look(ledger: Ledger, rows: pd.DataFrame, n: int, before: pd.DataFrame | None = None) -> pd.DataFrame:
    """Return the verdicts of `judge` over the trials below n, with `look`; what was decided `before` stays."""
    now = judge(ledger, rows[rows["trial"] < n], ANYTIME)
    now["look"] = now["verdict"].isin(JUDGED) * n
    if before is None:
        return now
    decided = before["verdict"].isin(DECIDED)
    return adjust(pd.concat([before[decided], now[~decided]]).sort_index())


def drop_timed(ledger: Ledger, found: pd.DataFrame) -> pd.DataFrame:
    """Return the judged rows that are not about computing time."""
    timed = [claim.id for claim in ledger.claims if claim.kind in TIMED]
    return found[found["verdict"].isin(JUDGED) & ~found["claim"].isin(timed)]


def open_cells(ledger: Ledger, rows: pd.DataFrame, found: pd.DataFrame) -> set[tuple[str, str]]:
    """Return the (scenario, estimator) whose further trials may decide a claim, by their labels in the run."""
    table = collect(rows)
    pairs = rows[["scenario", "estimator"]].drop_duplicates().itertuples(index=False)
    names = {(canonical(s), canonical(e)): (str(s), str(e)) for s, e in pairs}
    still = found["verdict"].eq("undecided") & ~found["remark"].fillna("").str.startswith(WOULD_BE)
    going = still & found.index.isin(drop_timed(ledger, found).index)
    judged = [one for claim in ledger.claims for _, one in variants(claim, ledger)]
    asked = [case for one in judged for case in cases(one)]  # as rows of `judge`
    return {
        names[canonical(s), canonical(e)]
        for case, is_open in zip(asked, going, strict=True)
        if is_open
        for label in case.scenarios
        for s, e in product(table.expand_label(label), (case.of, *case.than))
    }


# ---- the verdicts as a family of tests


class VerdictCounts(NamedTuple):
    """The verdicts of a ledger as a family of tests."""

    judged: int  # cases
    decided: int
    stand: int  # decided, and by Holm over all judged cases too
    expected: float  # decided ones expected to be false, by `statistics.expected_false`

    def __str__(self) -> str:
        if not self.judged:
            return "No case was judged."
        are, stand = "is" if self.decided == 1 else "are", "stands" if self.stand == 1 else "stand"
        return (
            f"Of {count_of(self.judged, 'judged case')} {self.decided} {are} decided, and {self.stand} of these "
            f"{stand} after Holm's correction over all; about {self.expected:.1f} are expected to be false, judging by "
            "how many p-values lie above one half."
        )


def count_verdicts(verdicts: pd.DataFrame) -> VerdictCounts:
    """Count the verdicts of `judge` that have a p, each case once in however many variants."""
    tested = verdicts[verdicts["p"].notna()].drop_duplicates(CASE)
    judged, decided, stand = len(tested), int(tested["verdict"].isin(DECIDED).sum()), int(tested["stands"].sum())
    expected = min(statistics.expected_false(tested["p"].to_numpy(float)), (1 - statistics.LEVEL) * judged, decided)
    return VerdictCounts(judged, decided, stand, expected)


# ---- verdicts in words, from the numbers alone


def verdict_sentence(row: "pd.Series[Any]") -> str:
    """Return one verdict in words."""
    if row["verdict"] == "not run":
        return f"Not run: {row['remark']}."
    where, n = row["scenario"], f"{row['trials']:.0f}"
    kind, value, low, high = str(row["kind"]), float(row["value"]), float(row["low"]), float(row["high"])
    if value == low == high == 0:
        same = f"equals that of {row['than']}" if row["than"] else "stays the same"
        return f"{where}: the RMSE of {row['of']} {same} in each of {n} trials. {verdict_text(row)}."
    if np.isnan(value):
        return f"{where}: an RMSE of 0 leaves no number to give ({n} trials). {verdict_text(row)}."
    words = re.sub(r"\[(\w+)/(\w+)\]", r"\2" if value < 0 else r"\1", KINDS[kind].words)
    said = words.format(number_text(value, kind).lstrip("+-"), of=row["of"], than=row["than"])
    size, by_ratio = float(row["size"]), ", as a ratio of errors" * (row["definition"] == "ratio")
    claimed = f" Claimed{by_ratio}: {number_text(size, kind)}." if size == size else ""
    ends = "no 95 % interval" if np.isnan(low) else f"95 % interval {interval_text(low, high, kind)}"
    otherwise = f" Read {row['otherwise']}." if row.get("otherwise") else ""
    over = re.sub(r"s\b", "", KINDS[kind].over, count=1) if n == "1" else KINDS[kind].over
    return f"{where}: {said} ({ends}, {n} {over}).{claimed} {verdict_text(row)}.{otherwise}"


def span_text(part: pd.DataFrame) -> tuple[str, str]:
    """Return the size that a claim names, and the least and the largest number found; of one case, its interval."""
    part = part[part["value"].notna()]
    if part.empty:
        return "", ""
    first, kind = part.iloc[0], str(part["kind"].iloc[0])
    claimed = number_text(float(first["size"]), kind)
    values = [number_text(float(value), kind) for value in (part["value"].min(), part["value"].max())]
    if len(part) == 1 and part["low"].notna().all():
        return claimed, f"{values[0]} ({interval_text(float(first['low']), float(first['high']), kind)})"
    return claimed, " to ".join(dict.fromkeys(values))


def verdict_text(row: "pd.Series[Any]") -> str:
    """Return a verdict, the look at which a run reached it, and how many trials would decide an undecided one."""
    needed = float(row["needed"])
    if row["verdict"] != "undecided":
        return str(row["verdict"]).capitalize() + (f" at n = {row['look']:.0f}" if row.get("look", 0) > 0 else "")
    if not needed < MANY:
        return "Undecided" if needed != needed else f"Undecided; more than {MANY} trials would decide"
    return f"Undecided; about {needed:.0f} trials would decide"


def number_text(value: float, kind: str) -> str:
    """Return the number that a kind of claim is about, with its unit; a change has its sign."""
    unit = KINDS[kind].unit
    if unit is None:
        return change(value)
    return ratio(1e3 * value if unit == " ms" else value) + unit if value == value else ""


def interval_text(low: float, high: float, kind: str) -> str:
    """Return both ends of its 95 % interval; nothing where there is none."""
    return interval(lambda end: number_text(end, kind))(low, high) if np.isfinite(low) else ""

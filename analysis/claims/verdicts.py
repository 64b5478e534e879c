"""Verdicts on a ledger's claims, computed from the rows of a run and never written by hand.

A claim comes down to one number with its 95 % interval over trials, and each verdict to a zone of numbers, which
`kinds` gives for every kind of claim. A verdict holds where its zone holds the whole interval, so that each one, taken
alone, is wrong in one of twenty repetitions where the truth is at the zone's edge, and less often elsewhere (measured
in `reports/statistics.md`):

- *supported*: the claim's direction, and its size up to its margin;
- *direction only*: the direction, but less than the size;
- *flat*: of a claimed growth, a change over the whole sweep that is smaller than the claim's margin;
- *contradicted*: the other direction, or no difference at all;
- *undecided*: the interval reaches into several zones, or there is none. `needed` is the number of trials that would
  decide in 4 of 5 repetitions if the number stays as it is.

*not testable* says why, *not run* what is missing.

No estimator gains by failing. Where one of a case failed in a trial (an error that is not finite is a failure, too) or
failed a check, the case is not supported, not in part either, and contradicted only where the one that this favours did
not fail; it is undecided then, with a p of 1.

A ledger asks many questions at once, so that some verdicts are wrong by chance. `p` is the p-value of a verdict, by the
test that its interval inverts: at most 0.05 where it is decided. `p_holm` is adjusted over all cases that were judged,
in all variants, and a verdict *stands* where it is at most 0.05 still: the chance that any standing verdict is false is
5 % at most (Holm 1979). `family.of` counts them, and says how many of the decided ones are expected to be false.

A size that the paper's words leave open, such as "66 % more accurate", is judged once, by the definition that the
column `definition` names; `otherwise` says what the same interval means by the other one, which is another reading of
the paper: it is counted in the map over readings (`multiverse`), and not here.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.claims.claim import Case, Claim, claimed
from cooploc.analysis.claims.kinds import KINDS, RELATIVE, Judge, cases, definitions
from cooploc.analysis.claims.ledger import Ledger, variants
from cooploc.analysis.claims.ledger import load as load
from cooploc.analysis.claims.trial_table import Missing, TrialTable, collect
from cooploc.analysis.claims.zones import Finding
from cooploc.analysis.formats import change, counted
from cooploc.analysis.metrics import outliers, statistics
from cooploc.analysis.metrics.consistency import flag
from cooploc.analysis.metrics.pooling import demand_same_streams
from cooploc.analysis.metrics.stopping import FIXED, Stopping

VERDICTS = ("supported", "direction only", "flat", "contradicted", "undecided", "not testable", "not run")
DECIDED, JUDGED = VERDICTS[:4], VERDICTS[:5]
WOULD_BE = "it would be "  # begins the remark of a case that failures leave undecided
CASE = ["claim", "scenario", "of", "than", "definition"]  # what makes a case of a ledger
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
    "otherwise": "the verdict by another definition of the size, with the size as a change",
    "needed": "trials that would decide, where undecided",
    "remark": "what is missing, over-confident, over-wide, failed, centralised, or rarely far worse than usual",
    "look": "trials after which a run until decided reached the verdict, or last looked; 0 of another run",
    "open": "conditions that the paper leaves open",
}


def judge(ledger: Ledger, rows: pd.DataFrame, stopping: Stopping = FIXED) -> pd.DataFrame:
    """One row per claim, variant and case, with `COLUMNS`.

    Args:
        ledger: from `load`.
        rows: from `errors` or a run directory.
        stopping: whether the number of trials was fixed before, or may depend on results (`at_looks`).

    Raises:
        BadInput: estimators of one scenario ran on different streams.

    """
    demand_same_streams(rows)
    table = collect(rows, stopping)
    out = []
    for claim in ledger.claims:
        for variant, read in variants(claim, ledger):
            out += [{"variant": variant, "look": 0, **row} for row in judged(read, table)]
    return adjusted(pd.DataFrame(out, columns=list(COLUMNS)))


def adjusted(found: pd.DataFrame) -> pd.DataFrame:
    """With p adjusted over all cases, each counted once in however many variants, and whether their verdicts stand."""
    p = found["p"].where(once(found)).to_numpy(float)
    known = found.assign(p_holm=statistics.holm(p)).groupby(CASE, sort=False, dropna=False)["p_holm"]
    p_holm = known.transform("first")
    return found.assign(p_holm=p_holm, stands=found["verdict"].isin(DECIDED) & (p_holm <= 1 - statistics.LEVEL))


def once(found: pd.DataFrame) -> "pd.Series[bool]":
    """False for a case that stands above already, in another variant that leaves it as it is."""
    return ~found.duplicated(CASE)


def overview(verdicts: pd.DataFrame) -> pd.DataFrame:
    """Claims x variants: the verdicts in each, with their counts where they differ; empty where nothing was run."""
    run = verdicts[verdicts["verdict"] != "not run"]

    def tally(found: "pd.Series[str]") -> str:
        counts = found.value_counts()
        ordered = [name for name in VERDICTS if name in counts.index]
        return ordered[0] if len(ordered) == 1 else ", ".join(f"{counts[name]} {name}" for name in ordered)

    cells = run.groupby(["claim", "variant"], sort=False)["verdict"].agg(tally).unstack("variant")
    order = [list(dict.fromkeys(verdicts[column])) for column in ("claim", "variant")]
    return cells.reindex(index=order[0], columns=[name for name in order[1] if name in cells]).fillna("")


def judged(claim: Claim, table: TrialTable, asked: Iterable[Case] | None = None) -> list[dict[str, object]]:
    """A row for every case of a claim, with what other definitions of its size make of it; or for those asked."""
    about = {"claim": claim.id, "open": "; ".join(claim.open), **claim.model_dump(include={"says", "where", "kind"})}
    judge = KINDS[claim.kind].judge
    if judge is None:
        return [{**about, "verdict": "not testable", "otherwise": "", "remark": claim.why}]
    if asked is not None:
        return [{**about, **_found(judge, case, claim, table)} for case in asked]
    out = []
    for case in cases(claim):
        first, *others = (_found(judge, case._replace(definition=d), claim, table) for d in definitions(claim))
        out.append({**about, **first, "otherwise": "; ".join(_otherwise(row) for row in others)})
    return out


def _otherwise(row: dict[str, Any]) -> str:
    return f"as a {row['definition']} ({change(row['size'])}): {row['verdict']}" if row["verdict"] in JUDGED else ""


def _found(judge: Judge, case: Case, claim: Claim, table: TrialTable) -> dict[str, Any]:
    size = claimed(claim, case.definition)
    asked = {"of": case.of, "than": ", ".join(case.than), "definition": case.definition, "size": size}
    try:
        scenarios = tuple(dict.fromkeys(s for label in case.scenarios for s in table.matching(label)))
        case = case._replace(scenarios=scenarios)
        found = judge(case, claim, table)
    except Missing as e:
        return {**asked, "scenario": ", ".join(case.scenarios), "verdict": "not run", "remark": str(e)}
    found, doubt = _without_failures(case, claim, table, found)
    return {
        **asked,
        "scenario": found.scenario or " to ".join(dict.fromkeys((scenarios[0], scenarios[-1]))),
        "than": found.than or asked["than"],
        **found.interval._asdict(),
        "trials": found.trials,
        "verdict": found.verdict,
        "p": found.p,
        "needed": found.needed,
        "remark": "; ".join([*(doubt or _about_interval(claim, found)), *_about_estimators(case, table)]),
    }


def _without_failures(case: Case, claim: Claim, table: TrialTable, found: Finding) -> tuple[Finding, list[str]]:
    """The finding, undecided where failures stand behind it, and why."""
    lost = [name for name in dict.fromkeys((case.of, *case.than)) if _failed(name, case, table)]
    upwards = claim.size is not None and claim.size > 0 and claim.kind in RELATIVE
    favoured = {case.of} if upwards else set(case.than)  # by a contradiction
    if found.verdict == "contradicted":
        lost = [name for name in lost if name in favoured]
    if not lost or found.verdict not in DECIDED:
        return found, []
    why = [f"{WOULD_BE}{found.verdict}, but {' and '.join(lost)} failed"]
    return found._replace(verdict="undecided", needed=np.nan, p=1.0), why


def _failed(name: str, case: Case, table: TrialTable) -> int:
    """In how many trials of a case an estimator failed; one that failed a check counts as one."""
    return sum(table.failed((scenario, name)) for scenario in case.scenarios) + table.is_refused(name)


def _about_interval(claim: Claim, found: Finding) -> list[str]:
    """Why an interval is missing; or, of a verdict that is left open, what its interval alone would say."""
    low, high = found.interval.low, found.interval.high
    if np.isnan(low):
        few = found.trials < statistics.LEAST_TRIALS
        return [f"fewer than {statistics.LEAST_TRIALS} trials" if few else "the interval is unbounded"]
    direction = low > 0 if claim.size is not None and claim.size > 0 else high < 0
    if found.verdict == "undecided" and claim.kind in RELATIVE and direction:
        return ["the direction is decided, the size is not"]
    if claim.kind == "slope" and -claim.margin <= low and high <= claim.margin:
        return [f"flat: the exponent lies within {claim.margin:g} of 0"]
    return []


def _about_estimators(case: Case, table: TrialTable) -> list[str]:
    """Which of a case's estimators are over-confident or too wide, failed, are centralised, or rarely diverge."""
    out = []
    for name in dict.fromkeys((case.of, *case.than)):
        keys = [(scenario, name) for scenario in case.scenarios]
        flags = [_flag(table, key) for key in keys]
        counts = {word: flags.count(word) for word in ("over-confident", "over-wide", "conservative")}
        out += [f"{name} {word}" + (len(keys) > 1) * f" in {k} of {len(keys)}" for word, k in counts.items() if k]
        failed = sum(table.failed(key) for key in keys)
        out += [f"{counted(failed, 'trial')} of {name} failed"] if failed else []
        out += [f"{name} failed a check"] if table.is_refused(name) else []
        far = int(sum(outliers.far(table.mse(key)[:, 0]).sum() for key in keys))
        out += [f"{counted(far, 'trial')} of {name} {_outlying(far)}"] if far else []
        out += [f"{name} is centralised"] if table.is_centralised(name) else []
    return out


def _outlying(far: int) -> str:
    return f"{'errs' if far == 1 else 'err'} {outliers.FAR:g} times as much as the median one: intervals are too narrow"


def _flag(table: TrialTable, key: tuple[str, str]) -> str:
    anees, coverage = table.anees(key), table.coverage(key)
    return flag(len(anees), statistics.mean_of_positive(anees), statistics.mean(coverage))

"""Verdicts on a ledger's claims, computed from the rows of a run and never written by hand.

A claim comes down to one number with its 95 % interval over trials, and each verdict to a zone of numbers. The verdict
is the first of the list whose zone holds the whole interval, so that it is wrong in one of twenty repetitions where the
truth is at the zone's edge, and more seldom elsewhere (measured in `reports/statistics.md`):

- *supported*: the claim's direction, and its size up to its margin;
- *direction only*: the direction, but less than the size;
- *contradicted*: the other direction, or no difference whatsoever;
- *undecided*: the interval reaches into several zones, or there is none. `needed` is the number of trials that would
  decide in 4 of 5 repetitions if the number stays as it is.

*not testable* says why, *not run* what is missing. The kinds (number -> supported; direction only; contradicted):

- `improvement`: by how much `of` is better than `than` in a scenario, as error reduction 1 - b/a and as ratio a/b - 1
  (Fieller) -> above size - margin; from 0 to size; below 0. Without a size: above 0; below 0.
- `trend`: by how much the error of `of` falls from the first scenario to each later one; the same zones.
- `all`: `of` is better than every `than` in every scenario -> every improvement is above 0, an intersection-union test
  that needs no adjustment; one of them is below 0 after Holm over all of them. The number is the weakest case.
- `same`: from the first scenario to every later one the RMSE changes by less than a factor 1 + margin -> all intervals
  lie within; one of them lies outside after Holm. Each is compared with the first and not with the one before, for
  small steps may add up. The number is the largest change.
- `growth`: by how much the RMSE grows per unit of what is swept, from the slope of its logarithm, jackknife -> above 0;
  below 0.
- `interaction`: the error of `of` grows by a larger factor than that of `than`, from the first scenario to each later
  one; jackknife on the ratio of ratios -> above 1; below 1.
- `level`: RMSE [m] -> at most size; above.
- `slope`: exponent of seconds per robot and tick over the number of robots, least squares over scenarios -> at most
  size + margin; above.
- `cost`: by how much `of` takes less time than `than`; zones as `improvement`. Here a trial is not the unit but a part
  of the run, the trials whose time was taken together.

Trials of two scenarios are paired by their number. The pairs are independent of each other whether or not the two of a
pair are correlated (scenarios of one seed share some of their random numbers), so this is right in either case.
"""

from collections.abc import Iterable

import numpy as np
import pandas as pd

from cooploc.analysis.claims.kinds import FINDERS, Case, Finding, cases
from cooploc.analysis.claims.ledger import Claim, Ledger, variants
from cooploc.analysis.claims.ledger import load as load
from cooploc.analysis.claims.trial_table import Missing, Results, collect
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.compare import demand_same_streams
from cooploc.analysis.metrics.consistency import flag
from cooploc.estimators.interface import Array

VERDICTS = ("supported", "direction only", "contradicted", "undecided", "not testable", "not run")
COLUMNS = {
    "claim": "its id in the ledger",
    "says": "the claim, in the ledger's words",
    "where": "where the paper says so",
    "kind": "how it is judged",
    "variant": "the reading: paper, or a variant of the ledger",
    "scenario": "where it was looked for; of several, the one that the number is of",
    "of": "the estimator it is about",
    "than": "the one it is compared with",
    "definition": "reduction (1 - b/a) or ratio (a/b - 1), where both are given",
    "size": "what is claimed",
    "value": "the number found",
    "low": "its 95 % interval",
    "high": "",
    "trials": "trials it is over (slope: sizes of the team; cost: parts of the run)",
    "verdict": "one of " + ", ".join(VERDICTS),
    "needed": "trials that would decide, where undecided",
    "remark": "what else one must know: what is missing, over-confident, or failed",
    "open": "conditions that the paper leaves open",
}


def judge(ledger: Ledger, rows: pd.DataFrame) -> pd.DataFrame:
    """One row per claim, variant and case, with `COLUMNS`.

    Args:
        ledger: from `load`.
        rows: from `errors` or a run directory.

    Raises:
        BadInput: estimators of one scenario ran on different streams.

    """
    demand_same_streams(rows)
    results = collect(rows)
    out = []
    for claim in ledger.claims:
        for variant, read in variants(claim, ledger):
            out += [{"variant": variant, **row} for row in _judged(read, results)]
    return pd.DataFrame(out, columns=list(COLUMNS))


def overview(verdicts: pd.DataFrame) -> pd.DataFrame:
    """Claims x variants: the verdicts in each, with their counts where they differ; empty where nothing was run."""
    run = verdicts[verdicts["verdict"] != "not run"]

    def told(found: "pd.Series[str]") -> str:
        counts = found.value_counts()
        ordered = [name for name in VERDICTS if name in counts.index]
        return ordered[0] if len(ordered) == 1 else ", ".join(f"{counts[name]} {name}" for name in ordered)

    cells = run.groupby(["claim", "variant"], sort=False)["verdict"].agg(told).unstack("variant")
    order = [list(dict.fromkeys(verdicts[column])) for column in ("claim", "variant")]
    return cells.reindex(index=order[0], columns=[name for name in order[1] if name in cells]).fillna("")


def _judged(claim: Claim, results: Results) -> Iterable[dict[str, object]]:
    told = {"claim": claim.id, "open": "; ".join(claim.open), **claim.model_dump(include={"says", "where", "kind"})}
    if claim.kind == "untestable":
        return [{**told, "verdict": "not testable", "remark": claim.why}]
    size = np.nan if claim.size is None else claim.size
    return [{**told, "size": size, **_found(case, claim, results)} for case in cases(claim)]


def _found(case: Case, claim: Claim, results: Results) -> dict[str, object]:
    asked = {"of": case.of, "than": ", ".join(case.than), "definition": case.definition}
    try:
        scenarios = tuple(s for label in case.scenarios for s in results.matching(label))
        case = case._replace(scenarios=scenarios)
        found = FINDERS[claim.kind](case, claim, results)
    except Missing as e:
        return {**asked, "scenario": ", ".join(case.scenarios), "verdict": "not run", "remark": str(e)}
    return {
        **asked,
        "scenario": found.scenario or " to ".join(dict.fromkeys((scenarios[0], scenarios[-1]))),
        "than": found.than or asked["than"],
        **found.interval._asdict(),
        "trials": found.trials,
        "verdict": found.verdict,
        "needed": found.needed,
        "remark": "; ".join(_remarks(claim, case, found, results)),
    }


def _flag(anees: Array, coverage: Array) -> str:
    return flag(len(anees), statistics.mean_of_positive(anees), statistics.mean(coverage))


def _remarks(claim: Claim, case: Case, found: Finding, results: Results) -> list[str]:
    """What a reader of the verdict must know: why there is no interval, and of its estimators what bars them."""
    out = []
    if np.isnan(found.interval.low):
        few = found.trials < statistics.LEAST_TRIALS
        out += [f"fewer than {statistics.LEAST_TRIALS} trials" if few else "the interval is unbounded"]
    if found.verdict == "undecided" and claim.kind in ("improvement", "trend", "cost") and found.interval.low > 0:
        out += ["better, but by how much is undecided"]
    for name in dict.fromkeys((case.of, *case.than)):
        cells = [(scenario, name) for scenario in case.scenarios]
        flags = [_flag(results.anees(cell), results.coverage(cell)) for cell in cells]
        counts = {word: flags.count(word) for word in ("over-confident", "conservative")}
        out += [f"{name} {word}" + (len(cells) > 1) * f" in {k} of {len(cells)}" for word, k in counts.items() if k]
        failed = sum(results.failed(cell) for cell in cells)
        out += [f"{failed} trials of {name} failed"] if failed else []
        out += [f"{name} is a bound"] if results.bound(name) else []
    return out

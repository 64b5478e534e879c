"""Writes reports/until_decided.md from runs with `--until-decided`: what was settled, with how many trials.

Run: python reports/until_decided.py RUN_DIR... OUT.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from cooploc.analysis.claims import verdicts
from cooploc.analysis.claims.ledger import load
from cooploc.analysis.claims.verdicts import DECIDED, judge
from cooploc.analysis.execution.stored_run import Kept
from cooploc.analysis.formats import percent
from cooploc.runs import kept

USUAL = 100  # trials of a study as shipped
TEXT = """# What a run until decided settles

    cooploc run reports/without-scalability.toml --until-decided --max-trials 320 --out RUNS/without-scalability
    python reports/until_decided.py RUNS/without-scalability reports

The study of the seed paper without its sweep of the team's size, which takes nine tenths of the time.
*Trials*: of all scenarios and estimators, and as a share of a run that gives each as many as the last look has.
*Comparisons*: with the baseline of a scenario. *Claims*: rows of the ledger, without those about computing time.
*Undecided after {usual}*: rows that the 95 % intervals over {usual} trials leave undecided; then how many of these the
run settled, and how many that it left open the intervals over all of its trials, looked at once, would.

{table}

{sentences}
"""
HEADS = ("study", "trials", "share", "last look", "comparisons decided", "claims decided", f"undecided after {USUAL}",
         "of these settled", "more by one look")  # fmt: skip


def counted(stored: Kept) -> dict[str, int | str]:
    """The numbers of a run."""
    ledger, rows = load(), stored.rows
    decisions = stored.decisions or {}
    asked = [n for cell in stored.manifest["cells"].values() for n in cell["estimators"].values()]
    found = verdicts.judge_at_looks(ledger, rows, stored.looks)
    lasting = verdicts.lasting(ledger, found)
    usual, all_ = (judge(ledger, rows[rows["trial"] < n])["verdict"].reindex(lasting.index) for n in (USUAL, 10**9))
    settled = lasting["verdict"].isin(DECIDED)
    # a row whose trials ended before had been settled by then
    late = (usual == "undecided") & ~(settled & (lasting["look"] < USUAL))
    return {
        "study": stored.manifest["study"]["name"],
        "trials": sum(asked),
        "share": percent(sum(asked) / len(asked) / decisions["look"]),
        "last look": decisions["look"],
        "comparisons decided": _of([one["verdict"] != "open" for one in decisions["comparison"]]),
        "claims decided": _of(settled),
        f"undecided after {USUAL}": int(late.sum()),
        "of these settled": int((late & settled).sum()),
        "more by one look": int((late & ~settled & all_.isin(DECIDED)).sum()),
    }


def main(*given: str) -> None:
    """Write the page."""
    *runs, out = given
    found = [counted(kept(run)) for run in runs]
    lines = [f"| {' | '.join(HEADS)} |", "|---" * len(HEADS) + "|"]
    lines += [f"| {' | '.join(str(row[head]) for head in HEADS)} |" for row in found]
    sentences = "\n".join(
        f"- `{row['study']}`: of {row[HEADS[-3]]} rows that {USUAL} trials leave open, {row[HEADS[-2]]} are settled\n  "
        f"with {row['share']} of the trials; one look at all of them would settle {row[HEADS[-1]]} of the others."
        for row in found
    )
    text = TEXT.format(usual=USUAL, table="\n".join(lines), sentences=sentences)
    (Path(out) / "until_decided.md").write_text(text, encoding="utf-8")


def _of(found: Sequence[bool]) -> str:
    return f"{sum(map(bool, found))} of {len(found)}"


if __name__ == "__main__":
    main(*sys.argv[1:])

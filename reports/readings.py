"""Values of reports/text/readings.md.j2 from a run of the study `readings`: tables and a map."""

from pathlib import Path
from typing import Any

import pandas as pd

import cooploc as cl
from cooploc.analysis.claims import multiverse
from cooploc.analysis.claims.interpretations import design
from cooploc.analysis.claims.kinds import size_as_change
from cooploc.analysis.claims.ledger import load
from cooploc.analysis.claims.verdicts import DECIDED
from cooploc.analysis.metrics import statistics
from cooploc.analysis.plot import style
from cooploc.analysis.report.claim_tables import over_readings

FOLDER = Path(__file__).resolve().parent / "readings"
ELSEWHERE = "cost", "time", "traffic"  # kinds of claims that a short run, or any reading, says nothing of
MAP = (
    "claim", "says", "supported", "specifications", "implausible", "direction only", "contradicted", "undecided",
    *multiverse.AFTER_HOLM.values(), "letter", "code", "preset",
)  # fmt: skip
NUMBERS = (
    "claim", "scenario", "of", "than", "definition", "value", "low", "high", "trials",
    "verdict", "letter", "preset", "code", "error", "baseline", "dead_reckoning", "stands", "implausible",
)  # fmt: skip


def values(runs: Path, out: Path, data: Path) -> dict[str, Any]:
    """Return the words of the text, and write its tables and figures."""
    run, ledger = cl.load_run(runs / "readings"), load()
    found = cl.readings(run)
    found = found[~found["kind"].isin(ELSEWHERE)]
    found[[*NUMBERS, *ledger.dimensions]].to_csv(out / "readings.csv", index=False, float_format="%.4g")
    counted = multiverse.shares(found)
    counted[list(MAP)].to_csv(out / "map.csv", index=False)
    style.save(cl.plot.readings(found), out / "map.svg")
    p, decided = found["p"].to_numpy(float), found["verdict"].isin(DECIDED)
    return {
        "paper": ledger.paper,
        "readings": len(design(ledger.dimensions)),
        "trials": int(run.rows.groupby("scenario")["trial"].nunique().min()),
        "dimensions": ledger.dimensions,
        "specifications": len(found),
        "decided": decided.sum(),
        "stand": (decided & (statistics.holm(p) < 1 - statistics.LEVEL)).sum(),
        "by_chance": f"{statistics.expected_false(p):.0f}",
        "table": over_readings(counted).markdown().rstrip(),
        "counted": counted.to_dict("records"),
    }


def draw_map(path: Path) -> None:
    """Draw the map of the numbers that stand in readings.csv, with what the ledger says of their claims."""
    claims = {claim.id: claim for claim in load().claims}
    table = pd.read_csv(FOLDER / "readings.csv", dtype={"claim": str})
    words = ["than", "definition", *load().dimensions]
    table[words] = table[words].astype("object").fillna("")
    cases = zip(table["claim"], table["definition"], strict=True)
    sizes = [size_as_change(claims[one].size, definition) for one, definition in cases]
    says, kind = ([getattr(claims[one], name) for one in table["claim"]] for name in ("says", "kind"))
    style.save(cl.plot.readings(table.assign(says=says, kind=kind, size=sizes), columns=3), path)

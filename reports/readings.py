"""Values of reports/text/readings.md.j2 from a run of the study `readings`: tables, a map, and curves."""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.backends.backend_pdf import PdfPages
from specification_curves import specification_curve

import cooploc as cl
from cooploc.analysis.claims import multiverse
from cooploc.analysis.claims.interpretations import Dimensions, design
from cooploc.analysis.claims.kinds import size_as_change
from cooploc.analysis.claims.ledger import load
from cooploc.analysis.claims.verdicts import DECIDED
from cooploc.analysis.metrics import statistics
from cooploc.analysis.plot import style
from cooploc.analysis.report.claim_tables import over_readings

FOLDER = Path(__file__).resolve().parent / "readings"
TIMED = "cost", "time"  # kinds of claims that need the times of a quiet machine, in many parts
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
    found = found[~found["kind"].isin(TIMED)]
    found[[*NUMBERS, *ledger.dimensions]].to_csv(out / "readings.csv", index=False, float_format="%.4g")
    counted = multiverse.shares(found)
    counted[list(MAP)].to_csv(out / "map.csv", index=False)
    style.save(cl.plot.readings(found), out / "map.svg")
    draw_curves(found, out / "curves.pdf")
    return {
        "paper": ledger.paper,
        "readings": len(design(ledger.dimensions)),
        "trials": int(run.rows.groupby("scenario")["trial"].nunique().min()),
        "choices": _choices(ledger.dimensions),
        "family": _family(found),
        "table": over_readings(counted).markdown().rstrip(),
        "sentences": "\n".join(
            f"- **{row['claim']}.** {row['says']}: {row['sentence']}." for row in counted.to_dict("records")
        ),
    }


def draw_map(path: Path) -> None:
    """Draw the map of the numbers that stand in readings.csv."""
    style.save(cl.plot.readings(stored_readings()), path)


def stored_readings() -> pd.DataFrame:
    """Return the table of readings.csv, with what the ledger says of its claims."""
    claims = {claim.id: claim for claim in load().claims}
    table = pd.read_csv(FOLDER / "readings.csv", dtype={"claim": str})
    words = ["than", "definition", *load().dimensions]
    table[words] = table[words].astype("object").fillna("")
    cases = zip(table["claim"], table["definition"], strict=True)
    sizes = [size_as_change(claims[one].size, definition) for one, definition in cases]
    says, kind = ([getattr(claims[one], name) for one in table["claim"]] for name in ("says", "kind"))
    return table.assign(says=says, kind=kind, size=sizes)


def draw_curves(found: pd.DataFrame, path: Path) -> None:
    """Draw a curve for each claim, one a page."""
    with PdfPages(path, metadata={"CreationDate": None}) as pdf:
        for claim in dict.fromkeys(found["claim"]):
            figure: Any = specification_curve(found, claim)
            pdf.savefig(figure)
            plt.close(figure)


def _family(found: pd.DataFrame) -> str:
    """Say how many specifications are decided, stand as a family, and are expected to be false."""
    p, decided = found["p"].to_numpy(float), found["verdict"].isin(DECIDED)
    stand = int((decided & (statistics.holm(p) < 1 - statistics.LEVEL)).sum())
    return (
        f"Of {len(found)} specifications {decided.sum()} are decided, each taken alone; {stand} of these stand after "
        f"Holm's correction over all, and about {statistics.expected_false(p):.0f} are expected to be false."
    )


def _choices(dimensions: Dimensions) -> str:
    """Return a table of the dimensions, the paper's sentence and the choices; the letter's in bold."""
    rows = [
        "| dimension | the paper | choices (**nearest to the letter**, first: our preset, *only in public code*) |",
        "| --- | --- | --- |",
    ]
    for name, one in dimensions.items():
        marks = {choice: "**" if choice == one.letter else "*" * how.of_code for choice, how in one.choices.items()}
        named = [f"{mark}{choice}{mark}" for choice, mark in marks.items()]
        rows.append(f"| {name} | {one.says.replace('|', chr(92) + '|')} | {', '.join(named)} |")
    return "\n".join(rows)

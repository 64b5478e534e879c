"""Writes reports/readings from a run of the study `readings`: the map, a curve for each claim, tables, a README.

Run: python reports/readings.py RUN_DIR [OUT].
"""

import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes

import cooploc as cl
from cooploc.analysis.claims import multiverse
from cooploc.analysis.claims.interpretations import Dimensions, design
from cooploc.analysis.claims.ledger import Ledger, load
from cooploc.analysis.claims.verdicts import DECIDED
from cooploc.analysis.metrics import statistics
from cooploc.analysis.report.claim_tables import over_readings

mpl.use("agg")
TIMED = "cost", "time"  # kinds of claims that need the times of a quiet machine, in many parts
LEFT = "direction only", "contradicted", "undecided"
MAP = ["claim", "says", "supported", "specifications", *LEFT, "letter", "preset"]
NUMBERS = [
    "claim",
    "scenario",
    "of",
    "than",
    "definition",
    "value",
    "low",
    "high",
    "trials",
    "verdict",
    "letter",
    "preset",
]


def main(run: str, out: str = "reports/readings") -> None:
    """Write everything."""
    kept, ledger, folder = cl.load_run(run), load(), Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    found = cl.readings(kept)
    found = found[~found["kind"].isin(TIMED)]
    shown = [*NUMBERS, *ledger.dimensions]
    found[shown].to_csv(folder / "readings.csv", index=False, float_format="%.4g")
    keep(cl.plot.readings(found), folder / "map.svg", folder / "map.pdf")
    curves = [(claim, *curve(found, claim, folder)) for claim in dict.fromkeys(found["claim"])]
    trials = kept.rows.groupby("scenario")["trial"].nunique()
    counted = multiverse.shares(found)
    counted[MAP].to_csv(folder / "map.csv", index=False)
    (folder / "map.md").write_text(short(counted), encoding="utf-8")
    (folder / "README.md").write_text(page(found, ledger, curves, int(trials.min())), encoding="utf-8")


def curve(found: pd.DataFrame, claim: str, folder: Path) -> tuple[str, str]:
    """The file of a claim's curve, and the claim in words."""
    name = f"claim-{claim}.png"
    keep(cl.plot.specification_curve(found, claim), folder / name)
    return name, str(found.loc[found["claim"] == claim, "says"].iloc[0])


def keep(ax: Axes, *paths: Path) -> None:
    """In files without a date, so that the same run gives the same file."""
    figure: Any = ax.figure
    dates = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with mpl.rc_context({"svg.hashsalt": "cooploc"}):
        for path in paths:
            figure.savefig(path, dpi=110, metadata=dates.get(path.suffix))
    plt.close(figure)


def page(found: pd.DataFrame, ledger: Ledger, curves: list[tuple[str, str, str]], trials: int) -> str:
    """The README of the folder."""
    counted = multiverse.shares(found)
    lines = [
        "# The paper's claims over its readings",
        "",
        f"{ledger.paper}.",
        "",
        "The paper leaves much open. Below, each sentence that can be read in several ways, and the choices that were "
        f"run: {len(design(ledger.dimensions))} readings in all, each applied to every method alike, on the same "
        f"{trials} streams per scenario. Main effects and chosen pairs were run, not all combinations. "
        "A specification is one case of a claim (scenario, estimators, definition of the size) in one reading; "
        "readings that come down to the same are one specification. Claims about time (17, 23) are not on the map: a "
        "run of so few trials has too few parts for an interval of their times.",
        "",
        *choices(ledger.dimensions),
        "",
        "![Each claim that names a size: what was found in every specification](map.svg)",
        "",
        "*Each mark is one specification; the triangle above is the reading nearest to the paper's letter, the one "
        "below is our preset. At the right: how many specifications support the claim.*",
        "",
        "## In numbers",
        "",
        family(found),
        "",
        over_readings(counted).markdown().rstrip(),
        "",
        *(f"- **{row['claim']}.** {row['says']}: {row['sentence']}." for row in counted.to_dict("records")),
        "",
        "## Every claim as a curve",
        "",
        "Sorted effects with 95 % intervals; the choices of each below. All numbers: [readings.csv](readings.csv).",
        "",
        *(f"![Claim {claim}: {says}]({name})\n" for claim, name, says in curves),
    ]
    return "\n".join(lines).rstrip() + "\n"


def family(found: pd.DataFrame) -> str:
    """How many specifications are decided, how many of these stand as a family, how many are expected to be false."""
    p, decided = found["p"].to_numpy(float), found["verdict"].isin(DECIDED)
    stand = int((decided & (statistics.holm(p) < 1 - statistics.LEVEL)).sum())
    return (
        f"Of {len(found)} specifications {decided.sum()} are decided, each taken alone; {stand} of these stand after "
        f"Holm's correction over all, and about {statistics.expected_false(p):.0f} are expected to be false."
    )


def short(counted: pd.DataFrame) -> str:
    """The map as a table."""
    rows = ["|  | the paper says | holds in | direction only | contradicted in | open | letter | preset |"]
    rows.append("| --- | --- | ---: | ---: | ---: | ---: | --- | --- |")
    for row in counted.to_dict("records"):
        numbers = (f"{row['supported']} of {row['specifications']}", *(str(row[name]) for name in LEFT))
        rows.append(f"| {row['claim']} | {row['says']} | {' | '.join(numbers)} | {row['letter']} | {row['preset']} |")
    return "\n".join(rows) + "\n"


def choices(dimensions: Dimensions) -> list[str]:
    """A table of the dimensions, the paper's sentence and the choices; the letter's in bold."""
    rows = ["| dimension | the paper | choices (**nearest to the letter**, first: our preset) |", "| --- | --- | --- |"]
    for name, one in dimensions.items():
        named = [f"**{choice}**" if choice == one.letter else choice for choice in one.choices]
        says = one.says.replace("|", "\\|")
        rows.append(f"| {name} | {says} | {', '.join(named)} |")
    return rows


if __name__ == "__main__":
    main(*sys.argv[1:])

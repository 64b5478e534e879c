"""The table of estimators in the documentation, made from the code: `cooploc list estimators --markdown`."""

from typing import Any

from cooploc.estimators import BUILTIN, make
from cooploc.estimators.listing import listing
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.tick import IncompatibleEstimator
from cooploc.scenarios.runner.trace import trace

SCENARIOS = ("robots-1-3/n=3[ticks=5]", "camera/n=3[ticks=20]")


def markdown() -> str:
    """Return a row for each built-in estimator: what it is, senses and sends, its bytes, consistency and source."""
    head = ["name", "what it is", "senses", "sends", "bytes per message", "known consistency", "source"]
    known = listing().set_index("name").loc[list(BUILTIN)].reset_index()
    rows = [_row(row) for row in known.to_dict("records")]
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _row(row: dict[Any, Any]) -> list[str]:
    about = row["about"].partition(". ")[0].rstrip(".")
    senses = row["uses"].replace("|", " or ").replace("_", " ")
    bound = " **The bound** of all others." if row["bound"] else ""
    made = make(row["name"])
    sends = getattr(made, "sends", "as its source says")
    consistency = getattr(made, "consistency", "not known")  # in theory; what runs say stands in every table of results
    return [f"`{row['name']}`", f"{about}.{bound}", senses, sends, _bytes(row["name"]), consistency, row["source"]]


def _bytes(name: str) -> str:
    """Measured on three robots: the mean bytes of a message where radio, and where cameras, see teammates."""
    found = []
    for label in SCENARIOS:
        _, stream = simulate(label, trials=2, seed=1)
        try:
            sent = trace(name, make(name), stream)
        except IncompatibleEstimator:
            continue
        if sent.messages.sum():
            found.append(f"{sent.bytes.sum() / sent.messages.sum():.0f}")
    return ", ".join(found)

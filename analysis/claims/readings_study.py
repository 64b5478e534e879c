"""The study that runs every reading of a ledger, as a TOML file: `python -m cooploc.analysis.claims.readings_study`."""

from collections.abc import Iterable

from cooploc.analysis.claims import readings
from cooploc.analysis.claims.ledger import Ledger, load

SCENARIOS = (
    "robots-1-3/n=2",
    "robots-1-3/n=3",
    "scalability/n=1",
    "scalability/n=11",
    "nlos",
    "nlos/bias=0.5",
    "packet-drop/drop=0",
    "packet-drop/drop=0.7",
    "arena-60m/sd=0.5",
    "arena-60m/sd=1.8",
    "arena-60m/sd=5",
)
ESTIMATORS = ("arl", "mrsl-rssi", "mrsl-distance", "ctrn[weights=exact]")
HEAD = """# Written by `python -m cooploc.analysis.claims.readings_study`; a test compares it with the ledger.
about = "Every reading of the paper that is run: {count}, each applied to every method alike"
minutes = {minutes}
trials = 50
"""
MINUTES = 35


def study(ledger: Ledger) -> str:
    """The text of the study: for each reading its scenarios and estimators; what two readings share stands once."""
    design = readings.design(ledger.dimensions)
    wanted: dict[str, dict[str, None]] = {}
    for reading in design:
        labels = [readings.estimator(label, reading, ledger.dimensions) for label in ESTIMATORS]
        for scenario in SCENARIOS:
            where = readings.scenario(scenario, reading, ledger.dimensions)
            wanted.setdefault(where, {}).update(dict.fromkeys(labels))
    alike: dict[tuple[str, ...], list[str]] = {}
    for where, names in wanted.items():
        alike.setdefault(tuple(names), []).append(where)
    blocks = [f"scenarios = {_written(where)}\nestimators = {_written(names)}\n" for names, where in alike.items()]
    return HEAD.format(count=len(design), minutes=MINUTES) + "\n[[also]]\n".join(blocks)


def _written(labels: Iterable[str]) -> str:
    return "[\n" + "".join(f'    "{label}",\n' for label in labels) + "]"


if __name__ == "__main__":
    print(study(load()), end="")

"""What a run until decided has decided so far, in a line."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cooploc.analysis.execution.stored_run import read
from cooploc.analysis.execution.until_decided import seconds_left
from cooploc.analysis.formats import counted, duration


def state(folder: Path, decisions: Mapping[str, Any]) -> str:
    """How many comparisons and claims are decided, how many are open, and how long they may take."""
    said, still = [], 0
    for of in ("comparison", "claim"):
        ones = decisions[of]
        undecided = sum(one["verdict"] in ("open", "undecided") for one in ones)
        said += [f"{len(ones) - undecided} of {counted(len(ones), of)}"] if ones else []
        still += undecided
    line = f"decided after {decisions['look']} trials: {', '.join(said)}; {still} open"
    going = [(scenario, estimator) for scenario, estimator in decisions["going"]]
    if not going:
        return f"{line}; the run has ended"
    left = seconds_left(read(folder).rows, going, decisions["most"])
    return f"{line}; to {decisions['most']} trials, at most about {duration(left)} of one process"

"""The memory that a study takes, refused where no machine like this one has it, and said where it is much."""

from cooploc.analysis.execution.plan import chunk_size
from cooploc.scenarios.memory import demand, gigabytes, needed
from cooploc.scenarios.studies.study import ResolvedStudy

WORTH_SAYING = 1e9  # bytes


def demand_memory(asked: ResolvedStudy, jobs: int) -> str:
    """How much memory the largest chunk of a study takes, in words; empty where that is not much.

    Raises:
        BadInput: one trial alone takes more than this machine has.

    """
    most = 0
    for cell in asked.cells:
        one = cell.scenario
        demand(one.label, one.robots, one.ticks, 1)
        most = max(most, needed(one.robots, one.ticks, min(cell.most, chunk_size(one))))
    processes = f" in each of {jobs} processes" if jobs > 1 else ""
    line = f"the readings take up to about {gigabytes(most)} of memory{processes}, and estimators more"
    return line if most * jobs > WORTH_SAYING else ""

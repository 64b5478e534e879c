"""What a run directory has of a study, and the tasks for the rest, each of one chunk of a scenario's trials.

A chunk's size depends on the scenario alone, and results do not depend on chunks at all.
"""

from collections.abc import Iterator
from typing import NamedTuple

from cooploc.analysis.execution.retries import Retry, worth_it
from cooploc.analysis.execution.run_directory import Piece, RunDir
from cooploc.analysis.execution.task import Task
from cooploc.scenarios.remote import RemoteScenario
from cooploc.scenarios.scenario import ResolvedScenario
from cooploc.scenarios.studies.study import ResolvedStudy

CHUNK_BYTES = 64e6  # of readings between robots, the largest arrays of a stream
CHUNK_ROWS = 200  # (trial, robot): enough that numpy's cost per call no longer counts, few enough to lose in a crash
CHUNK_TRIALS = 10, 50  # at least, unless the bytes forbid it, and at most


class Plan(NamedTuple):
    """How a study can be completed."""

    trials: int  # of all estimators, wanted
    intact: list[Piece]  # there and whole
    damaged: list[Piece]  # there, and not what was written
    failed: list[Piece]  # there and whole, with failures that may not happen again
    tasks: list[Task]


def make_plan(study: ResolvedStudy, directory: RunDir, retry: Retry | None = "lost") -> Plan:
    """Look at every part that a study needs; what is missing, damaged or to be tried again becomes a task."""
    intact: list[Piece] = []
    damaged: list[Piece] = []
    failed: list[Piece] = []
    tasks: list[Task] = []
    limit = study.study.time_limit
    for cell in study.cells:
        gaps: dict[range, list[str]] = {}
        for estimator in cell.estimators:
            wanted = cell.trials[estimator.label]
            found = directory.pieces(cell.scenario.label, estimator.label, wanted)
            again = [p for p in found.intact if retry and any(worth_it(f, limit, retry) for f in directory.failures(p))]
            intact += [piece for piece in found.intact if piece not in again]
            damaged += found.damaged
            failed += again
            missing = _gaps([piece.trials for piece in found.intact], wanted, chunk_size(cell.scenario))
            for gap in (*missing, *(piece.trials for piece in again)):  # in parts as they were, which they replace
                gaps.setdefault(gap, []).append(estimator.label)
        for gap in sorted(gaps, key=lambda trials: trials.start):
            lacking = tuple(one for one in cell.estimators if one.label in gaps[gap])
            tasks.append(Task(cell.scenario, gap, study.study.seed, lacking, limit))
    return Plan(sum(sum(cell.trials.values()) for cell in study.cells), intact, damaged, failed, tasks)


def _gaps(held: list[range], count: int, size: int) -> Iterator[range]:
    """The trials below `count` that no part holds, in pieces of one chunk."""
    missing = sorted(set(range(count)) - {trial for trials in held for trial in trials})
    start = 0
    for i, trial in enumerate(missing):
        last = i + 1 == len(missing) or missing[i + 1] != trial + 1 or (trial + 1) % size == 0
        if last:
            yield range(missing[start], trial + 1)
            start = i + 1


def chunk_size(scenario: ResolvedScenario | RemoteScenario) -> int:
    """How many trials of a scenario are computed together."""
    if scenario.recorded:
        return 1
    least, most = CHUNK_TRIALS
    fits = int(CHUNK_BYTES // (17 * scenario.ticks * scenario.robots**2))
    return max(1, min(fits, most, max(least, CHUNK_ROWS // scenario.robots)))

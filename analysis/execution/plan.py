"""What of a study is there already, and what is to be done: tasks of one chunk of a scenario's trials each.

A chunk's size depends on the scenario alone, and results do not depend on chunks at all.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from cooploc.analysis.execution.run_directory import Piece, RunDir
from cooploc.analysis.execution.task import Task
from cooploc.scenarios import family, scenario
from cooploc.scenarios.studies.study import Cell, Study

CHUNK_BYTES = 64e6  # of readings between robots, the largest arrays of a stream
CHUNK_ROWS = 200  # (trial, robot): enough that numpy's cost per call no longer counts, few enough to lose in a crash
CHUNK_TRIALS = 10, 50  # at least, unless the bytes forbid it, and at most


class Plan(NamedTuple):
    """How a study can be completed."""

    trials: int  # of all estimators, wanted
    kept: list[Piece]  # there and whole
    damaged: list[Piece]  # there, and not what was written
    tasks: list[Task]


def make_plan(study: Study, data: str | None, directory: RunDir) -> Plan:
    """Look at every part that a study needs; what is not there or not whole becomes a task."""
    kept: list[Piece] = []
    damaged: list[Piece] = []
    tasks: list[Task] = []
    wanted = 0
    for cell in study.cells():
        count = trials_of(study, cell.scenario, data)
        wanted += count * len(cell.estimators)
        gaps: dict[range, list[str]] = {}
        for estimator in cell.estimators:
            mine, spoilt = _found(directory, cell.scenario, estimator, count)
            kept += mine
            damaged += spoilt
            for gap in _gaps([piece.trials for piece in mine], count, _chunk_size(cell.scenario)):
                gaps.setdefault(gap, []).append(estimator)
        where = data if family(cell.scenario).recorded else None
        order = sorted(gaps, key=lambda gap: gap.start)
        tasks += [Task(cell.scenario, gap, study.seed, where, tuple(gaps[gap]), study.time_limit) for gap in order]
    return Plan(wanted, kept, damaged, tasks)


def trials_of(study: Study, label: str, data: Path | str | None) -> int:
    """How many trials a scenario of the study has: a recording has one, unless it counts its runs."""
    if not family(label).recorded:
        return study.trials
    made: Any = scenario(label, data=data) if data is not None else None
    return made.count() if hasattr(made, "count") else 1


def work(cell: Cell) -> float:
    """About how long a trial of a scenario takes, relative to others: robots x (what is fixed + neighbours).

    A robot alone costs as much as hearing some forty neighbours (reports/speed.md).
    """
    robots = 1 if family(cell.scenario).recorded else getattr(scenario(cell.scenario), "robots", 1)
    return float(robots * (40 + robots))


def _found(directory: RunDir, scenario: str, estimator: str, count: int) -> tuple[list[Piece], list[Piece]]:
    """Parts that together hold each trial at most once, and those that are spoilt."""
    good: list[Piece] = []
    spoilt: list[Piece] = []
    reached = 0
    for trials in directory.held(scenario, estimator):
        piece = Piece(scenario, estimator, trials)
        if not reached <= trials.start < count:
            continue
        if directory.intact(piece):
            good.append(piece)
            reached = trials.stop
        else:
            spoilt.append(piece)
    return good, spoilt


def _gaps(held: list[range], count: int, size: int) -> Iterator[range]:
    """The trials below `count` that nothing holds, in pieces of one chunk."""
    missing = sorted(set(range(count)) - {trial for trials in held for trial in trials})
    start = 0
    for i, trial in enumerate(missing):
        last = i + 1 == len(missing) or missing[i + 1] != trial + 1 or (trial + 1) % size == 0
        if last:
            yield range(missing[start], trial + 1)
            start = i + 1


def _chunk_size(label: str) -> int:
    if family(label).recorded:
        return 1
    world: Any = scenario(label)
    robots = getattr(world, "robots", 1)
    least, most = CHUNK_TRIALS
    fits = int(CHUNK_BYTES // (17 * getattr(world, "ticks", 1) * robots**2))
    return max(1, min(fits, most, max(least, CHUNK_ROWS // robots)))

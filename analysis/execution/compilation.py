"""Kernels compiled before a run's trials begin, in processes side by side; a run alone would wait for each in turn.

A mark on disk, beside the kernels, says what this version has compiled already: it is asked for once.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterable
from concurrent.futures import BrokenExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from cooploc.analysis.execution.provenance import bits
from cooploc.analysis.execution.task import Task
from cooploc.estimators import make
from cooploc.estimators.building import ConfiguredEstimator
from cooploc.estimators.compiled import kept_at
from cooploc.estimators.kalman_kernels import whiten
from cooploc.scenarios import BUILTIN as SCENARIOS
from cooploc.scenarios.processes.workers import BUILTIN, end, pool
from cooploc.scenarios.runner.trace import warm_up
from cooploc.scenarios.stream import Stream

OWNER = "compile"
FEWEST = 3  # estimators: fewer are compiled here as fast


def compile_kernels(tasks: Iterable[Task], jobs: int, begin: Callable[[], None]) -> None:
    """Compile what built-in estimators need in these tasks and was not yet compiled; `begin` is called if any does."""
    cold = {mark: found for mark, found in _by_mark(tasks).items() if not mark.exists()}
    if not cold:
        return
    begin()
    processes = min(max(jobs, 2), os.cpu_count() or 1)
    if len(cold) < FEWEST or processes == 1:
        compiled(list(cold.values()))
    else:
        _side_by_side(list(cold.values()), processes, BUILTIN if processes == jobs else OWNER)
    for mark in cold:
        with suppress(OSError):
            mark.parent.mkdir(parents=True, exist_ok=True)
            mark.touch()


def _side_by_side(cold: list[list[Task]], processes: int, owner: str) -> None:
    """Neighbours in a study share kernels, so that each process takes a piece of its list."""
    pieces = [[cold[i] for i in piece] for piece in np.array_split(np.arange(len(cold)), processes) if len(piece)]
    try:
        with suppress(BrokenExecutor):  # what broke it is met again, and said, in the run
            for future in [pool(owner, processes).submit(compiled, piece) for piece in pieces]:
                future.result()
    except BaseException:  # Ctrl-C
        end(owner)
        raise
    if owner == OWNER:
        end(owner)


def compiled(cold: list[list[Task]]) -> None:
    """Run two ticks of every task's estimators; each scenario is simulated once."""
    streams = dict[str, Stream]()
    for task in [task for tasks in cold for task in tasks]:
        if task.scenario.label not in streams:
            streams[task.scenario.label] = task.scenario.simulate(task.trials, task.seed)[1]
        for estimator in task.estimators:
            warm_up(estimator.label, make(estimator), streams[task.scenario.label])


def _by_mark(tasks: Iterable[Task]) -> dict[Path, list[Task]]:
    """By the mark of each kind of estimator, its first task of the smallest team and of the largest."""
    found: dict[Path, list[Task]] = {}
    for task in sorted(tasks, key=lambda one: one.scenario.robots):
        for estimator in task.estimators:
            if estimator.builtin and task.scenario.name in SCENARIOS and not task.scenario.recorded:
                one = replace(task, trials=task.trials[:1], estimators=(estimator,))
                found[_mark(estimator)] = [*found.get(_mark(estimator), [])[:1], one]
    return found


def _mark(one: ConfiguredEstimator) -> Path:
    """The same for all values of a number, which change no kernel."""
    words = {name: value for name, value in one.parameters.items() if not _is_number(value)}
    kind = json.dumps([one.name, words, bits()], sort_keys=True)
    return kept_at(whiten) / f"{hashlib.sha256(kind.encode()).hexdigest()[:24]}.compiled"


def _is_number(value: str) -> bool:
    try:
        float(value)
    except ValueError:
        return False
    return True

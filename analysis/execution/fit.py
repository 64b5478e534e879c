"""Refuses, before anything is computed, what cannot run: names, parameters, channels, recordings."""

from collections.abc import Callable
from contextlib import chdir
from dataclasses import replace
from pathlib import Path
from typing import Any

from cooploc.analysis.execution.played import begin
from cooploc.analysis.execution.task import Task
from cooploc.analysis.execution.walled import given
from cooploc.estimators import make, module_of
from cooploc.estimators.errors import BadInput
from cooploc.scenarios import BUILTIN, resolve
from cooploc.scenarios.processes.time_limit import Limit, within
from cooploc.scenarios.processes.workers import call, end
from cooploc.scenarios.runner.tick import IncompatibleEstimator
from cooploc.scenarios.runner.trace import require_fit as demand_begin
from cooploc.scenarios.scenario import ResolvedScenario
from cooploc.scenarios.stream import Stream
from cooploc.scenarios.studies.study import ResolvedStudy


def require_fit(asked: ResolvedStudy, isolate: bool) -> None:
    """Try the first tick of every scenario and estimator; with `isolate`, what is not built in where it will run.

    There a crash refuses nothing: it is a failure of the trials that crash.

    Raises:
        BadInput: something cannot run as it is.

    """
    for estimator in asked.estimators:
        module_of(estimator.name)  # an unknown name is refused here
    made: dict[str, Any] = {}
    foreign: dict[str, list[Task]] = {}
    for cell in asked.cells:
        whole = Task(cell.scenario, range(1), asked.study.seed, cell.estimators, asked.study.time_limit)
        for task in whole.by_owner():
            if task.owner and isolate:
                foreign.setdefault(task.owner, []).append(task)
            else:
                _first_tick(task, made)
    for owner, tasks in foreign.items():
        _there(owner, tasks)
        if len(foreign) > 1:  # else it goes on with the run
            end(owner)


def without_misfits(asked: ResolvedStudy, say: Callable[[str], None]) -> ResolvedStudy:
    """The study without the estimators that lack a channel of a scenario, each of which is told.

    Only where the study says so, and not of estimators that were named for this run.

    Raises:
        BadInput: a scenario cannot be simulated, or its baseline is one of those.

    """
    if not asked.study.leaves_out_misfits or asked.study.only:
        return asked
    cells = []
    for cell in asked.cells:
        whole = Task(cell.scenario, range(1), asked.study.seed, cell.estimators, asked.study.time_limit)
        stream = _first(whole)
        kept = []
        for one in cell.estimators:
            try:
                if one.builtin:
                    demand_begin(one.label, make(one), stream)
                kept.append(one)
            except IncompatibleEstimator as e:
                if one.label == cell.baseline:
                    raise
                say(f"left out: {e}")
        trials = {one.label: cell.trials[one.label] for one in kept}
        cells.append(cell._replace(estimators=tuple(kept), trials=trials))
    return asked._replace(cells=tuple(cells))


def _there(owner: str, tasks: list[Task]) -> None:
    for task in tasks:
        try:
            _begun_there(owner, task)
        except BadInput:
            raise
        except Exception:
            return


def _begun_there(owner: str, task: Task) -> None:
    """Begin a plug-in on the first tick of a world of ours, simulated here, or of its own world, in its process."""
    if task.scenario.name not in BUILTIN:
        call(owner, _limited, task)
        return
    stream = _first(task)
    for one in task.estimators:
        call(owner, begin, given(one.label, stream, task.time_limit))


def _limited(task: Task) -> None:
    with within(Limit(task.time_limit, end_process=True)), chdir(Path.cwd()):
        _first_tick(task, {})


def _first_tick(task: Task, made: dict[str, Any]) -> None:
    """Begin each estimator of a task; `made` keeps those that are made already."""
    for estimator in task.estimators:
        made[estimator.label] = made.get(estimator.label) or make(estimator)
    stream = _first(task)
    for estimator in task.estimators:
        demand_begin(estimator.label, made[estimator.label], stream)


def _first(task: Task) -> Stream:
    """The first tick of a task's scenario, under the name of the whole."""
    found = task.scenario
    resolved = found if isinstance(found, ResolvedScenario) else resolve(found.label, found.data)
    _, stream = resolved.first_tick().simulate(1, task.seed)
    return replace(stream, scenario=resolved.label)

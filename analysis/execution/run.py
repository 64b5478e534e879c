"""Run a study into a run directory: what is there stays, what is missing or damaged is computed."""

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from cooploc.analysis.execution.certificates import check_plugins, with_certificates
from cooploc.analysis.execution.progress import RunProgress
from cooploc.analysis.execution.provenance import files, fingerprint, imports, provenance
from cooploc.analysis.execution.run_directory import FORMAT, PartKey, RunDir
from cooploc.analysis.execution.workers import MeasuredPart, Task, Workers, compile_kernels, failed_part, make_workers
from cooploc.analysis.formats import counted
from cooploc.estimators import make, module_of
from cooploc.estimators.errors import BadInput
from cooploc.scenarios import BUILTIN as BUILTIN_SCENARIOS
from cooploc.scenarios import memory, resolve
from cooploc.scenarios.process import BUILTIN, PLUGINS, WorkerError, call, end
from cooploc.scenarios.runner.run import PluginJob, require_fit_in_process
from cooploc.scenarios.runner.tick import EstimatorError, IncompatibleEstimator
from cooploc.scenarios.runner.trace import require_fit
from cooploc.scenarios.scenario import ResolvedScenario
from cooploc.scenarios.stream import Stream
from cooploc.scenarios.studies.study import ResolvedCell, ResolvedStudy, Study, resolve_study

CHUNK_BYTES = 64e6  # of readings between robots, the largest arrays of a stream
CHUNK_ROWS = 200  # (trial, robot): enough that numpy's cost per call no longer counts, few enough to lose in a crash
CHUNK_TRIALS = 10, 50  # at least, unless the bytes forbid it, and at most
MANY = 2000  # parts of a run whose rows need the memory that idle processes hold
MEMORY_WORTH_SAYING = 1e9  # bytes
TICK_COST = 3000.0  # of a part however few its trials are, in the unit of `work`: numpy's cost per call
# Failures that may be gone when the same trial runs again: a lost process; I/O, memory, file size, disk, quota.
LOST = re.compile(r"process (that ran it )?died|(^|: )\w*MemoryError: |(^|: )OSError: \[Errno (5|12|27|28|122)\]")
LIMIT = re.compile(r"\btime limit of ([0-9.]+(?:e[+-]?[0-9]+)?) s\b")


def execute(
    study: Study,
    out: Path,
    *,
    counts: Mapping[tuple[str, str], int] | None = None,
    data: Path | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    check: bool = True,
    retry_failed: bool = False,
    isolate: bool = True,
    strict: bool = False,
    progress: RunProgress | None = None,
) -> pd.DataFrame:
    """Run the parts of a study that are not there yet; return the rows of everything that the study asks for.

    Args:
        study: what to run.
        out: the run directory; continued where it holds the same settings.
        counts: trials of each (scenario, estimator), where not all are to have the study's number.
        data: the directory of recordings, for scenarios that need it.
        jobs: number of processes.
        scheduler: the address of a Dask scheduler, whose workers are used instead.
        check: whether estimators that are not built in are checked first, once per version of their source.
        retry_failed: whether every trial that failed runs again; those whose process was lost, that found memory or
            disk full, or that a smaller time limit ended, always do.
        isolate: False keeps everything in this process, for a debugger; else what is not built in has its own.
        strict: whether a recording is refused of which something was left out, sorted or repaired while reading.
        progress: called for every part.

    Returns:
        The columns of `errors`, and `failure`, `traceback` and `certificate`.

    Raises:
        BadInput: the study cannot be run as it is; nothing was computed.
        OSError: a part could not be written; those before it are kept.

    """
    watcher = progress or RunProgress()
    asked = resolve_study(study, data)
    asked = asked if counts is None else asked.with_trials(counts)
    asked = drop_incompatible(asked, watcher.say)
    if strict:
        require_whole([f"{cell.scenario.label}, {line}" for cell in asked.cells for line in cell.scenario.faults()])
    directory = RunDir(out)
    notice = require_memory(asked, jobs)
    with make_workers(jobs, scheduler, isolate, watcher.say) as workers:
        broken = require_compatible(asked, isolate)
        with directory.locked():
            manifest = {**make_manifest(asked), "isolated": isolate}
            directory.open(manifest)
            for line in filter(None, [notice, *_recording_notes(manifest)]):
                watcher.say(line)
            _check_plugins(directory, asked, check, isolate, watcher.say)
            parts = complete(asked, directory, workers, watcher, retry_failed, isolate, broken)
            if len(parts) > MANY:
                end(BUILTIN)
            rows = _read_rows(asked, directory, parts)
            _write_streams(directory, rows)
    return rows


def require_whole(faults: Sequence[str]) -> None:
    """Refuse a recording with faults.

    Raises:
        BadInput: there are some; names the first.

    """
    if faults:
        others = f", and {counted(len(faults) - 1, 'other fault')}" if len(faults) > 1 else ""
        raise BadInput(f"{faults[0]}{others}: mend the recording, or leave out --strict")


def make_manifest(asked: ResolvedStudy) -> dict[str, Any]:
    """Return what a run directory says of a study before anything is computed."""
    scenarios = [cell.scenario for cell in asked.cells]
    return {
        "format": FORMAT,
        "study": asked.study.model_dump(mode="json"),
        "cells": {
            cell.scenario.label: {
                "experiment": cell.experiment,
                "baseline": cell.baseline,
                "estimators": dict(cell.trials),
            }
            for cell in asked.cells
        },
        "seed": asked.study.seed,
        "data": None if asked.data is None else fingerprint(Path(asked.data)),
        "scenarios": {one.label: one.settings for one in scenarios},
        "recordings": {one.label: lines for one in scenarios if (lines := one.explained())},
        "files": files(asked.estimators, scenarios),
        "imports": imports(asked.estimators, scenarios),
        "certificates": {},
        "streams": {},
        **provenance(),
    }


def _recording_notes(manifest: dict[str, Any]) -> list[str]:
    return [f"{label}, {line}" for label, lines in manifest["recordings"].items() for line in lines]


def _check_plugins(
    directory: RunDir, asked: ResolvedStudy, check: bool, isolate: bool, say: Callable[[str], None]
) -> None:
    """Write each certificate as soon as it is made; a run goes on after a check that failed."""
    manifest = directory.manifest
    for label, found in check_plugins(asked.estimators, manifest["certificates"], check, say, isolate):
        manifest["certificates"][label] = found
        directory.write_manifest(manifest)


def _read_rows(asked: ResolvedStudy, directory: RunDir, parts: list[PartKey]) -> pd.DataFrame:
    """Return the rows of parts in the study's order, whatever the order in which they were computed."""
    by_cell: dict[tuple[str, str], list[PartKey]] = {}
    for key in sorted(parts, key=lambda one: one.trials.start):
        by_cell.setdefault((key.scenario, key.estimator), []).append(key)
    ordered = [
        (key, cell.trials[estimator.label])
        for cell in asked.cells
        for estimator in asked.estimators
        for key in by_cell.get((cell.scenario.label, estimator.label), ())
    ]
    return with_certificates(directory.rows(ordered), directory.manifest["certificates"], asked.estimators)


def _write_streams(directory: RunDir, rows: pd.DataFrame) -> None:
    """Note the hashes of the streams in the manifest."""
    manifest = directory.manifest
    streams = manifest["streams"]
    for row in rows.dropna(subset="stream").drop_duplicates(["scenario", "trial"]).itertuples():
        streams.setdefault(row.scenario, {})[str(row.trial)] = row.stream
    directory.write_manifest(manifest)


# What can be run at all.


def drop_incompatible(asked: ResolvedStudy, say: Callable[[str], None]) -> ResolvedStudy:
    """Return the study without the estimators that lack a channel of a scenario; each is said.

    Only where the study says so, and not of estimators that were named for this run.

    Raises:
        BadInput: a scenario cannot be simulated, or its baseline is one of those.

    """
    if not asked.study.leaves_out_misfits or asked.study.only:
        return asked
    cells = []
    for cell in asked.cells:
        stream = _first_tick(cell.scenario, asked.study.seed)
        kept = []
        for one in cell.estimators:
            try:
                if one.builtin:
                    require_fit(one.label, make(one), stream)
                kept.append(one)
            except IncompatibleEstimator as e:
                if one.label == cell.baseline:
                    raise
                say(f"left out: {e}")
        trials = {one.label: cell.trials[one.label] for one in kept}
        cells.append(cell._replace(estimators=tuple(kept), trials=trials))
    return asked._replace(cells=tuple(cells))


def require_compatible(asked: ResolvedStudy, isolate: bool) -> dict[tuple[str, str], str]:
    """Try the first tick of every scenario and estimator; with `isolate`, plug-ins in their process.

    Returns:
        Why the process of a plug-in did not live through it, by the labels of scenario and estimator.

    Raises:
        BadInput: something cannot be run as it is.

    """
    for estimator in asked.estimators:
        module_of(estimator.name)  # an unknown name is refused here
    broken: dict[tuple[str, str], str] = {}
    for cell in asked.cells:
        if cell.scenario.name not in BUILTIN_SCENARIOS and isolate:
            # A plug-in world is simulated in the process of plug-ins; a crash there is a failure of its trials.
            with suppress(WorkerError):
                call(PLUGINS, _try_labels, cell.scenario.label, asked.data, list(cell.trials), asked.study.seed)
            continue
        stream = _first_tick(cell.scenario, asked.study.seed)
        for one in cell.estimators:
            if one.builtin or not isolate:
                require_fit(one.label, make(one), stream)
                continue
            try:
                require_fit_in_process(PluginJob(one.label, one.label, asked.study.time_limit, PLUGINS), stream)
            except EstimatorError as e:
                broken[cell.scenario.label, one.label] = str(e)
    return broken


def _try_labels(scenario: str, data: Path | None, estimators: list[str], seed: int) -> None:
    """Try the first tick of a scenario in this process."""
    stream = _first_tick(resolve(scenario, data), seed)
    for label in estimators:
        require_fit(label, make(label), stream)


def _first_tick(scenario: ResolvedScenario, seed: int) -> Stream:
    """Return the first tick of a scenario, under the name of the whole."""
    _, stream = scenario.first_tick().simulate(1, seed)
    return replace(stream, scenario=scenario.label)


def require_memory(asked: ResolvedStudy, jobs: int) -> str:
    """Return a sentence on the memory that the largest chunk of a study takes; empty where that is not much.

    Raises:
        BadInput: one trial alone takes more than this machine has.

    """
    most = 0
    for cell in asked.cells:
        one = cell.scenario
        memory.demand(one.label, one.robots, one.ticks, 1)
        most = max(most, memory.needed(one.robots, one.ticks, min(cell.most, chunk_size(one))))
    processes = f" in each of {jobs} processes" if jobs > 1 else ""
    line = f"the readings take up to about {memory.gigabytes(most)} of memory{processes}, and estimators more"
    return line if most * jobs > MEMORY_WORTH_SAYING else ""


# What is missing, and its computation.


class Plan(NamedTuple):
    """How a study can be completed."""

    trials: int  # of all estimators, wanted
    intact: list[PartKey]  # there and whole
    damaged: list[PartKey]  # there, and not what was written
    failed: list[PartKey]  # there and whole, with failures that may not happen again
    tasks: list[Task]


def complete(
    asked: ResolvedStudy,
    directory: RunDir,
    workers: Workers,
    watcher: RunProgress,
    retry_failed: bool = False,
    isolate: bool = True,
    broken: Mapping[tuple[str, str], str] | None = None,
) -> list[PartKey]:
    """Compute and write the parts of a study that are missing; return all of its parts.

    Raises:
        BadInput: parts vanish as they are written.

    """
    plan = make_plan(asked, directory, isolate, "all" if retry_failed else "lost")
    for key in plan.damaged:
        watcher.say(f"{key.name} is gone or does not match its checksum; its trials are computed again")
    if plan.failed:
        watcher.say(f"{counted(len(plan.failed), 'part')} with trials that failed: computed again")
    if workers.jobs:
        compile_kernels(plan.tasks, workers.jobs, watcher.compiling)
    todo = sum(len(task.trials) * len(task.estimators) for task in plan.tasks)
    watcher.begin(plan.trials, plan.trials - todo)
    cells, remaining = {cell.scenario.label: cell for cell in asked.cells}, Remaining(plan.tasks)
    for part in _compute(plan.tasks, workers, broken or {}):
        directory.write(part.key, part.frame, part.seconds)
        cell = cells[part.key.scenario]
        _advance(part, cell, remaining.share_after(part, cell.scenario), watcher)
    directory.forget()
    plan = make_plan(asked, directory, isolate)
    if plan.tasks:
        gone = plan.tasks[0]
        where = f"{gone.scenario.label}, {gone.estimators[0].label}, trial {gone.trials.start}"
        raise BadInput(f"parts vanish from {directory.path} as they are written ({where}): see what removes them")
    return plan.intact


def _compute(tasks: list[Task], workers: Workers, broken: Mapping[tuple[str, str], str]) -> Iterator[MeasuredPart]:
    """Yield the parts of tasks; estimators whose process died as they began fail at once."""
    whole = []
    for task in tasks:
        for one in task.estimators:
            if why := broken.get((task.scenario.label, one.label)):
                yield failed_part(replace(task, estimators=(one,)), f"it cannot even begin: {why}")
        alive = tuple(one for one in task.estimators if (task.scenario.label, one.label) not in broken)
        whole += [replace(task, estimators=alive)] if alive else []
    yield from workers.compute(whole)


def _advance(part: MeasuredPart, cell: ResolvedCell, share: float, watcher: RunProgress) -> None:
    scenario, estimator, trials = part.key
    failed = part.frame.loc[part.frame["failure"].notna(), "trial"].nunique()
    where = scenario if scenario.startswith(cell.experiment) else f"{cell.experiment} · {scenario}"
    watcher.advance(f"{where} · {estimator}", len(trials), failed, share)


def make_plan(study: ResolvedStudy, directory: RunDir, isolate: bool = True, retry: str = "") -> Plan:
    """Look at every part that a study needs; what is missing, damaged or to be tried again becomes a task.

    Args:
        study: what is wanted.
        directory: what is there.
        isolate: of the tasks.
        retry: which failures run again: "all", "lost" (those that may be gone), or none.

    """
    intact: list[PartKey] = []
    damaged: list[PartKey] = []
    failed: list[PartKey] = []
    tasks: list[Task] = []
    limit = study.study.time_limit
    for cell in study.cells:
        gaps: dict[range, list[str]] = {}
        for estimator in cell.estimators:
            wanted = cell.trials[estimator.label]
            found = directory.parts(cell.scenario.label, estimator.label, wanted)
            reasons = {key: directory.failures(key) for key in found.intact} if retry else {}
            again = [key for key, why in reasons.items() if any(is_worth_retry(line, limit, retry) for line in why)]
            intact += [key for key in found.intact if key not in again]
            damaged += found.damaged
            failed += again
            missing = _gaps([key.trials for key in found.intact], wanted, chunk_size(cell.scenario))
            for gap in (*missing, *(key.trials for key in again)):  # in parts as they were, which they replace
                gaps.setdefault(gap, []).append(estimator.label)
        for gap in sorted(gaps, key=lambda trials: trials.start):
            lacking = tuple(one for one in cell.estimators if one.label in gaps[gap])
            tasks.append(Task(cell.scenario, gap, study.study.seed, lacking, limit, isolate))
    return Plan(sum(sum(cell.trials.values()) for cell in study.cells), intact, damaged, failed, tasks)


def _gaps(held: list[range], count: int, size: int) -> Iterator[range]:
    """Yield the trials below `count` that no part holds, in pieces of one chunk."""
    missing = sorted(set(range(count)) - {trial for trials in held for trial in trials})
    start = 0
    for i, trial in enumerate(missing):
        last = i + 1 == len(missing) or missing[i + 1] != trial + 1 or (trial + 1) % size == 0
        if last:
            yield range(missing[start], trial + 1)
            start = i + 1


def chunk_size(scenario: ResolvedScenario) -> int:
    """Return how many trials of a scenario are computed together; results do not depend on it."""
    if scenario.recorded:
        return 1
    least, most = CHUNK_TRIALS
    fits = int(CHUNK_BYTES // (17 * scenario.ticks * scenario.robots**2))
    return max(1, min(fits, most, max(least, CHUNK_ROWS // scenario.robots)))


def is_worth_retry(failure: str, time_limit: float, retry: str = "lost") -> bool:
    """Return whether a trial that failed for this reason is to run again under this time limit [s].

    A failure of the estimator itself happens again, as every trial is bit-identical. A lost process, a full memory or
    disk does not have to; nor does a time limit that has grown since.
    """
    if retry == "all" or LOST.search(failure):
        return True
    limit = LIMIT.search(failure)
    return limit is not None and float(f"{time_limit:g}") > float(limit[1])


# How much of the processor time is spent.


def work(scenario: ResolvedScenario, trials: int) -> float:
    """Return about how long one estimator takes for a part, relative to parts of other scenarios and sizes.

    A tick of a robot alone costs as much as hearing some forty neighbours (reports/speed.md).
    """
    return float(scenario.ticks * (TICK_COST + trials * scenario.robots * (40 + scenario.robots)))


class Remaining:
    """The share of a plan's processor time that is spent; each estimator has a rate of its own, once it is known."""

    def __init__(self, tasks: Iterable[Task]) -> None:
        self._todo: dict[str, float] = defaultdict(float)  # work, by the estimator's label
        self._done: dict[str, float] = defaultdict(float)
        self._took: dict[str, float] = defaultdict(float)  # [s] of a processor
        for task in tasks:
            for estimator in task.estimators:
                self._todo[estimator.label] += work(task.scenario, len(task.trials))

    def share_after(self, part: MeasuredPart, scenario: ResolvedScenario) -> float:
        """Take note of a finished part of a scenario; return the share that is done by now, from 0 to 1."""
        _, label, trials = part.key
        this = work(scenario, len(trials))
        self._todo[label] -= this
        seconds = part.seconds * float(part.frame["ticks"].sum())
        if isfinite(seconds):  # not of a part that failed
            self._done[label] += this
            self._took[label] += seconds
        spent, usual = sum(self._took.values()), sum(self._done.values())
        rates = {one: self._took[one] / self._done[one] for one in self._done if self._took[one]}
        left = sum(todo * rates.get(one, spent / usual if usual else 1.0) for one, todo in self._todo.items())
        return spent / (spent + left) if left > 0 else 1.0

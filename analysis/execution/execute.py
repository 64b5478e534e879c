"""Runs a study into a run directory: what is there stays, what is missing or damaged is computed."""

from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol

import pandas as pd

from cooploc.analysis.execution.certificates import renewed, with_lines
from cooploc.analysis.execution.compilation import compile_kernels
from cooploc.analysis.execution.fit import require_fit, without_misfits
from cooploc.analysis.execution.local_workers import ThisMachine
from cooploc.analysis.execution.memory import demand_memory
from cooploc.analysis.execution.plan import Plan, make_plan
from cooploc.analysis.execution.pool import Workers
from cooploc.analysis.execution.provenance import files, fingerprint, imports, provenance
from cooploc.analysis.execution.remaining import Remaining
from cooploc.analysis.execution.run_directory import FORMAT, Piece, RunDir
from cooploc.analysis.execution.task import MeasuredPart
from cooploc.analysis.execution.workers import hired
from cooploc.analysis.formats import counted
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.processes.workers import BUILTIN, end
from cooploc.scenarios.remote import RemoteScenario
from cooploc.scenarios.scenario import ResolvedScenario
from cooploc.scenarios.studies.study import ResolvedCell, ResolvedStudy, Study, resolve_study

ROUNDS = 3  # of planning and computing, as long as parts vanish meanwhile
MANY = 2000  # parts of a run whose rows need the memory that idle processes hold


class Progress(Protocol):
    """What is called as a run goes on."""

    def compiling(self) -> None:
        """Kernels are compiled, once on this machine, before the trials begin."""

    def begin(self, trials: int, found: int) -> None:
        """How many (estimator, trial) pairs there are in all, and how many of them already."""

    def advance(self, what: str, trials: int, failed: int, share: float) -> None:
        """A part is done; and the share of the processor time that is spent by now."""

    def say(self, line: str) -> None:
        """Something that the user should know."""


class Quiet:
    """Progress that shows nothing."""

    def compiling(self) -> None:
        """Nothing."""

    def begin(self, trials: int, found: int) -> None:
        """Nothing."""

    def advance(self, what: str, trials: int, failed: int, share: float) -> None:
        """Nothing."""

    def say(self, line: str) -> None:
        """Nothing."""


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
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Run what of a study is not there yet; returns the rows of everything that the study asks for.

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
        progress: called for every part.

    Returns:
        The columns of `errors`, and `failure`, `traceback` and `certificate`.

    Raises:
        BadInput: the study cannot run as it is; nothing was computed.
        OSError: a part could not be written; those before it are kept.

    """
    asked = resolve_study(study, data, isolate)
    asked = asked if counts is None else asked.with_trials(counts)
    watcher = progress or Quiet()
    asked = without_misfits(asked, watcher.say)
    memory = demand_memory(asked, jobs)
    directory = RunDir(out)
    with hired(jobs, scheduler, isolate, watcher.say) as workers, ExitStack() as held:
        require_fit(asked, isolate)
        held.enter_context(directory.locked())
        manifest = manifest_of(asked)
        said = [f"{label}, {line}" for label, lines in manifest["recordings"].items() for line in lines]
        for line in filter(None, (memory, *said, *directory.open({**manifest, "isolated": isolate}))):
            watcher.say(line)
        _certify(directory, asked, check, isolate, watcher)
        pieces = completed(asked, directory, workers, retry_failed, watcher)
        if len(pieces) > MANY:  # else they wait for the next run
            end(BUILTIN)
        rows = _rows(asked, directory, pieces)
        _note_streams(directory, rows)
    return rows


def manifest_of(asked: ResolvedStudy) -> dict[str, Any]:
    """What a run directory says of a study before anything is computed."""
    scenarios = [cell.scenario for cell in asked.cells]
    return {
        "format": FORMAT,
        "study": asked.study.model_dump(mode="json"),
        "cells": {cell.scenario.label: _as_json(cell) for cell in asked.cells},
        "seed": asked.study.seed,
        "data": None if asked.data is None else fingerprint(Path(asked.data)),
        "scenarios": {one.label: one.settings for one in scenarios},
        "recordings": _explained(scenarios),
        "files": files(asked.estimators, scenarios),
        "imports": imports(asked.estimators, scenarios),
        "certificates": {},
        "streams": {},
        **provenance(),
    }


def _explained(scenarios: Iterable[ResolvedScenario | RemoteScenario]) -> dict[str, list[str]]:
    """What recordings say of themselves, by label."""
    found = {one.label: one.explained() for one in scenarios if isinstance(one, ResolvedScenario)}
    return {label: lines for label, lines in found.items() if lines}


def _as_json(cell: ResolvedCell) -> dict[str, Any]:
    return {"experiment": cell.experiment, "baseline": cell.baseline, "estimators": dict(cell.trials)}


def _certify(directory: RunDir, asked: ResolvedStudy, check: bool, isolate: bool, watcher: Progress) -> None:
    """Write each certificate as soon as it is made; a run goes on after a check that failed."""
    manifest = directory.manifest
    for label, found in renewed(asked.estimators, manifest["certificates"], check, watcher.say, isolate):
        manifest["certificates"][label] = found
        directory.write_manifest(manifest)


def completed(
    asked: ResolvedStudy, directory: RunDir, workers: Workers, retry_failed: bool, watcher: Progress
) -> list[Piece]:
    """All parts of a study, when each of them is there: what vanished while others were computed is computed again.

    Raises:
        BadInput: parts vanish again and again.

    """
    plan = make_plan(asked, directory, "all" if retry_failed else "lost")
    for _ in range(ROUNDS):
        _compute(plan, asked, directory, workers, watcher)
        plan = make_plan(asked, directory, None)
        if not plan.tasks:
            return plan.intact
    gone = plan.tasks[0]
    where = f"{gone.scenario.label}, {gone.estimators[0].label}, trials {gone.trials.start} to {gone.trials.stop - 1}"
    raise BadInput(f"parts vanish from {directory.path} as they are written ({where}): see what removes them")


def _compute(plan: Plan, asked: ResolvedStudy, directory: RunDir, workers: Workers, watcher: Progress) -> None:
    """Compute and write the parts that a plan lacks."""
    for piece in plan.damaged:
        watcher.say(f"{piece.name} is gone or does not match its checksum; its trials are computed again")
    if plan.failed:
        watcher.say(f"{counted(len(plan.failed), 'part')} with trials that failed: computed again")
    if isinstance(workers, ThisMachine):
        compile_kernels(plan.tasks, workers.jobs, watcher.compiling)
    todo = sum(len(task.trials) * len(task.estimators) for task in plan.tasks)
    watcher.begin(plan.trials, plan.trials - todo)
    cells, remaining = {cell.scenario.label: cell for cell in asked.cells}, Remaining(plan.tasks)
    for part in workers.compute(plan.tasks):
        directory.write(part.piece, part.frame, part.seconds)
        cell = cells[part.piece.scenario]
        _advance(part, cell, remaining.share_after(part, cell.scenario), watcher)


def _advance(part: MeasuredPart, cell: ResolvedCell, share: float, watcher: Progress) -> None:
    scenario, estimator, trials = part.piece
    failed = part.frame.loc[part.frame["failure"].notna(), "trial"].nunique()
    where = scenario if scenario.startswith(cell.experiment) else f"{cell.experiment} · {scenario}"
    watcher.advance(f"{where} · {estimator}", len(trials), failed, share)


def _rows(asked: ResolvedStudy, directory: RunDir, pieces: list[Piece]) -> pd.DataFrame:
    """The rows of intact pieces in the study's order, whatever the order in which they were computed."""
    of: dict[tuple[str, str], list[Piece]] = {}
    for piece in sorted(pieces, key=lambda one: one.trials.start):
        of.setdefault((piece.scenario, piece.estimator), []).append(piece)
    ordered = [
        (piece, cell.trials[estimator.label])
        for cell in asked.cells
        for estimator in asked.estimators
        for piece in of.get((cell.scenario.label, estimator.label), ())
    ]
    return with_lines(directory.rows(ordered), directory.manifest["certificates"], asked.estimators)


def _note_streams(directory: RunDir, rows: pd.DataFrame) -> None:
    manifest = directory.manifest
    streams = manifest["streams"]
    for row in rows.dropna(subset="stream").drop_duplicates(["scenario", "trial"]).itertuples():
        streams.setdefault(row.scenario, {})[str(row.trial)] = row.stream
    directory.write_manifest(manifest)

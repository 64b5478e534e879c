"""Runs a study into a run directory: what is there is kept, what is missing is computed, what was spoilt is named."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import pandas as pd

from cooploc.analysis.execution.certificates import renewed, with_lines
from cooploc.analysis.execution.plan import Plan, make_plan, trials_of, work
from cooploc.analysis.execution.provenance import files, fingerprint, provenance
from cooploc.analysis.execution.run_directory import FORMAT, Piece, RunDir
from cooploc.analysis.execution.task import Part
from cooploc.analysis.execution.workers import hired
from cooploc.estimators import make
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios import family, scenario, simulate
from cooploc.scenarios.runner.run import demand_fit
from cooploc.scenarios.studies.study import Cell, Study


class Progress(Protocol):
    """Who watches a run."""

    def begin(self, trials: int, found: int, work: float) -> None:
        """So many (estimator, trial) pairs in all and there already, and so much work to do."""

    def advance(self, what: str, trials: int, failed: int, work: float) -> None:
        """A part is done."""

    def say(self, line: str) -> None:
        """Something that the user should know."""


class Quiet:
    """Nobody watches."""

    def begin(self, trials: int, found: int, work: float) -> None:
        """Nothing."""

    def advance(self, what: str, trials: int, failed: int, work: float) -> None:
        """Nothing."""

    def say(self, line: str) -> None:
        """Nothing."""


def execute(
    study: Study,
    out: Path,
    *,
    data: Path | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    check: bool = True,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Run what of a study is not there yet; returns the rows of everything the study asks for.

    Args:
        study: what to run.
        out: the run directory; continued where it holds the same settings.
        data: the directory of recordings, for scenarios that need it.
        jobs: processes.
        scheduler: the address of a Dask scheduler, whose workers are used instead.
        check: whether estimators that are not built in are checked first, once per version of their source.
        progress: told of every part.

    Raises:
        BadInput: the study cannot be run as it stands; nothing was computed.
        OSError: a part could not be written; what was is kept.

    """
    told = None if data is None else str(data)
    watcher = progress or Quiet()
    cells = {cell.scenario: cell for cell in study.cells()}
    _demand_fit(cells.values(), study.seed, told)
    directory = RunDir(out)
    with hired(jobs, scheduler) as workers, directory.locked():
        directory.open(_manifest(study, told))
        _certify(directory, cells.values(), check, watcher)
        plan = make_plan(study, told, directory)
        _announce(plan, cells, watcher)
        for part in workers.compute(plan.tasks):
            directory.write(Piece(part.scenario, part.estimator, part.trials), part.frame, part.seconds)
            _tell(part, cells[part.scenario], watcher)
        rows = rows_of(study, out, data)
        _note_streams(directory, rows)
    return rows


def rows_of(study: Study, out: Path, data: Path | None = None) -> pd.DataFrame:
    """The rows that a run directory holds of a study: those of `errors`, `failure`, `traceback` and `certificate`.

    Raises:
        BadInput: it holds none.

    """
    told = None if data is None else str(data)
    directory = RunDir(out)
    frames = []
    for piece in make_plan(study, told, directory).kept:
        frame = directory.read(piece)
        frames.append(frame[frame["trial"] < trials_of(study, piece.scenario, told)])
    if not frames:
        raise BadInput(f"{out} holds nothing of study {study.name!r}: run it first")
    rows = _ordered(pd.concat(frames, ignore_index=True), study)
    return with_lines(rows, directory.manifest.get("certificates", {}))


def _certify(directory: RunDir, cells: Iterable[Cell], check: bool, watcher: Progress) -> None:
    """Each certificate is kept at once; one that fails stops nothing."""
    manifest = directory.manifest
    asked = [name for cell in cells for name in cell.estimators]
    for label, found in renewed(asked, manifest["certificates"], check, watcher.say):
        manifest["certificates"][label] = found
        directory.write_manifest(manifest)


def _announce(plan: Plan, cells: dict[str, Cell], watcher: Progress) -> None:
    for piece in plan.damaged:
        watcher.say(f"{piece.name} does not match its checksum; its trials are computed again")
    todo = [(len(task.trials) * len(task.estimators), work(cells[task.scenario])) for task in plan.tasks]
    watcher.begin(plan.trials, plan.trials - sum(n for n, _ in todo), sum(n * each for n, each in todo))


def _tell(part: Part, cell: Cell, watcher: Progress) -> None:
    failed = part.frame.loc[part.frame["failure"].notna(), "trial"].nunique()
    where = part.scenario if part.scenario.startswith(cell.experiment) else f"{cell.experiment} · {part.scenario}"
    watcher.advance(f"{where} · {part.estimator}", len(part.trials), failed, len(part.trials) * work(cell))


def _demand_fit(cells: Iterable[Cell], seed: int, data: str | None) -> None:
    """Refuse, before anything is computed, what cannot run: names, parameters, channels, recordings."""
    for cell in cells:
        made = {label: make(label) for label in cell.estimators}
        label = cell.scenario
        short: dict[str, Any] = {"ticks": 1} if not family(label).recorded and hasattr(scenario(label), "ticks") else {}
        _, stream = simulate(label, trials=1, seed=seed, data=data, **short)
        for name, estimator in made.items():
            demand_fit(name, estimator, replace(stream, scenario=label))


def _manifest(study: Study, data: str | None) -> dict[str, Any]:
    extra = {} if data is None else {"data": data}
    cells = study.cells()
    worlds = {c.scenario: scenario(c.scenario, **(extra if family(c.scenario).recorded else {})) for c in cells}
    return {
        "format": FORMAT,
        "study": study.model_dump(mode="json"),
        "cells": {cell.scenario: _asked(cell, trials_of(study, cell.scenario, data)) for cell in cells},
        "seed": study.seed,
        "data": None if data is None else fingerprint(Path(data)),
        "scenarios": {label: world.model_dump(mode="json", exclude={"data"}) for label, world in worlds.items()},
        "files": files((name for cell in cells for name in cell.estimators), (cell.scenario for cell in cells)),
        "certificates": {},
        "streams": {},
        **provenance(),
    }


def _asked(cell: Cell, trials: int) -> dict[str, Any]:
    estimators = dict.fromkeys(cell.estimators, trials)
    return {"experiment": cell.experiment, "baseline": cell.baseline, "estimators": estimators}


def _ordered(rows: pd.DataFrame, study: Study) -> pd.DataFrame:
    """Rows in the study's order, whatever the order they were computed in."""
    cells = study.cells()
    estimators = dict.fromkeys(name for cell in cells for name in cell.estimators)
    keys = rows[["trial", "robot"]].assign(
        scenario=rows["scenario"].map({cell.scenario: i for i, cell in enumerate(cells)}),
        estimator=rows["estimator"].map({label: i for i, label in enumerate(estimators)}),
    )
    order = keys.sort_values(["scenario", "estimator", "trial", "robot"], kind="stable").index
    return rows.loc[order].reset_index(drop=True)


def _note_streams(directory: RunDir, rows: pd.DataFrame) -> None:
    manifest = directory.manifest
    streams = manifest["streams"]
    for row in rows.drop_duplicates(["scenario", "trial"]).itertuples():
        streams.setdefault(row.scenario, {})[str(row.trial)] = row.stream
    directory.write_manifest(manifest)

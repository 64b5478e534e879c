"""After a run with plug-ins, some of their trials again: alone, in a fresh process with other surroundings.

Equal bits, or the estimator's certificate says that it is not reproducible.
"""

import secrets
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.execution.certificates import StudyWorlds, with_check
from cooploc.analysis.execution.elsewhere import Elsewhere, play_elsewhere
from cooploc.analysis.execution.own_world_certificate import SURROUNDINGS, World, places
from cooploc.analysis.execution.run_directory import Piece, RunDir
from cooploc.analysis.execution.walled import given, measured_here
from cooploc.estimators.plugins.build import ConfiguredEstimator
from cooploc.scenarios import BUILTIN
from cooploc.scenarios.processes.outcome import WorkerError
from cooploc.scenarios.processes.workers import end
from cooploc.scenarios.scenario import ResolvedScenario
from cooploc.scenarios.studies.study import ResolvedStudy

NAME = "reproduction"
TRIALS = 3  # of each estimator
LIMIT = 600.0  # [s] for all of them


def study_worlds(asked: ResolvedStudy, label: str) -> StudyWorlds:
    """The simulated worlds of ours in which a study runs an estimator."""
    cells = [cell for cell in asked.cells if label in {one.label for one in cell.estimators}]
    worlds = [
        World(cell.scenario, cell.most)
        for cell in cells
        if isinstance(cell.scenario, ResolvedScenario) and cell.scenario.name in BUILTIN and not cell.scenario.recorded
    ]
    return StudyWorlds(tuple(worlds), asked.study.seed)


def run_again(directory: RunDir, asked: ResolvedStudy, pieces: list[Piece], say: Callable[[str], None]) -> None:
    """Run a few trials of each estimator that passed its checks again, and note in its certificate what they gave."""
    manifest = directory.manifest
    for one in asked.estimators:
        certificate = manifest["certificates"].get(one.label)
        if certificate is None or certificate["status"] != "passed":
            continue
        found = _repeated(one, directory, asked, pieces)
        if found["status"] == "failed":
            say(f"{one.label} is not reproducible: {found['detail']}")
        manifest["certificates"][one.label] = with_check(certificate, found)
        directory.write_manifest(manifest)


def _repeated(one: ConfiguredEstimator, directory: RunDir, asked: ResolvedStudy, pieces: list[Piece]) -> dict[str, Any]:
    """The result of this check."""
    rng = np.random.default_rng(secrets.randbits(64))
    cells = {cell.scenario.label: cell.scenario for cell in asked.cells}
    known = [(p, k) for p in pieces if p.estimator == one.label for k in p.trials
             if isinstance(cells[p.scenario], ResolvedScenario) and cells[p.scenario].name in BUILTIN]  # fmt: skip
    where, owners = places(one.label, LIMIT)
    said, again = [], []
    try:
        for i in rng.permutation(len(known))[:TRIALS]:
            piece, trial = known[i]
            before = directory.read(piece)
            before = before[(before["trial"] == trial) & before["failure"].isna()]
            if before.empty:
                continue
            truth, stream = cells[piece.scenario].simulate([trial], asked.study.seed)
            there: Elsewhere = where.fresh(play_elsewhere, given(one.label, stream, asked.study.time_limit))
            after = measured_here(one.label, truth, stream, there.played)
            again.append(f"trial {trial} of {piece.scenario}")
            said += [f"{again[-1]}: {why}" for why in [difference(before, after)] if why]
    except WorkerError as e:
        said.append(str(e))
    finally:
        for owner in owners:
            end(owner)
    status = "failed" if said else "passed" if again else "skipped"
    same = f"{', '.join(again)} {SURROUNDINGS}, alone: the same bits" if again else "no trial of it could run again"
    detail = f"{said[0]} when it {SURROUNDINGS}, alone" if said else same
    return {"check": NAME, "status": status, "detail": detail, "seed": asked.study.seed, "example": "", "remedy": ""}


def difference(before: pd.DataFrame, after: pd.DataFrame) -> str:
    """How one trial's rows differ in what no clock measured; empty where they are equal by the bit."""
    failure = after["failure"].dropna()
    if len(failure):
        return f"failed ({failure.iloc[0]})"
    columns = [c for c in after if c != "seconds" and pd.api.types.is_numeric_dtype(after[c])]
    pairs = [np.ascontiguousarray(frame[columns].to_numpy(float)).view(np.uint64) for frame in (before, after)]
    if pairs[0].shape == pairs[1].shape and (pairs[0] == pairs[1]).all():
        return ""
    rmse = [float(np.sqrt(frame["mse"].mean())) for frame in (before, after)]
    return "its RMSE was {:.9g} m and is {:.9g} m".format(*rmse)

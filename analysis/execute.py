"""Runs a study: every scenario's trials in chunks, every chunk's stream through every estimator, into a run directory.

A chunk's size depends on the scenario alone, and results do not depend on chunks at all; so any number of processes
gives the same bits, and a run that was interrupted goes on where it was.
"""

import hashlib
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, as_completed
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from cooploc.analysis.errors import COLUMNS, errors
from cooploc.analysis.rundir import FORMAT, RunDir, part_name, provenance
from cooploc.estimators import make
from cooploc.estimators.bad_input import BadInput
from cooploc.scenarios import family, scenario, simulate
from cooploc.scenarios.runner import demand_fit, run
from cooploc.scenarios.stream import Stream, Truth
from cooploc.scenarios.study import Study

CHUNK_BYTES = 64e6  # of readings between robots, the largest arrays of a stream
CHUNK_TRIALS = 10


@dataclass(frozen=True)
class Task:
    """One chunk of a scenario's trials, for the estimators that still lack it."""

    scenario: str
    trials: range
    seed: int
    data: str | None
    estimators: tuple[str, ...]


class Part(NamedTuple):
    """What a task found out about one estimator."""

    scenario: str
    estimator: str
    trials: range
    frame: pd.DataFrame  # as `errors`, without seconds, with `failure`: why a trial has no result, else missing
    seconds: float  # per robot and tick


Progress = Callable[[str, int, int], None]  # what was done, (estimator, trial) pairs done, failures among them


def execute(
    study: Study, out: Path, *, data: Path | None = None, jobs: int = 1, progress: Progress | None = None
) -> pd.DataFrame:
    """Run what of a study is not there yet; returns the rows of everything the study asks for.

    Args:
        study: what to run.
        out: the run directory; continued where it holds the same settings.
        data: the directory of recordings, for scenarios that need it.
        jobs: processes.
        progress: called after each part.

    Raises:
        BadInput: the study cannot be run as it stands; nothing was computed.

    """
    if jobs < 1:
        raise BadInput(f"jobs is {jobs}; it must be at least 1")
    told = None if data is None else str(data)
    _demand_fit(study, told)
    directory = RunDir(out)
    directory.open(_manifest(study, told))
    kept, tasks = _plan(study, told, directory)
    tell = progress or (lambda what, done, failed: None)
    for frame in kept:
        tell("found", frame["trial"].nunique(), 0)
    for part in _computed(tasks, jobs):
        name = part_name(part.scenario, part.estimator, part.trials)
        directory.write(name, part.frame, part.seconds)
        kept.append(part.frame.assign(seconds=part.seconds))
        failed = part.frame.loc[part.frame["failure"].notna(), "trial"].nunique()
        tell(f"{part.scenario} · {part.estimator}", len(part.trials), failed)
    rows = _ordered(pd.concat(kept, ignore_index=True), study)
    _note_streams(directory, rows)
    return rows


def trials_of(study: Study, label: str, data: Path | str | None) -> int:
    """How many trials a scenario of the study has: a recording has one, unless it counts its runs."""
    if not family(label).recorded:
        return study.trials
    made: Any = scenario(label, data=data) if data is not None else None
    return made.count() if hasattr(made, "count") else 1


def pairs(study: Study, data: Path | str | None = None) -> int:
    """How many (estimator, trial) pairs the study has."""
    return sum(trials_of(study, label, data) for label in study.scenarios) * len(study.estimators)


def _demand_fit(study: Study, data: str | None) -> None:
    """Refuse, before anything is computed, what cannot run: names, parameters, channels, recordings."""
    if study.baseline not in study.estimators:
        raise BadInput(
            f"study {study.name!r} compares with {study.baseline!r}, not one of its estimators: add it there"
        )
    for what, labels in (("estimator", study.estimators), ("scenario", study.scenarios)):
        twice = [label for label in labels if labels.count(label) > 1]
        if twice:
            raise BadInput(f"study {study.name!r} names the {what} {twice[0]!r} twice: name it once")
    made = {label: make(label) for label in study.estimators}
    for label in study.scenarios:
        short: dict[str, Any] = {"ticks": 1} if not family(label).recorded and hasattr(scenario(label), "ticks") else {}
        _, stream = simulate(label, trials=1, seed=study.seed, data=data, **short)
        for name, estimator in made.items():
            demand_fit(name, estimator, replace(stream, scenario=label))


def _manifest(study: Study, data: str | None) -> dict[str, Any]:
    extra = {} if data is None else {"data": data}
    worlds = {label: scenario(label, **(extra if family(label).recorded else {})) for label in study.scenarios}
    parameters = {label: world.model_dump(mode="json", exclude={"data"}) for label, world in worlds.items()}
    return {
        "format": FORMAT,
        "study": study.model_dump(mode="json"),
        "seed": study.seed,
        "data": None if data is None else _fingerprint(Path(data)),
        "scenarios": parameters,
        "streams": {},
        **provenance(),
    }


def _plan(study: Study, data: str | None, directory: RunDir) -> tuple[list[pd.DataFrame], list[Task]]:
    """What is there already, and what is to be done."""
    kept, tasks = [], []
    for label in study.scenarios:
        size = _chunk_size(label)
        count = trials_of(study, label, data)
        for start in range(0, count, size):
            trials = range(start, min(start + size, count))
            found = {name: directory.read(part_name(label, name, trials)) for name in study.estimators}
            kept += [frame for frame in found.values() if frame is not None]
            missing = tuple(name for name, frame in found.items() if frame is None)
            if missing:
                where = data if family(label).recorded else None
                tasks.append(Task(label, trials, study.seed, where, missing))
    return kept, tasks


def _chunk_size(label: str) -> int:
    if family(label).recorded:
        return 1
    world: Any = scenario(label)
    per_trial = 17 * getattr(world, "ticks", 1) * getattr(world, "robots", 1) ** 2
    return max(1, min(CHUNK_TRIALS, int(CHUNK_BYTES // per_trial)))


def _computed(tasks: list[Task], jobs: int) -> Iterator[Part]:
    if jobs == 1 or len(tasks) < 2:
        for task in tasks:
            yield from measure(task)
        return
    from loky import get_reusable_executor

    pool: Executor = get_reusable_executor(max_workers=jobs)
    waiting: list[Future[list[Part]]] = [pool.submit(_measured, task) for task in tasks]
    try:
        for future in as_completed(waiting):
            yield from future.result()
    finally:
        for future in waiting:
            future.cancel()


def _measured(task: Task) -> list[Part]:
    return list(measure(task))


def measure(task: Task) -> Iterator[Part]:
    """Simulate a task's trials once and run its estimators on them."""
    truth, stream = simulate(task.scenario, trials=task.trials, seed=task.seed, data=task.data)
    for label in task.estimators:
        _warm(label, stream)
        frame = _frame(label, truth, stream)
        seconds = float(frame["seconds"].mean())
        yield Part(task.scenario, label, task.trials, frame.drop(columns="seconds"), seconds)


def _warm(label: str, stream: Stream) -> None:
    """Import and compile before the clock runs; whatever goes wrong will do so again, and be recorded then."""
    with suppress(Exception):
        run({label: make(label)}, stream.select(slice(0, 1)).truncated(2))


def _frame(label: str, truth: Truth, stream: Stream) -> pd.DataFrame:
    """The rows of one estimator; where it fails, trial by trial, so that one bad trial costs no other."""
    try:
        frame = errors(truth, run({label: make(label)}, stream))
        return frame.assign(failure=pd.Series([None] * len(frame), dtype="str"))
    except Exception as e:
        if len(stream.trial) == 1:
            return _failed(label, stream, e)
        single = (slice(i, i + 1) for i in range(len(stream.trial)))
        return pd.concat([_frame(label, truth.select(s), stream.select(s)) for s in single], ignore_index=True)


def _failed(label: str, stream: Stream, e: Exception) -> pd.DataFrame:
    place = traceback.extract_tb(e.__traceback__)[-1]
    reason = f"{type(e).__name__}: {e} ({Path(place.filename).name}:{place.lineno})"
    who = {"scenario": stream.scenario, "estimator": label, "trial": stream.trial[0], "robot": range(stream.robots)}
    rest = {"robots": stream.robots, "stream": stream.hashes[0], "failure": reason, "bound": False}
    return pd.DataFrame({**who, **rest, "seconds": float("nan")}).reindex(columns=[*COLUMNS, "failure"])


def _ordered(rows: pd.DataFrame, study: Study) -> pd.DataFrame:
    """Rows in the study's order, whatever the order they were computed in."""
    keys = rows[["trial", "robot"]].assign(
        scenario=rows["scenario"].map({label: i for i, label in enumerate(study.scenarios)}),
        estimator=rows["estimator"].map({label: i for i, label in enumerate(study.estimators)}),
    )
    order = keys.sort_values(["scenario", "estimator", "trial", "robot"], kind="stable").index
    return rows.loc[order].reset_index(drop=True)


def _note_streams(directory: RunDir, rows: pd.DataFrame) -> None:
    manifest = directory.manifest
    streams = manifest["streams"]
    for row in rows.drop_duplicates(["scenario", "trial"]).itertuples():
        streams.setdefault(row.scenario, {})[str(row.trial)] = row.stream
    directory.write_manifest(manifest)


def _fingerprint(data: Path) -> str:
    """One hash over the names and contents of a directory's files."""
    digest = hashlib.sha256()
    for file in sorted(data.iterdir()):
        if file.is_file():
            digest.update(file.name.encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()

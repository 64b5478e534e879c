"""Run a study into a run directory: what is there stays, what is missing or damaged is computed.

`prepare` reads a study's labels, once, and refuses what cannot run; `execute` runs what it returns;
`run_until_decided` does so look by look.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import pandas as pd

from cooploc.analysis.execution.provenance import add_certificates, check_plugins, fingerprint, plugins, provenance
from cooploc.analysis.execution.run_directory import DECISIONS, FORMAT, Cell, PartKey, RunDir, write_json
from cooploc.analysis.execution.workers import Task, make_workers
from cooploc.analysis.formats import duration, lines_about
from cooploc.analysis.metrics.sequential import OPEN, decide, looks
from cooploc.estimators import module_of
from cooploc.estimators.errors import count_of
from cooploc.scenarios.process import PLUGINS, end
from cooploc.scenarios.runner.run import find_misfits
from cooploc.scenarios.scenario import ResolvedScenario, require_no_faults
from cooploc.scenarios.studies.study import ResolvedStudy, Study, resolve_study

CHUNK_BYTES = 64e6  # of readings between robots, the largest arrays of a stream
CHUNK_ROWS = 200  # (trial, robot): enough that numpy's cost per call no longer counts, few enough to lose in a crash
CHUNK_TRIALS = 10, 50  # at least, unless the bytes forbid it, and at most


class RunProgress(Protocol):
    """Methods that are called as a run goes on."""

    def begin(self, trials: int, found: int) -> None:
        """The run has so many (estimator, trial) pairs in all, and so many of them on disk."""

    def advance(self, what: str, trials: int, failed: int) -> None:
        """A part is done."""

    def say(self, line: str) -> None:
        """The user should know this."""


class Silent(RunProgress):
    """A progress that shows nothing."""

    def begin(self, trials: int, found: int) -> None: ...

    def advance(self, what: str, trials: int, failed: int) -> None: ...

    def say(self, line: str) -> None: ...


# Before a run: a study's labels become objects, and what cannot run is refused.


def prepare(
    study: Study,
    data: Path | None = None,
    *,
    isolate: bool = True,
    strict: bool = False,
    say: Callable[[str], None] = lambda line: None,
) -> ResolvedStudy:
    """Read every label of a study, and start every estimator on the first tick of every scenario.

    Raises:
        BadInput: something cannot be run as it is; with `strict`, also a recording of which something was left out.

    """
    asked = resolve_study(study, data)
    for estimator in asked.estimators:
        module_of(estimator.name)  # an unknown name is refused here
    cells = []
    for cell in asked.cells:
        if strict:
            require_no_faults([f"{cell.scenario.label}, {line}" for line in cell.scenario.faults()])
        misfits = find_misfits(cell.scenario, cell.estimators, study.seed, study.time_limit, isolate)
        for label, error in misfits.items():
            if not study.leaves_out_misfits or label == cell.baseline:
                raise error
        for line in lines_about({label: [str(e).removeprefix(f"{label} ")] for label, e in misfits.items()}):
            say(f"left out: {line}")
        kept = tuple(one for one in cell.estimators if one.label not in misfits)
        cells.append(cell._replace(estimators=kept, trials={one.label: cell.trials[one.label] for one in kept}))
    return asked._replace(cells=tuple(cells))


# The run.


def execute(
    study: ResolvedStudy,
    out: Path,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    check: bool = True,
    retry_failed: bool = False,
    isolate: bool = True,
    progress: RunProgress | None = None,
    keep: bool = False,
) -> pd.DataFrame:
    """Run the parts of a study that are not there yet; return the rows of everything that the study asks for.

    `cooploc.api.run_study` explains the options; `keep` leaves the process of plug-ins to the next call, which need not
    import them again. Columns: those of `errors`, `failure`, `traceback`, `certificate`.

    Raises:
        BadInput: the study cannot be run as it is; nothing was computed.
        OSError: a part could not be written; those before it are kept.

    """
    watcher, directory, wanted = progress or Silent(), RunDir(out), trials_of_cells(study)
    with make_workers(jobs, scheduler, isolate) as compute, directory.lock():
        directory.open(make_manifest(study, isolate), watcher.say)
        manifest = directory.manifest
        for line in lines_about(manifest["recordings"]):
            watcher.say(line)
        check_plugins(manifest, study.data, partial(directory.write_manifest, manifest), check, isolate, watcher.say)
        found, damaged = directory.find(wanted)
        for key in damaged:
            watcher.say(f"{key.name} is gone or does not match its checksum; its trials are computed again")
        again = {key for key, receipt in found.items() if retry_failed and receipt.failed}
        tasks, total = make_tasks(study, found, again, isolate), sum(wanted.values())
        watcher.begin(total, total - sum(len(task.trials) * len(task.estimators) for task in tasks))
        experiments = {cell.scenario.label: cell.experiment for cell in study.cells}
        for part in compute(tasks):
            receipt = found[part.key] = directory.write(part.key, part.frame, part.seconds)
            scenario, estimator, trials = part.key
            where = scenario if scenario.startswith(experiments[scenario]) else f"{experiments[scenario]} · {scenario}"
            watcher.advance(f"{where} · {estimator}", len(trials), receipt.failed)
        rows = directory.read_rows(wanted, found)
        for row in rows.dropna(subset="stream").drop_duplicates(["scenario", "trial"]).itertuples():
            manifest["streams"].setdefault(row.scenario, {})[str(row.trial)] = row.stream
        directory.write_manifest(manifest)
    if not keep:
        end(PLUGINS)
    return add_certificates(rows, manifest["certificates"])


def make_manifest(asked: ResolvedStudy, isolate: bool) -> dict[str, Any]:
    """Return what a run directory says of a study before anything is computed."""
    scenarios = [cell.scenario for cell in asked.cells]
    files, imports = plugins(asked.estimators, scenarios)
    return {
        "format": FORMAT,
        "study": asked.study.model_dump(mode="json"),
        "cells": {
            c.scenario.label: {"experiment": c.experiment, "baseline": c.baseline, "estimators": dict(c.trials)}
            for c in asked.cells
        },
        "seed": asked.study.seed,
        "data": None if asked.data is None else fingerprint(Path(asked.data)),
        "scenarios": {one.label: one.settings for one in scenarios},
        "recordings": {one.label: lines for one in scenarios if (lines := one.explanations())},
        "files": files,
        "imports": imports,
        "certificates": {},
        "streams": {},
        "isolated": isolate,
        **provenance(),
    }


def trials_of_cells(study: ResolvedStudy) -> dict[tuple[str, str], int]:
    """Return the trials of each (scenario, estimator), in the order of a run's rows."""
    ordered = [one.label for one in study.estimators]
    cells = [(cell.scenario.label, label, cell.trials) for cell in study.cells for label in ordered]
    return {(scenario, label): trials[label] for scenario, label, trials in cells if label in trials}


def make_tasks(study: ResolvedStudy, held: Iterable[PartKey], again: Iterable[PartKey], isolate: bool) -> list[Task]:
    """Return the tasks that compute the parts of a study that are not held, or are to run again."""
    there: dict[Cell, list[range]] = {}
    for key in held:
        there.setdefault(key[:2], []).append(key.trials)
    tasks = []
    for cell in study.cells:
        label, gaps = cell.scenario.label, dict[range, list[str]]()
        for name, wanted in cell.trials.items():
            missing = _gaps(there.get((label, name), []), wanted, chunk_size(cell.scenario))
            for gap in (*missing, *(key.trials for key in again if key[:2] == (label, name))):
                gaps.setdefault(gap, []).append(name)
        for gap in sorted(gaps, key=lambda trials: trials.start):
            lacking = tuple(one for one in cell.estimators if one.label in gaps[gap])
            tasks.append(Task(cell.scenario, gap, study.study.seed, lacking, study.study.time_limit, isolate))
    return tasks


def _gaps(held: Iterable[range], count: int, size: int) -> Iterator[range]:
    """Yield the trials below `count` that no part holds, in pieces of one chunk."""
    missing = set(range(count)).difference(*held)
    first = 0
    for trial in sorted(missing):
        first = trial if trial - 1 not in missing or trial % size == 0 else first
        if trial + 1 not in missing or (trial + 1) % size == 0:
            yield range(first, trial + 1)


def chunk_size(scenario: ResolvedScenario) -> int:
    """Return how many trials of a scenario are computed together; results do not depend on it."""
    if scenario.is_recording:
        return 1
    least, most = CHUNK_TRIALS
    fits = int(CHUNK_BYTES // (17 * scenario.ticks * scenario.robots**2))
    return max(1, min(fits, most, max(least, CHUNK_ROWS // scenario.robots)))


# A run until its questions are decided.


class Answers(NamedTuple):
    """The answers of a look to one kind of question."""

    of: str  # what is asked: comparison, claim
    open: frozenset[Cell]  # cells whose further trials may decide what is open
    decided: int
    undecided: int
    records: list[dict[str, Any]]  # for `decisions.json`


Ask = Callable[[pd.DataFrame, int], Answers]  # rows of a run, and the trials of the look


def run_until_decided(
    study: ResolvedStudy, out: Path, ask: Sequence[Ask] = (), progress: RunProgress | None = None, **options: Any
) -> pd.DataFrame:
    """Run a study until its comparisons with baselines, and the questions of `ask`, are decided, or it has all trials.

    After 10, 20, 40, ... trials, what is decided stops. A look depends on the trials below its number alone, never on
    when they finished, so neither the number of processes nor an interruption changes what it decides.
    """
    most, watcher = study.study.trials, progress or Silent()
    limits = {(cell.scenario.label, name): count for cell in study.cells for name, count in cell.trials.items()}
    counts, going, rows = dict.fromkeys(limits, 0), set(limits), pd.DataFrame()
    for n in looks(most):
        counts |= {cell: min(n, limits[cell]) for cell in going}
        rows = execute(study.limit_trials(counts), out, progress=watcher, keep=True, **options)
        below = {cell.scenario.label: min(n, cell.most) for cell in study.cells}
        answers = [_ask_comparisons(rows, study, below), *(question(rows, n) for question in ask)]
        going = {cell for one in answers for cell in one.open if counts[cell] < limits[cell]}
        records = {one.of: one.records for one in answers}
        write_json(out / DECISIONS, {"most": most, "look": n, "going": sorted(going), **records})
        watcher.say(_look_sentence(n, answers, seconds_left(rows, going, most) / options.get("jobs", 1)))
        if not going:
            break
    end(PLUGINS)
    return rows


def _ask_comparisons(rows: pd.DataFrame, study: ResolvedStudy, below: dict[str, int]) -> Answers:
    """Compare every estimator with the baseline of its scenario, on the trials below a number."""
    found = decide(rows, {cell.scenario.label: cell.baseline for cell in study.cells}, below)
    going = [one for one in found if one.verdict == OPEN]
    cells = frozenset((one.scenario, name) for one in going for name in (one.estimator, one.baseline))
    return Answers("comparison", cells, len(found) - len(going), len(going), [one._asdict() for one in found])


def trial_seconds(rows: pd.DataFrame) -> "pd.Series[float]":
    """Return the computing time of a trial [s] on one process, by (scenario, estimator), without its stream."""
    groups = (rows["seconds"] * rows["ticks"]).groupby([rows["scenario"], rows["estimator"]])
    return groups.sum() / rows.groupby(["scenario", "estimator"])["trial"].nunique()


def seconds_left(rows: pd.DataFrame, going: Iterable[Cell], most: int) -> float:
    """Return the seconds of one process that open cells take at most, by the time of their trials so far."""
    cost, there = trial_seconds(rows), rows.groupby(["scenario", "estimator"])["trial"].nunique()
    return float(sum(cost[cell] * max(0, most - there[cell]) for cell in going if cell in there.index))


def _look_sentence(n: int, answers: Sequence[Answers], left: float) -> str:
    """Say what a look decided, and how long the rest takes at most."""
    totals = [(one.decided, one.decided + one.undecided, one.of) for one in answers]
    some = [f"{done} of {count_of(total, of)}" for done, total, of in totals if total]
    decided = ", ".join(some) or "nothing, as no estimator stands beside the baseline"
    still = sum(one.undecided for one in answers)
    rest = f"; {still} open, at most about {duration(left)} of estimating more" if left > 0 else ""
    return f"after {n} trials: decided {decided}{rest}"

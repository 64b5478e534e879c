"""Tune every estimator of a study alike, then run it as published and as tuned on the study's own streams."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from cooploc.analysis.execution.atomic_file import replace
from cooploc.analysis.execution.execute import Progress, Quiet, execute
from cooploc.analysis.execution.fit import require_fit
from cooploc.analysis.execution.run_directory import RunDir
from cooploc.analysis.execution.workers import hired
from cooploc.analysis.tuning.evaluations import Evaluations
from cooploc.analysis.tuning.objective import OBJECTIVES
from cooploc.analysis.tuning.race import Item
from cooploc.analysis.tuning.record_file import write_record
from cooploc.analysis.tuning.search import Competitor, search
from cooploc.analysis.tuning.space import space_of
from cooploc.analysis.tuning.study_file import as_toml, tuned_study
from cooploc.analysis.tuning.tables import Tuned, gains, history
from cooploc.analysis.tuning.training import TrainingLane, demand_apart, derived_seed, lanes
from cooploc.estimators.plugins.errors import BadInput, nearest
from cooploc.scenarios.studies.study import ResolvedStudy, Study, resolve_study

MOST_BUDGET = 1_000_000
FILE = "tuned.toml"


class Tuning(NamedTuple):
    """What a tuning found."""

    study: Study  # with the tuned configurations
    history: pd.DataFrame  # as `tables.history`
    gains: pd.DataFrame  # as `tables.gains`
    rows: pd.DataFrame  # of the run on fresh streams, of both configurations
    tuned: dict[str, str]  # the tuned label of every label of the study
    record: dict[str, Any]  # seeds, budget, streams


class Options(NamedTuple):
    """How it runs; nothing of it changes a bit."""

    data: Path | None = None
    jobs: int = 1
    check: bool = True
    isolate: bool = True


def tune(
    study: Study,
    out: Path,
    budget: int,
    objective: str = "nll",
    options: Options = Options(),  # noqa: B008 (frozen)
    progress: Progress | None = None,
) -> Tuning:
    """Tune, compare on fresh streams, and keep everything in `out`; what is there already is not computed again.

    Args:
        study: what is to be compared.
        out: the directory; `training` in it is the run directory of the search, `fresh` that of the comparison.
        budget: training trials that each estimator may use.
        objective: "nll" or "rmse", as of `objective`.
        options: where it runs.
        progress: called for every part.

    Raises:
        BadInput: something cannot be tuned as it stands; nothing was computed.

    """
    _demand(budget, objective)
    watcher = progress or Quiet()
    found = _searched(study, out, budget, objective, options, watcher)
    labels = {one.label: one.label for one in found.asked.estimators} | {one.published: one.best for one in found.tuned}
    record = {**_record(study, budget, objective, found), "tuned": labels}
    chosen, both = (tuned_study(study, study.cells(), labels, found.seed, both=both) for both in (False, True))
    write_record(out, record)
    replace(out / FILE, lambda file: file.write_text(as_toml(chosen), encoding="utf-8"))
    rows = _fresh(both, out / "fresh", options, watcher)
    demand_apart(found.seed, study.seed, found.streams.values(), rows["stream"].dropna())
    return Tuning(chosen, history(found.tuned), gains(rows, found.tuned, objective), rows, labels, record)


class _Found(NamedTuple):
    """What the search found."""

    asked: ResolvedStudy
    tuned: list[Tuned]
    seed: int  # of the training streams
    streams: dict[Item, str]  # hashes of what it saw


def _searched(study: Study, out: Path, budget: int, objective: str, options: Options, watcher: Progress) -> _Found:
    """The races of all estimators, whose evaluations are kept in `out`."""
    hands = hired(options.jobs, None, options.isolate, watcher.say, keep=True)
    with hands as workers, _begun(out) as directory:
        asked = resolve_study(study, options.data, options.isolate)
        seed = derived_seed(study.seed, "training")
        own = lanes(asked.cells, study.training, options.data, options.isolate)
        training = asked._replace(study=study.model_copy(update={"seed": seed}), cells=())
        require_fit(asked._replace(study=training.study), options.isolate)
        scenarios = {one.label: one for lane in own.values() for one in lane.scenarios}
        counted = _Counted(watcher, budget * len(asked.estimators))
        evaluations = Evaluations(training, scenarios, directory, workers, counted, objective)
        competitors = _competitors(asked, own, options.isolate)
        finishes = search(competitors, budget, derived_seed(study.seed, "sampler"), evaluations.compute)
    tuned = [Tuned(one, finish) for one, finish in zip(competitors, finishes, strict=True)]
    return _Found(asked, tuned, seed, evaluations.streams)


def _fresh(both: Study, out: Path, how: Options, watcher: Progress) -> pd.DataFrame:
    return execute(both, out, data=how.data, jobs=how.jobs, check=how.check, isolate=how.isolate, progress=watcher)


def _demand(budget: int, objective: str) -> None:
    if not 1 <= budget <= MOST_BUDGET:
        raise BadInput(f"budget is {budget}; it must be at least 1 trial, and at most {MOST_BUDGET}")
    if objective not in OBJECTIVES:
        raise BadInput(f"there is no objective {objective!r}; {nearest(objective, list(OBJECTIVES))}")


@contextmanager
def _begun(out: Path) -> Iterator[RunDir]:
    """The run directory of the search, locked."""
    if out.exists() and not (out / "training").is_dir() and (not out.is_dir() or any(out.iterdir())):
        raise BadInput(f"{out} exists and is not the directory of a tuning; name another with --out")
    directory = RunDir(out / "training")
    with directory.locked():
        yield directory


def _competitors(asked: ResolvedStudy, own: dict[str, TrainingLane], isolate: bool) -> list[Competitor]:
    """The estimators that are on some scenario that can be trained on, in the study's order."""
    found = []
    for one in asked.estimators:
        labels = [cell.scenario.label for cell in asked.cells if one in cell.estimators]
        mine = [own[label] for label in labels if label in own]
        if mine:
            found.append(Competitor(space_of(one.label, isolate), mine))
    if not found:
        raise BadInput(f"study {asked.study.name!r} has no scenario that estimators may be tuned on: see its training")
    return found


def _record(study: Study, budget: int, objective: str, found: _Found) -> dict[str, Any]:
    """What a reader needs to repeat it, and to see that no reported stream was used."""
    return {
        "study": study.model_dump(mode="json"),
        "budget": budget,
        "objective": objective,
        "optuna": version("optuna"),
        "seed": study.seed,
        "training_seed": found.seed,
        "spent": {one.published: one.finish.spent for one in found.tuned},
        "spaces": {one.published: _space(one) for one in found.tuned},
        "streams": {f"{item.scenario}, trial {item.trial}": hashed for item, hashed in found.streams.items()},
    }


def _space(one: Tuned) -> dict[str, Any]:
    return {name: each._asdict() for name, each in one.competitor.space.parameters.items()}


class _Counted:
    """Passes on progress as one count for all steps of a search."""

    def __init__(self, watcher: Progress, total: int) -> None:
        self._watcher, self._total, self._done, self._begun = watcher, total, 0, False
        self.say, self.compiling = watcher.say, watcher.compiling

    def begin(self, trials: int, found: int) -> None:
        """The whole budget, once."""
        if not self._begun:
            self._watcher.begin(self._total, 0)
        self._begun = True

    def advance(self, what: str, trials: int, failed: int, share: float) -> None:
        """A part is done."""
        self._done += trials
        self._watcher.advance(what, trials, failed, min(1.0, self._done / self._total))

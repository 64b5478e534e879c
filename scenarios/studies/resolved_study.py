"""A study whose labels have been read: each label once, before anything runs."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from cooploc.estimators import configure
from cooploc.estimators.plugins.build import ConfiguredEstimator
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios import resolve, resolve_isolated
from cooploc.scenarios.remote import RemoteScenario
from cooploc.scenarios.resolved import ResolvedScenario
from cooploc.scenarios.studies.study import Study

MOST_TRIALS = 100_000_000  # of all scenarios and estimators together


class ResolvedCell(NamedTuple):
    """What a study does with one scenario."""

    experiment: str
    scenario: ResolvedScenario | RemoteScenario
    trials: Mapping[str, int]  # by the label of an estimator
    estimators: tuple[ConfiguredEstimator, ...]
    baseline: str  # the label of one of them

    @property
    def most(self) -> int:
        """Trials of the estimator that has most."""
        return max(self.trials.values())


class ResolvedStudy(NamedTuple):
    """Everything that is to run."""

    study: Study
    data: Path | None  # the directory of recordings
    cells: tuple[ResolvedCell, ...]

    @property
    def estimators(self) -> list[ConfiguredEstimator]:
        """All estimators, each once, in the order in which scenarios name them."""
        return list({one.label: one for cell in self.cells for one in cell.estimators}.values())

    def with_trials(self, counts: Mapping[tuple[str, str], int]) -> "ResolvedStudy":
        """The same with these numbers of trials, by the labels of scenario and estimator; none above its own."""
        cells = []
        for cell in self.cells:
            asked = {name: min(counts[cell.scenario.label, name], n) for name, n in cell.trials.items()}
            cells.append(cell._replace(trials=asked))
        return self._replace(cells=tuple(cells))


def resolve_study(study: Study, data: Path | None = None, isolate: bool = True) -> ResolvedStudy:
    """Read every label of a study; with `isolate`, scenarios that are not built in are imported elsewhere.

    Raises:
        BadInput: a label that cannot be read, a scenario or a parameter of one that does not exist, or a recording
            without `data`.

    """
    cells = study.cells()
    total = study.trials * sum(len(cell.estimators) for cell in cells)
    if total > MOST_TRIALS:
        raise BadInput(f"study {study.name!r} asks for {total} trials in all, and at most {MOST_TRIALS} are allowed")
    known = {label: configure(label) for label in dict.fromkeys(name for cell in cells for name in cell.estimators)}
    found = []
    for cell in cells:
        scenario = (resolve_isolated if isolate else resolve)(cell.scenario, data)
        estimators = tuple(known[label] for label in cell.estimators)
        trials = dict.fromkeys(cell.estimators, scenario.trials(study.trials))
        found.append(ResolvedCell(cell.experiment, scenario, trials, estimators, cell.baseline))
    return ResolvedStudy(study, data, tuple(found))

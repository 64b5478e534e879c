"""A study whose labels have been read: each label once, before anything runs."""

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
    trials: int
    estimators: tuple[ConfiguredEstimator, ...]
    baseline: str  # the label of one of them


class ResolvedStudy(NamedTuple):
    """Everything that is to run."""

    study: Study
    data: Path | None  # the directory of recordings
    cells: tuple[ResolvedCell, ...]

    @property
    def estimators(self) -> list[ConfiguredEstimator]:
        """All estimators, each once, in the order in which scenarios name them."""
        return list({one.label: one for cell in self.cells for one in cell.estimators}.values())


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
        found.append(ResolvedCell(cell.experiment, scenario, scenario.trials(study.trials), estimators, cell.baseline))
    return ResolvedStudy(study, data, tuple(found))

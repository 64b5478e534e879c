"""How much of a plan is done, learned from what its finished parts took."""

from collections import defaultdict
from collections.abc import Iterable
from math import isfinite

from cooploc.analysis.execution.task import MeasuredPart, Task
from cooploc.scenarios.remote import RemoteScenario
from cooploc.scenarios.scenario import ResolvedScenario

PART = 3000.0  # what a tick of a part costs however few its trials are, in the unit of `work`: numpy's cost per call


def work(scenario: ResolvedScenario | RemoteScenario, trials: int) -> float:
    """About how long one estimator takes for a part, relative to parts of other scenarios and numbers of trials.

    A tick of a robot alone costs as much as hearing some forty neighbours (reports/speed.md).
    """
    return float(scenario.ticks * (PART + trials * scenario.robots * (40 + scenario.robots)))


class Remaining:
    """The share of a plan's processor time that is spent; each estimator has a rate of its own, once it is known."""

    def __init__(self, tasks: Iterable[Task]) -> None:
        self._todo: dict[str, float] = defaultdict(float)  # work, by the estimator's label
        self._done: dict[str, float] = defaultdict(float)
        self._took: dict[str, float] = defaultdict(float)  # [s] of a processor
        for task in tasks:
            for estimator in task.estimators:
                self._todo[estimator.label] += work(task.scenario, len(task.trials))

    def share_after(self, part: MeasuredPart, scenario: ResolvedScenario | RemoteScenario) -> float:
        """Take note of a finished part of a scenario; the share that is done by now, from 0 to 1."""
        _, label, trials = part.piece
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

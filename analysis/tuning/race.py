"""A race between configurations of one estimator: all on the same streams, round by round; hopeless ones stop early.

A round is one training trial of every scenario. The configuration as published runs all rounds first; then small
batches of others enter at one round and go on to two, four and so on, unless their paired differences to the best so
far show that they are worse. One that survives all rounds is chosen where it is the best, and its paired differences to
the configuration as published show that it is better; so chance alone seldom moves an estimator. Every trial counts in
the budget, also those of configurations that were stopped; what is left at the end, too little for all rounds of one
more, stays unused.

Source: O. Maron, A. Moore, "The racing algorithm: model selection for lazy learners", AI Review 11, 1997; M. Birattari
et al., "A racing algorithm for configuring metaheuristics", GECCO 2002.
"""

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from scipy import stats

from cooploc.analysis.tuning.sampler import Sampler
from cooploc.estimators.interface import Array

BATCH = 4  # configurations that enter together at most, whatever the number of processes
SHARE = 6  # the configuration as published uses at most one in so many of the budget's trials
MOST_ROUNDS = 64
LEAST = 3  # differences that can show a configuration to be better or worse than another
SURE = 0.95  # of the one-sided interval that does


class Item(NamedTuple):
    """One training trial."""

    scenario: str
    trial: int


class Lane(Protocol):
    """The training trials that stand for one scenario."""

    def item(self, number: int) -> Item:
        """The trial of a round; recordings that are used up come again."""
        ...


Wanted = Mapping[str, Sequence[Item]]  # by a configuration's label
Scores = Mapping[tuple[str, Item], float]
Race = Generator[Wanted, Scores, "Finish"]


@dataclass
class Entrant:
    """A configuration and how it fared."""

    number: int
    label: str
    rounds: int = 0
    state: str = "running"  # then "finished", or "stopped" before all rounds
    spent: int = 0  # trials of the budget that were used when it ended
    best: bool = False  # whether it was the best of all until then
    scores: dict[Item, float] = field(default_factory=dict)

    def missing(self, lanes: Sequence[Lane], rounds: int) -> list[Item]:
        """The trials of these rounds that it has not run."""
        items = [lane.item(k) for k in range(rounds) for lane in lanes]
        return [item for item in dict.fromkeys(items) if item not in self.scores]

    def mean(self, lanes: Sequence[Lane], rounds: int) -> float:
        """Its mean score over these rounds; every scenario counts the same."""
        return float(np.mean([self.scores[lane.item(k)] for k in range(rounds) for lane in lanes]))


class Finish(NamedTuple):
    """How a race ended."""

    entrants: list[Entrant]  # the first is the configuration as published
    best: Entrant
    rounds: int
    spent: int


def full_rounds(budget: int, lanes: int) -> int:
    """The rounds that a configuration must survive; 0 where the budget does not suffice for one."""
    return 0 if budget < lanes else min(MOST_ROUNDS, max(1, budget // (SHARE * lanes)))


def race(lanes: Sequence[Lane], budget: int, sampler: Sampler) -> Race:
    """Yields the trials that are wanted, is sent their scores, returns the finish."""
    full = full_rounds(budget, len(lanes))
    published = Entrant(0, sampler.space.published.label)
    entrants, best, left = [published], published, budget
    left -= yield from _run([published], lanes, full)
    _end(published, "finished", budget - left, True)
    values = {key: one.default for key, one in sampler.space.parameters.items()}
    sampler.know(published.label, values)
    while batch := _entering(sampler, len(entrants), left // (full * len(lanes))):
        entrants += batch
        alive = list(batch)
        for rounds in _rungs(full):
            left -= yield from _run(alive, lanes, rounds)
            for one in [one for one in alive if shown_worse(one, best)]:
                alive.remove(one)
                _end(one, "stopped", budget - left, False)
        for one in alive:
            better = shown_worse(published, one) and one.mean(lanes, full) < best.mean(lanes, full)
            best = one if better else best
            _end(one, "finished", budget - left, better)
        for one in batch:
            sampler.tell(one.label, one.mean(lanes, one.rounds) - published.mean(lanes, one.rounds))
    return Finish(entrants, best, full, budget - left)


def shown_worse(one: Entrant, other: Entrant) -> bool:
    """Whether paired differences on the trials that both ran show `one` to be worse: a one-sided t interval above 0."""
    d: Array = np.array([score - other.scores[item] for item, score in one.scores.items() if item in other.scores])
    if len(d) < LEAST or not d.mean() > 0:
        return False
    return bool(d.mean() > stats.t.ppf(SURE, len(d) - 1) * d.std(ddof=1) / np.sqrt(len(d)))


def _run(entrants: Sequence[Entrant], lanes: Sequence[Lane], rounds: int) -> Generator[Wanted, Scores, int]:
    """Let them run up to so many rounds; returns the trials that this took."""
    wanted = {one.label: one.missing(lanes, rounds) for one in entrants}
    found = (yield wanted) if any(wanted.values()) else {}
    for one in entrants:
        one.scores |= {item: found[one.label, item] for item in wanted[one.label]}
        one.rounds = rounds
    return sum(map(len, wanted.values()))


def _rungs(full: int) -> list[int]:
    """1, 2, 4 and so on, and all rounds."""
    return [*(2**k for k in range(full.bit_length()) if 2**k < full), full]


def _entering(sampler: Sampler, known: int, affordable: int) -> list[Entrant]:
    """The next configurations, of which all may have to run all rounds."""
    labels = (sampler.propose() for _ in range(min(BATCH, affordable)))
    return [Entrant(known + i, label) for i, label in enumerate(label for label in labels if label)]


def _end(one: Entrant, state: str, spent: int, best: bool) -> None:
    one.state, one.spent, one.best = state, spent, best

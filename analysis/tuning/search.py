"""The races of all estimators, side by side: each has the same budget, the same streams and the same sampler's seed."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

from cooploc.analysis.tuning.race import Finish, Item, Lane, Race, Wanted, full_rounds, race
from cooploc.analysis.tuning.sampler import Sampler
from cooploc.analysis.tuning.space import Space
from cooploc.estimators.plugins.errors import BadInput

Compute = Callable[[Iterable[tuple[str, Item]]], Mapping[tuple[str, Item], float]]


class Competitor(NamedTuple):
    """An estimator of a study, and the scenarios that it is tuned on."""

    space: Space
    lanes: Sequence[Lane]


def search(competitors: Sequence[Competitor], budget: int, seed: int, compute: Compute) -> list[Finish]:
    """The finish of every competitor's race, in order.

    Raises:
        BadInput: the budget does not suffice for one trial of every scenario.

    """
    for one in competitors:
        if not full_rounds(budget, len(one.lanes)):
            raise BadInput(
                f"the budget is {budget} trials, and {one.space.published.label!r} is tuned on {len(one.lanes)} "
                f"scenarios: give at least --budget {len(one.lanes)}"
            )
    races = {i: race(one.lanes, budget, Sampler(one.space, seed)) for i, one in enumerate(competitors)}
    finished: dict[int, Finish] = {}
    wanted: dict[int, Wanted] = {}
    for i, begun in races.items():
        _advance(i, begun, None, wanted, finished)
    while wanted:
        scores = compute([(label, item) for asked in wanted.values() for label in asked for item in asked[label]])
        for i in list(wanted):
            _advance(i, races[i], scores, wanted, finished)
    return [finished[i] for i in range(len(competitors))]


def _advance(
    i: int,
    one: Race,
    scores: Mapping[tuple[str, Item], float] | None,
    wanted: dict[int, Wanted],
    finished: dict[int, Finish],
) -> None:
    """Take one race to the next trials that it wants, or to its finish."""
    try:
        wanted[i] = next(one) if scores is None else one.send(scores)
    except StopIteration as end:
        wanted.pop(i, None)
        finished[i] = end.value

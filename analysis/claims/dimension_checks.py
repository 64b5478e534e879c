"""What is wrong with the dimensions of a ledger, found before anything is judged by them."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from cooploc.analysis.claims import readings
from cooploc.analysis.claims.claim import Claim
from cooploc.analysis.claims.readings import Choice, Dimension, Dimensions
from cooploc.estimators import make, nearest, parse
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios import resolve


def refusal(dimensions: Dimensions, claims: Sequence[Claim]) -> str:
    """The first thing that is wrong, with its place; empty where all is well.

    Args:
        dimensions: of the ledger.
        claims: of the ledger, whose estimators and scenarios the dimensions are about.

    """
    estimators = list(dict.fromkeys(name for claim in claims for name in (*claim.of, *claim.than)))
    scenarios = list(dict.fromkeys(label for claim in claims for label in claim.scenarios))
    for name, dimension in dimensions.items():
        found = [*_settles(name, dimension, dimensions), *_about(dimension, estimators, scenarios)]
        found += [
            f"choice {choice!r}: {why}"
            for choice, one in dimension.choices.items()
            for why in (*_estimators(dimension, one, estimators), *_scenarios(dimension, one, scenarios))
        ]
        if found:
            return f"dimension {name!r}: {found[0]}"
    return _set_twice(dimensions)


def _settles(name: str, dimension: Dimension, dimensions: Dimensions) -> Iterator[str]:
    for choice, one in dimension.choices.items():
        for other in one.settles:
            if other == name:
                yield f"choice {choice!r}: it cannot settle its own dimension: leave it out of settles"
            elif other not in dimensions:
                yield f"choice {choice!r}: it settles {other!r}, not a dimension; {nearest(other, list(dimensions))}"


def _about(dimension: Dimension, estimators: Sequence[str], scenarios: Sequence[str]) -> Iterator[str]:
    known = list(dict.fromkeys([*(parse(e)[0] for e in estimators), *(_family(s) for s in scenarios)]))
    for name in dimension.only:
        if name not in known:
            yield f"only: the claims name no estimator or family of scenarios {name!r}; {nearest(name, known)}"


def _estimators(dimension: Dimension, choice: Choice, labels: Sequence[str]) -> Iterator[str]:
    """Parameters that no estimator has, and values that do not fit."""
    about = [label for label in labels if readings.concerns(dimension, parse(label)[0]) and _made(label) is not None]
    known = {key for label in about for key in readings.parameters(_made(label))}
    for key, value in choice.estimators.items():
        if about and key not in known:
            yield f"no estimator that it is about has a parameter {key!r}; {nearest(key, sorted(known))}"
        for label in about:
            if key in readings.parameters(_made(label)):
                yield from _refused(make, label, key, value)


def _scenarios(dimension: Dimension, choice: Choice, labels: Sequence[str]) -> Iterator[str]:
    """Parameters that a scenario does not have, and values that do not fit."""
    for label in labels if choice.scenarios else ():
        before, brace, rest = label.partition("{")
        one = before + rest.partition("..")[0] + rest.partition("}")[2] if brace else label
        if readings.concerns(dimension, _family(label)) and not [*_refused(resolve, one)]:
            for key, value in choice.scenarios.items():
                if key not in parse(label)[1]:
                    yield from _refused(resolve, one, key, value)


def _refused(what: Any, label: str, key: str = "", value: str = "") -> Iterator[str]:
    try:
        what(label, **({key: value} if key else {}))
    except BadInput as e:
        yield str(e)


def _made(label: str) -> Any:
    """An estimator; None where it is not installed, as of a plug-in on another machine."""
    return None if [*_refused(make, label)] else make(label)


def _set_twice(dimensions: Dimensions) -> str:
    """A parameter must not be set by two dimensions, for one of them would win unseen."""
    for kind in ("estimators", "scenarios"):
        keys = {name: {k for c in one.choices.values() for k in getattr(c, kind)} for name, one in dimensions.items()}
        for key, count in Counter(key for each in keys.values() for key in each).items():
            both = [name for name in keys if key in keys[name]]
            only = [dimensions[name].only for name in both]
            apart = all(only) and len({name for each in only for name in each}) == sum(map(len, only))
            if count > 1 and not apart:
                return f"dimensions {' and '.join(map(repr, both))} both set {key!r} of {kind}: leave it to one of them"
    return ""


def _family(label: str) -> str:
    return parse(label)[0].partition("/")[0]

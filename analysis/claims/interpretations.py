"""The readings that a vague paper allows: one choice in every dimension, applied to every method alike.

A dimension is a sentence of the paper that can be read in several ways; its first choice is that of the study's preset,
and one is marked as nearest to the paper's letter. A choice sets parameters of estimators, wherever an estimator has
them, or of the scenario. All combinations would be thousands, so a design is run: the preset, the letter, every choice
that differs from either in one dimension alone (main effects), and a covering array of strength two, in which every
pair of choices of any two dimensions stands in some reading.

Sources: S. Steegen, F. Tuerlinckx, A. Gelman, W. Vanpaemel, "Increasing transparency through a multiverse analysis",
Perspectives on Psychological Science 11(5), 2016; D. Cohen et al., "The AETG system: an approach to testing based on
combinatorial design", IEEE Trans. Software Engineering 23(7), 1997 (the greedy covering array).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from itertools import combinations, product
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Field, model_validator

from cooploc.analysis.claims.kinds import STRICT, Claim, Labels
from cooploc.estimators import make, nearest, parse
from cooploc.estimators.building import RENAMED
from cooploc.estimators.errors import BadInput
from cooploc.scenarios import resolve

CANDIDATES = 20  # rows that the greedy search tries before it takes one


class Choice(BaseModel):
    """One way to read a sentence: parameters that differ from the preset."""

    model_config = STRICT

    estimators: dict[str, str] = {}  # parameters of every estimator that has them
    scenarios: dict[str, str] = {}  # parameters of every scenario
    settles: Labels = ()  # dimensions that make no difference any more once this is chosen


class Dimension(BaseModel):
    """A sentence of the paper that can be read in several ways."""

    model_config = STRICT

    says: str  # the sentence, or what it leaves out
    choices: Annotated[dict[str, Choice], Field(min_length=2)]  # the first is the preset's and sets nothing
    letter: str  # the choice nearest to the sentence
    only: Labels = ()  # names of the estimators, or of the families of scenarios, that it is about; empty: all

    @model_validator(mode="after")
    def _has_both_ends(self) -> "Dimension":
        first = next(iter(self.choices))
        if self.letter not in self.choices:
            raise ValueError(f"letter is {self.letter!r}; it must be one of {', '.join(self.choices)}")
        if self.choices[first] != Choice():
            raise ValueError(f"{first!r} is its first choice, the preset's, and must set nothing: leave it empty")
        return self


Dimensions = Mapping[str, Dimension]
Interpretation = dict[str, str]  # dimension -> choice
Row = dict[int, int]  # the same by their numbers
Pair = tuple[tuple[int, int], tuple[int, int]]  # two choices: number of the dimension, number of the choice in it
Off = list[list[list[int]]]  # dimension, choice -> dimensions that it settles


# ---- the design


def preset(dimensions: Dimensions) -> Interpretation:
    """Return the first choice everywhere."""
    return {name: next(iter(one.choices)) for name, one in dimensions.items()}


def letter(dimensions: Dimensions) -> Interpretation:
    """Return the choice nearest to the paper's letter everywhere."""
    return canonical({name: one.letter for name, one in dimensions.items()}, dimensions)


def settled_by(reading: Interpretation, dimensions: Dimensions) -> set[str]:
    """Return the dimensions that make no difference because of what is chosen in others."""
    return {name for dimension, choice in reading.items() for name in dimensions[dimension].choices[choice].settles}


def canonical(reading: Interpretation, dimensions: Dimensions) -> Interpretation:
    """Return the reading with the preset's choice wherever the choice makes no difference."""
    without = settled_by(reading, dimensions)
    first = preset(dimensions)
    return {name: first[name] if name in without else choice for name, choice in reading.items()}


def design(dimensions: Dimensions, seed: int = 0) -> list[Interpretation]:
    """Return the readings that are run, each once: preset, letter, main effects around both, and a covering array."""
    ends = [preset(dimensions), letter(dimensions)]
    effects = [{**end, name: choice} for end in ends for name, one in dimensions.items() for choice in one.choices]
    rows = [canonical(row, dimensions) for row in (*ends, *effects, *covering(dimensions, seed))]
    return [dict(row) for row in dict.fromkeys(tuple(reading.items()) for reading in rows)]


def covering(dimensions: Dimensions, seed: int = 0) -> list[Interpretation]:
    """Return readings in which every possible pair of choices stands at least once; greedy, the same for a seed.

    A pair is impossible where one of the two choices settles the other's dimension.
    """
    names = list(dimensions)
    levels = [list(one.choices) for one in dimensions.values()]
    off = [[[names.index(n) for n in choice.settles] for choice in one.choices.values()] for one in dimensions.values()]
    rng = np.random.default_rng(seed)
    open_pairs = {
        ((a, x), (b, y))
        for a, b in combinations(range(len(names)), 2)
        for x, y in product(range(len(levels[a])), range(len(levels[b])))
        if b not in off[a][x] and a not in off[b][y]
    }
    rows: list[Interpretation] = []
    while open_pairs:
        first = min(open_pairs)
        presets = dict(enumerate([0] * len(names))) | dict(first)  # these settle nothing, so that the search ends
        tries = [presets, *(_fill_row(dict(first), levels, off, open_pairs, rng) for _ in range(CANDIDATES))]
        best = max(tries, key=lambda row: (first in _pairs(row, off), len(open_pairs & _pairs(row, off))))
        open_pairs -= _pairs(best, off)
        rows.append({name: each[best[k]] for k, (name, each) in enumerate(zip(names, levels, strict=True))})
    return rows


def _fill_row(row: Row, levels: list[list[str]], off: Off, open_pairs: set[Pair], rng: np.random.Generator) -> Row:
    """Return the row with a choice in every dimension, each the one that covers most open pairs with those before."""
    for k in rng.permutation([k for k in range(len(levels)) if k not in row]).tolist():
        tries = [{**row, k: x} for x in rng.permutation(len(levels[k])).tolist()]
        row = max(tries, key=lambda row: len(open_pairs & _pairs(row, off)))
    return row


def _pairs(row: Row, off: Off) -> set[Pair]:
    """Return the pairs of choices that stand in a row, without dimensions that others settle."""
    without = {name for k, x in row.items() for name in off[k][x]}
    return set(combinations(sorted((k, x) for k, x in row.items() if k not in without), 2))


# ---- labels under a reading


def estimator(label: str, reading: Interpretation, dimensions: Dimensions) -> str:
    """Return the label of an estimator under a reading; parameters that it lacks, or has already, are left out.

    Raises:
        BadInput: there is no such estimator, or the value does not fit.

    """
    name, options = parse(label)
    written = {RENAMED.get(key, key): value for key, value in options.items()}
    wanted = _parameters(reading, dimensions, name, "estimators")
    changed = {key: value for key, value in wanted if key not in written and _changes(label, key, value)}
    return _label(name, {**changed, **written}) if changed else label


def scenario(label: str, reading: Interpretation, dimensions: Dimensions) -> str:
    """Return the label of a scenario under a reading; what the label says already stays."""
    path, written = parse(label)
    wanted = dict(_parameters(reading, dimensions, _family(label), "scenarios"))
    return _label(path, {**wanted, **written})


@cache
def _changes(label: str, key: str, value: str) -> bool:
    """Return whether an estimator has a parameter, and another value of it."""
    before = make(label)
    return key in _parameter_names(before) and bool(make(label, **{key: value}) != before)


def _parameter_names(estimator: Any) -> list[str]:
    return [each.name for each in fields(estimator) if each.init] if is_dataclass(estimator) else []


def _label(path: str, options: Mapping[str, str]) -> str:
    return path + (f"[{','.join(f'{key}={options[key]}' for key in sorted(options))}]" if options else "")


def _parameters(reading: Interpretation, dimensions: Dimensions, name: str, of: str) -> Iterator[tuple[str, str]]:
    for dimension, choice in reading.items():
        if _concerns(dimensions[dimension], name):
            yield from getattr(dimensions[dimension].choices[choice], of).items()


def _concerns(dimension: Dimension, name: str) -> bool:
    """Return whether a dimension is about an estimator, or about a family of scenarios."""
    return not dimension.only or name in dimension.only


def _family(label: str) -> str:
    return parse(label)[0].partition("/")[0]


# ---- what is wrong with the dimensions of a ledger


def find_error(dimensions: Dimensions, claims: Sequence[Claim]) -> str:
    """Return the first thing that is wrong with the dimensions of a ledger, with its place; empty where all is well.

    Args:
        dimensions: of the ledger.
        claims: of the ledger, whose estimators and scenarios the dimensions are about.

    """
    estimators = list(dict.fromkeys(name for claim in claims for name in (*claim.of, *claim.than)))
    scenarios = list(dict.fromkeys(label for claim in claims for label in claim.scenarios))
    known = list(dict.fromkeys([*(parse(e)[0] for e in estimators), *(_family(s) for s in scenarios)]))
    for name, one in dimensions.items():
        for missing in [each for each in one.only if each not in known]:
            about = f"only: the claims name no estimator or family of scenarios {missing!r}"
            return f"dimension {name!r}: {about}; {nearest(missing, known)}"
        for label, choice in one.choices.items():
            settled = (_settling_error(name, other, dimensions) for other in choice.settles)
            wrong = filter(None, (*settled, *_value_errors(one, choice, estimators, scenarios)))
            for why in wrong:
                return f"dimension {name!r}: choice {label!r}: {why}"
    for (a, left), (b, right) in combinations(dimensions.items(), 2):
        if not (left.only and right.only) or set(left.only) & set(right.only):
            for kind in ("estimators", "scenarios"):
                first, second = ({key for c in d.choices.values() for key in getattr(c, kind)} for d in (left, right))
                for key in sorted(first & second):  # one of the two would win unseen
                    return f"dimensions {a!r} and {b!r} both set {key!r} of {kind}: leave it to one of them"
    return ""


def _settling_error(name: str, other: str, dimensions: Dimensions) -> str:
    if other == name:
        return "it cannot settle its own dimension: leave it out of settles"
    return "" if other in dimensions else f"it settles {other!r}, not a dimension; {nearest(other, list(dimensions))}"


def _value_errors(
    dimension: Dimension, choice: Choice, estimators: Sequence[str], scenarios: Sequence[str]
) -> Iterator[str]:
    """Yield parameters that no estimator has, and values that do not fit an estimator or a scenario."""
    about = [label for label in estimators if _concerns(dimension, parse(label)[0]) and not _refusal(make, label)]
    names = {label: _parameter_names(make(label)) for label in about}  # without plug-ins of another machine
    known = sorted({key for each in names.values() for key in each})
    for key, value in choice.estimators.items():
        if about and key not in known:
            yield f"no estimator that it is about has a parameter {key!r}; {nearest(key, known)}"
        yield from (_refusal(make, label, **{key: value}) for label in about if key in names[label])
    for label in scenarios if choice.scenarios else ():
        before, brace, rest = label.partition("{")
        one = before + rest.partition("..")[0] + rest.partition("}")[2] if brace else label
        if _concerns(dimension, _family(label)) and not _refusal(resolve, one):
            stated = parse(label)[1]
            yield from (_refusal(resolve, one, **{k: v}) for k, v in choice.scenarios.items() if k not in stated)


def _refusal(build: Callable[..., Any], label: str, **options: str) -> str:
    """Return why a label cannot be built; empty where it can."""
    try:
        build(label, **options)
    except BadInput as e:
        return str(e)
    return ""

"""The interpretations that a vague paper allows: one choice in every dimension, applied to every method alike.

A dimension is a sentence of the paper that can be read in several ways. Of all combinations a design is run: preset
(all first choices), the paper's letter, every choice that differs from either in one dimension alone, a covering
array of strength two, in which every pair of choices of any two dimensions stands, and what public code does.

Sources: S. Steegen, F. Tuerlinckx, A. Gelman, W. Vanpaemel, "Increasing transparency through a multiverse analysis",
Perspectives on Psychological Science 11(5), 2016; D. Cohen et al., "The AETG system: an approach to testing based on
combinatorial design", IEEE Trans. Software Engineering 23(7), 1997 (the greedy covering array).
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from itertools import combinations, product
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from cooploc.analysis.claims.kinds import Claim, Labels, LedgerTable
from cooploc.estimators import make, nearest, parse
from cooploc.estimators.building import RENAMED
from cooploc.estimators.errors import BadInput
from cooploc.estimators.label_syntax import write_label

CANDIDATES = 20  # rows that the greedy search tries before it takes one


class Choice(LedgerTable):
    """Parameters that differ from the preset, for a way to read a sentence."""

    estimators: Mapping[str, str] = {}  # parameters of every estimator that has them
    scenarios: Mapping[str, str] = {}  # parameters of every scenario
    settles: Labels = ()  # dimensions that make no difference any more once this is chosen
    of_code: bool = False  # what no sentence says, and public code does: run in the reading `code` alone


class Dimension(LedgerTable):
    """A sentence of the paper that can be read in several ways."""

    says: str  # the sentence, or what it leaves out
    choices: Annotated[dict[str, Choice], Field(min_length=2)]  # the first is the preset's and sets nothing
    letter: str  # the choice nearest to the sentence
    code: str = ""  # the choice of public code of the same authors; empty where it settles nothing
    only: Labels = ()  # names of the estimators, or of the families of scenarios, that it is about; empty: all

    @model_validator(mode="after")
    def _has_both_ends(self) -> "Dimension":
        first = next(iter(self.choices))
        for end, choice in (("letter", self.letter), ("code", self.code or first)):
            if choice not in self.choices:
                raise ValueError(f"{end} is {choice!r}; it must be one of {', '.join(self.choices)}")
        if self.choices[first] != Choice():
            raise ValueError(f"{first!r} is its first choice, the preset's, and must set nothing: leave it empty")
        return self

    @property
    def of_paper(self) -> list[str]:
        """The choices that the sentence allows."""
        return [name for name, choice in self.choices.items() if not choice.of_code]


Dimensions = Mapping[str, Dimension]
Interpretation = dict[str, str]  # dimension -> choice
Pair = tuple[tuple[int, int], tuple[int, int]]  # two choices: number of the dimension, number of the choice in it


# ---- the design


def preset(dimensions: Dimensions) -> Interpretation:
    """Return the first choice everywhere."""
    return {name: next(iter(one.choices)) for name, one in dimensions.items()}


def letter(dimensions: Dimensions) -> Interpretation:
    """Return the choice nearest to the paper's letter everywhere."""
    return canonical({name: one.letter for name, one in dimensions.items()}, dimensions)


def code(dimensions: Dimensions) -> Interpretation:
    """Return the choice of public code wherever it settles one, else the preset's."""
    named = {name: one.code for name, one in dimensions.items() if one.code}
    return canonical({**preset(dimensions), **named}, dimensions)


def find_settled(reading: Interpretation, dimensions: Dimensions) -> set[str]:
    """Return the dimensions that make no difference because of what is chosen in others."""
    return {name for dimension, choice in reading.items() for name in dimensions[dimension].choices[choice].settles}


def canonical(reading: Interpretation, dimensions: Dimensions) -> Interpretation:
    """Return the interpretation with the preset's choice wherever the choice makes no difference."""
    settled, first = find_settled(reading, dimensions), preset(dimensions)
    return {name: first[name] if name in settled else choice for name, choice in reading.items()}


def design(dimensions: Dimensions, seed: int = 0) -> list[Interpretation]:
    """Return the interpretations that are run: preset, letter, main effects, a covering array, and public code's."""
    ends = [preset(dimensions), letter(dimensions)]
    effects = [{**end, name: choice} for end in ends for name, one in dimensions.items() for choice in one.of_paper]
    rows = [canonical(row, dimensions) for row in (*ends, *effects, *cover_pairs(dimensions, seed), code(dimensions))]
    return [dict(row) for row in dict.fromkeys(tuple(reading.items()) for reading in rows)]


def cover_pairs(dimensions: Dimensions, seed: int = 0) -> list[Interpretation]:
    """Return interpretations in which every possible pair of choices stands at least once; greedy.

    A pair is impossible where one of the two choices settles the other's dimension.
    """
    names = list(dimensions)
    levels = [one.of_paper for one in dimensions.values()]
    off = [[[names.index(n) for n in one.choices[x].settles] for x in one.of_paper] for one in dimensions.values()]
    rng = np.random.default_rng(seed)
    open_pairs = {
        ((a, x), (b, y))
        for a, b in combinations(range(len(names)), 2)
        for x, y in product(range(len(levels[a])), range(len(levels[b])))
        if b not in off[a][x] and a not in off[b][y]
    }

    def pairs(row: dict[int, int]) -> set[Pair]:
        """Return the pairs of choices that stand in a row, without dimensions that others settle."""
        without = {name for k, x in row.items() for name in off[k][x]}
        return set(combinations(sorted((k, x) for k, x in row.items() if k not in without), 2))

    def fill(row: dict[int, int]) -> dict[int, int]:
        """Add a choice in every dimension, each the one that covers most open pairs with those before."""
        for k in rng.permutation([k for k in range(len(levels)) if k not in row]).tolist():
            tries = [{**row, k: x} for x in rng.permutation(len(levels[k])).tolist()]
            row = max(tries, key=lambda row: len(open_pairs & pairs(row)))
        return row

    rows: list[Interpretation] = []
    while open_pairs:
        first = min(open_pairs)
        presets = dict(enumerate([0] * len(names))) | dict(first)  # these settle nothing, so that the search ends
        tries = [presets, *(fill(dict(first)) for _ in range(CANDIDATES))]
        best = max(tries, key=lambda row: (first in pairs(row), len(open_pairs & pairs(row))))
        open_pairs -= pairs(best)
        rows.append({name: each[best[k]] for k, (name, each) in enumerate(zip(names, levels, strict=True))})
    return rows


# ---- labels under an interpretation


def estimator(label: str, reading: Interpretation, dimensions: Dimensions) -> str:
    """Return the label of an estimator under an interpretation; parameters that it lacks, or has already, stay out."""
    name, options = parse(label)
    written = {RENAMED.get(key, key): value for key, value in options.items()}
    wanted = _parameters(reading, dimensions, name, "estimators")
    changed = {key: value for key, value in wanted.items() if key not in written and _changes(label, key, value)}
    return write_label(name, dict(sorted({**changed, **written}.items()))) if changed else label


def scenario(label: str, reading: Interpretation, dimensions: Dimensions) -> str:
    """Return the label of a scenario under an interpretation; what the label says already stays."""
    path, written = parse(label)
    wanted = _parameters(reading, dimensions, path.partition("/")[0], "scenarios")
    return write_label(path, dict(sorted((wanted | written).items())))


@cache
def _changes(label: str, key: str, value: str) -> bool:
    """Return whether an estimator has a parameter, and another value of it."""
    return key in _parameter_names(label) and bool(make(label, **{key: value}) != make(label))


@cache
def _parameter_names(label: str) -> list[str]:
    """Return the parameters of an estimator; none of one that is not on this machine."""
    try:
        made: Any = make(label)
    except BadInput:
        return []
    return [each.name for each in fields(made) if each.init] if is_dataclass(made) else []


def _parameters(reading: Interpretation, dimensions: Dimensions, name: str, of: str) -> dict[str, str]:
    """Return the parameters that choices set, `of` "estimators" or "scenarios", for one name or family."""
    chosen = [(dimensions[dimension], choice) for dimension, choice in reading.items()]
    parts = [getattr(one.choices[choice], of) for one, choice in chosen if not one.only or name in one.only]
    return {key: value for part in parts for key, value in part.items()}


def find_error(dimensions: Dimensions, claims: Sequence[Claim]) -> str:
    """Return the first name in a ledger's dimensions that means nothing, with its place; empty where all is well.

    A value that does not fit its parameter is refused where it is first used.
    """
    labels = {name for claim in claims for name in (*claim.of, *claim.than)}
    names = {parse(label)[0].partition("/")[0] for claim in claims for label in (*labels, *claim.scenarios)}
    parameters = {key for label in labels for key in _parameter_names(label)}
    for name, one in dimensions.items():
        for choice, sets in one.choices.items():
            others = set(dimensions) - {name}
            for used, known in ((one.only, names), (sets.settles, others), (sets.estimators, parameters)):
                for unknown in set(used) - known:
                    near = nearest(unknown, sorted(known))
                    return f"dimension {name!r}: choice {choice!r}: nothing here is called {unknown!r}; {near}"
    return ""

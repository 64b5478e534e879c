"""One claim of a paper, as a ledger states it, and the questions that it comes down to."""

from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

Labels = Annotated[tuple[str, ...], BeforeValidator(lambda given: (given,) if isinstance(given, str) else given)]
STRICT = ConfigDict(frozen=True, extra="forbid")


class Claim(BaseModel):
    """One claim; `kinds.KINDS` says which keys its kind takes."""

    model_config = STRICT

    id: str
    says: str  # in our words
    where: str = ""  # in the paper
    quote: str = ""  # the paper's own words
    kind: str
    of: Labels = ()  # estimators the claim is about
    than: Labels = ()  # estimators they are compared with
    scenarios: Labels = ()
    size: float | None = None  # of a change: -0.66 is 66 % less, 0.5 is 50 % more; of a level [m]; of a slope
    margin: Annotated[float, Field(gt=0)] = 0.05  # the size is met up to this; what is the same lies within it
    # how a size of -0.66 can be read: as the change b/a - 1, or as the ratio a/b - 1; it is judged by the first
    definitions: Annotated[tuple[Literal["change", "ratio"], ...], Field(min_length=1)] = ("change", "ratio")
    open: tuple[str, ...] = ()  # conditions that the paper leaves open
    why: str = ""  # it cannot be tested


class Case(NamedTuple):
    """One question that a claim comes down to."""

    of: str
    than: tuple[str, ...]
    scenarios: tuple[str, ...]
    definition: str = ""  # of the size: change or ratio


def claimed(claim: Claim, definition: str) -> float:
    """The size of a claim; one that is a ratio, such as "66 % better" for a/b = 1.66, as the change b/a - 1."""
    size = np.nan if claim.size is None else claim.size
    return as_change(size) if definition == "ratio" else size


def as_change(ratio: float) -> float:
    """A change by `ratio` that is meant as the ratio a/b - 1, with its sign turned round, as b/a - 1."""
    return 1 / (1 - ratio) - 1

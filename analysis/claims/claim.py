"""One claim of a paper, as a ledger states it."""

from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

Labels = Annotated[tuple[str, ...], BeforeValidator(lambda given: (given,) if isinstance(given, str) else given)]
STRICT = ConfigDict(frozen=True, extra="forbid")


class Claim(BaseModel):
    """One claim; `kinds.KINDS` says which keys its kind takes."""

    model_config = STRICT

    id: str
    says: str  # in our words
    where: str = ""  # in the paper
    kind: str
    of: Labels = ()  # estimators the claim is about
    than: Labels = ()  # estimators they are compared with
    scenarios: Labels = ()
    size: float | None = None  # of a change: -0.66 is 66 % less, 0.5 is 50 % more; of a level [m]; of a slope
    margin: Annotated[float, Field(gt=0)] = 0.05  # the size is met up to this; what is the same lies within it
    definitions: tuple[Literal["change", "ratio"], ...] = ("change", "ratio")  # of a size of -0.66: b/a or a/b - 1
    open: tuple[str, ...] = ()  # conditions that the paper leaves open
    why: str = ""  # it cannot be tested

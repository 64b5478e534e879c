"""`decisions.json` of a run directory: what was decided at which look of a run until decided."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from pydantic import BaseModel, ConfigDict, Field, StrictStr

from cooploc.analysis.execution.atomic_file import replace
from cooploc.analysis.execution.schemas import FORMAT, Count, Newer, checked
from cooploc.analysis.metrics.sequential import looks
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.sealed import Damaged, seal

NAME = "decisions.json"
Number = Annotated[float, Field(strict=True)] | None


class Comparison(BaseModel):
    """One estimator with its scenario's baseline: `decisions.Decision`."""

    model_config = ConfigDict(extra="forbid")

    scenario: StrictStr
    estimator: StrictStr
    baseline: StrictStr
    verdict: StrictStr
    look: Count
    change: Number
    low: Number
    high: Number
    e: Number


class Judged(BaseModel):
    """One case of a claim: its row of the verdicts."""

    model_config = ConfigDict(extra="forbid")

    claim: StrictStr
    variant: StrictStr
    scenario: StrictStr
    of: StrictStr
    than: StrictStr
    verdict: StrictStr
    look: Count


class Decisions(BaseModel):
    """What a run until decided found at its last look."""

    model_config = ConfigDict(extra="forbid")

    format: Annotated[int, Field(strict=True, ge=FORMAT)]
    most: Count  # trials, of what stays open
    look: Count  # the last one
    going: list[tuple[StrictStr, StrictStr]]  # (scenario, estimator) that go on
    comparison: list[Comparison]
    claim: list[Judged] = []


def write_decisions(folder: Path, found: Mapping[str, Any]) -> None:
    """Replace the file with the fields of `Decisions`; nan is written as null."""
    text = json.dumps(seal({"format": FORMAT, **_plain(found)}), indent=1) + "\n"
    replace(folder / NAME, lambda file: file.write_text(text, encoding="utf-8"))


def read_decisions(folder: Path) -> dict[str, Any] | None:
    """What the file holds; None where the run was not one until decided.

    Raises:
        BadInput: it is not what was written.

    """
    file = folder / NAME
    if not file.is_file():
        return None
    try:
        return checked(file.read_bytes(), Decisions)
    except (Damaged, Newer) as e:
        remedy = "the command that began the run, with --until-decided, makes it again"
        raise BadInput(f"{file} is damaged: {e}; {remedy}") from None


def comparisons(decisions: Mapping[str, Any] | None) -> pd.DataFrame | None:
    """One row per comparison: the fields of `decisions.Decision`; None where there are none."""
    if decisions is None:
        return None
    return pd.DataFrame(decisions["comparison"], columns=list(Comparison.model_fields))


def looks_taken(decisions: Mapping[str, Any] | None) -> list[int]:
    """The looks of a run until decided, in trials; none of another."""
    return [n for n in looks(decisions["most"]) if n <= decisions["look"]] if decisions else []


def _plain(value: Any) -> Any:
    """With None for what is not finite, which JSON has no number for."""
    if isinstance(value, Mapping):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

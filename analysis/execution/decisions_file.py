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
from cooploc.estimators.plugins.errors import BadInput
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
    comparison: list[Comparison]
    claim: list[Judged] = []


def write_decisions(folder: Path, most: int, look: int, records: Mapping[str, list[dict[str, Any]]]) -> None:
    """Replace the file; nan is written as null."""
    plain = {of: [{key: _plain(value) for key, value in one.items()} for one in ones] for of, ones in records.items()}
    text = json.dumps(seal({"format": FORMAT, "most": most, "look": look, **plain}), indent=1) + "\n"
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


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value

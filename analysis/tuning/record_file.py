"""`tuning.json`: what a reader needs to repeat a tuning, with a checksum of itself and of the tables beside it."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, StrictStr

from cooploc.analysis.execution.atomic_file import replace
from cooploc.analysis.execution.schemas import FORMAT, Count, Digest, Newer, checked
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.sealed import Damaged, seal
from cooploc.scenarios.studies.study import Seed, Study

RECORD = "tuning.json"


class Record(BaseModel):
    """What was asked, with which seeds, and what was found."""

    model_config = ConfigDict(extra="forbid")

    format: Annotated[int, Field(strict=True, ge=FORMAT)]
    study: Study
    budget: Count
    objective: StrictStr
    optuna: StrictStr
    seed: Seed
    training_seed: Seed
    spent: dict[StrictStr, Count]  # training trials that each estimator used
    spaces: dict[StrictStr, dict[StrictStr, dict[StrictStr, Any]]]  # the parameters of each, with their bounds
    streams: dict[StrictStr, StrictStr]  # hashes of the streams that tuning used
    tuned: dict[StrictStr, StrictStr]  # the tuned label of every label of the study
    tables: dict[StrictStr, Digest]  # of each file that was written beside it; none before the comparison ended


def write_record(folder: Path, found: Mapping[str, Any], tables: Mapping[str, str] | None = None) -> None:
    """Write the tables, by file name, then the record that vouches for them; each file is whole or not there."""
    texts = tables or {}
    for name, text in texts.items():
        _write(folder / name, text)
    digests = {name: _digest(text.encode()) for name, text in texts.items()}
    _write(folder / RECORD, json.dumps(seal({"format": FORMAT, **found, "tables": digests}), indent=1) + "\n")


def read_record(folder: Path, tables: tuple[str, ...]) -> tuple[dict[str, Any], dict[str, str]]:
    """The record, and the tables' texts by file name.

    Raises:
        BadInput: the tuning has not finished, or a file is not what was written.

    """
    for name in (RECORD, *tables):
        if not (folder / name).is_file():
            raise _unfinished(folder)
    record = _record(folder / RECORD)
    if not set(tables) <= set(record["tables"]):
        raise _unfinished(folder)
    found = {}
    for name in tables:
        content = (folder / name).read_bytes()
        if _digest(content) != record["tables"][name]:
            raise _damaged(folder / name, f"it is not what {RECORD} vouches for")
        found[name] = content.decode()
    return {key: value for key, value in record.items() if key not in ("format", "tables")}, found


def _record(file: Path) -> dict[str, Any]:
    try:
        return checked(file.read_bytes(), Record)
    except (Damaged, Newer) as e:
        raise _damaged(file, str(e)) from None


def _damaged(file: Path, why: str) -> BadInput:
    return BadInput(f"{file} is damaged: {why}; the cooploc tune that wrote it writes it again")


def _unfinished(folder: Path) -> BadInput:
    return BadInput(f"{folder} holds no finished tuning: name the directory that cooploc tune wrote, or run it again")


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _write(file: Path, text: str) -> None:
    replace(file, lambda temporary: temporary.write_bytes(text.encode()))

"""What `run_study` and `run_until` take alike; `run_study` says what each option means."""

from collections.abc import Iterable
from pathlib import Path
from typing import TypedDict


class How(TypedDict, total=False):
    """Where and how a study runs."""

    seed: int | None
    estimators: str | Iterable[str] | None
    jobs: int
    scheduler: str | None
    data: str | Path | None
    out: str | Path | None
    check: bool
    retry_failed: bool
    isolate: bool
    strict: bool

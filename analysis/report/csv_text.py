"""CSV that a spreadsheet may open: no text in it is taken for a formula. Numbers stay numbers."""

import io
from collections.abc import Callable
from typing import Any

import pandas as pd

FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")  # what a cell begins with that a spreadsheet would compute


def csv_text(table: pd.DataFrame) -> str:
    """The table as CSV; a text that begins like a formula gets an apostrophe, which spreadsheets do not show."""
    return (
        table.apply(lambda column: _mapped(column, _cell))
        .rename(columns=_cell)
        .to_csv(index=False, lineterminator="\n")
    )


def read_csv_text(text: str) -> pd.DataFrame:
    """The table that `csv_text` wrote."""
    found = pd.read_csv(io.StringIO(text))
    return found.apply(lambda column: _mapped(column, _as_written)).rename(columns=_as_written)


def _mapped(column: "pd.Series[Any]", change: Callable[[Any], Any]) -> "pd.Series[Any]":
    return column if column.dtype.kind in "fiub" else column.map(change)


def _cell(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULA) else value


def _as_written(value: Any) -> Any:
    return value[1:] if isinstance(value, str) and value[:1] == "'" and value[1:].startswith(FORMULA) else value

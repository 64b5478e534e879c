"""CSV that a spreadsheet may open: no text in it is taken for a formula. Numbers stay numbers."""

from typing import Any

import pandas as pd

FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")  # what a cell begins with that a spreadsheet would compute


def csv_text(table: pd.DataFrame) -> str:
    """The table as CSV; a text that begins like a formula gets an apostrophe, which spreadsheets do not show."""
    return table.apply(_safe).rename(columns=_cell).to_csv(index=False, lineterminator="\n")


def _safe(column: "pd.Series[Any]") -> "pd.Series[Any]":
    return column if column.dtype.kind in "fiub" else column.map(_cell)


def _cell(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULA) else value

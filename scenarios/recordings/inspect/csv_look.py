"""A CSV file that nobody has described: its delimiter, its columns, and their values."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.text_files import parse_number, read_text

DELIMITERS = (",", ";", "\t", "|", " ")
ENDINGS = (".csv", ".txt", ".tsv")


class CsvLook(NamedTuple):
    """What a CSV file holds."""

    path: Path
    delimiter: str
    columns: Mapping[str, Array | tuple[str, ...]]  # numbers (rows,), nan where empty; else the fields as they are
    rows: int
    dropped: int  # lines with another number of fields than the header

    def numbers(self, column: str) -> Array:
        """A column's finite numbers, in order; none of a column of words."""
        values = self.columns[column]
        return np.empty(0) if isinstance(values, tuple) else values[np.isfinite(values)]


def look_at_csv(path: Path) -> CsvLook:
    """A CSV file whose first line names the columns; lines that are too short or too long are counted.

    Raises:
        BadInput: the file is not text, has no header, or no line of data.

    """
    text = read_text(path, "utf-8-sig")
    lines = [line for line in text.split("\n") if line.strip()]
    if not lines:
        raise BadInput(f"{path}: the file is empty; get it again")
    delimiter = max(DELIMITERS, key=lambda d: (_fields(lines[0], d) > 1, d != " ", _fields(lines[0], d)))
    try:
        table = [
            [field.strip() for field in row] for row in csv.reader(io.StringIO("\n".join(lines)), delimiter=delimiter)
        ]
    except csv.Error as e:
        raise BadInput(f"{path}: this is not CSV ({e}); correct it or get it again") from None
    head = [name.lstrip("#").strip() for name in table[0]]
    if all(np.isfinite(parse_number(field)) for field in head if field):
        raise BadInput(f"{path}, line 1: numbers where the names of the columns should be; add a line of names")
    if len(set(head)) < len(head):
        twice = next(name for name in head if head.count(name) > 1)
        raise BadInput(f"{path}, line 1: two columns are named {twice!r}; rename one")
    whole = [row for row in table[1:] if len(row) == len(head)]
    if not whole:
        raise BadInput(f"{path}: it has no line of data with {len(head)} fields as in line 1; get the file again")
    columns = {name: _values(fields) for name, fields in zip(head, zip(*whole, strict=True), strict=True)}
    return CsvLook(path, delimiter, columns, len(whole), len(table) - 1 - len(whole))


def _fields(line: str, delimiter: str) -> int:
    return len(next(csv.reader([line], delimiter=delimiter), []))


def _values(fields: tuple[str, ...]) -> Array | tuple[str, ...]:
    """Numbers where nine of ten fields that are not empty are numbers."""
    given = [field for field in fields if field]
    numbers = np.array([parse_number(field) if field else np.nan for field in fields])
    good = np.isfinite(numbers)
    if not given or good.sum() < 0.9 * len(given):
        return fields
    return np.where(good, numbers, np.nan)

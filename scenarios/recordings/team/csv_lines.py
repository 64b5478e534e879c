"""Columns of a CSV file, numbers and names; a last line that was cut off while it was written is left out."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Indices
from cooploc.scenarios.recordings.logs.csv_table import fields_of, find_column, parse_field
from cooploc.scenarios.recordings.text_tables import read_text


class Lines(NamedTuple):
    """Some columns of a file."""

    path: Path
    values: Array  # (m, k)  nan where a field is empty
    names: list[tuple[str, ...]]  # (m,)
    line: Indices  # (m,) from 1
    cut_off: str  # a sentence, where the last line was left out

    def at(self, row: int) -> str:
        """The place of a row, for an error."""
        return f"{self.path}, line {self.line[row]}"


def read_lines(path: Path, numbers: Sequence[str], names: Sequence[str], delimiter: str) -> Lines:
    """Columns by their names in the first line.

    A last line without an end is left out where it has fewer fields than the first, or ends inside one of `numbers`:
    nobody can say how many digits are missing.

    Raises:
        BadInput: a column is missing, a line has another number of fields, or a field is not a number.

    """
    text = read_text(path, "utf-8-sig")
    content = list(fields_of(path, text, delimiter))
    first, head = content.pop(0) if content else (1, [])
    of_numbers = [find_column(path, first, head, name) for name in numbers]
    of_names = [find_column(path, first, head, name) for name in names]
    cut_off = ""
    if content and not text.endswith("\n"):
        line, fields = content[-1]
        if len(fields) < len(head) or (len(fields) == len(head) and len(head) - 1 in of_numbers):
            cut_off = f"{path}, line {line}: the last line has no end and may be cut off; it was left out"
            content.pop()
    for line, fields in content:
        if len(fields) != len(head):
            raise BadInput(f"{path}, line {line}: {len(fields)} fields, not {len(head)}; correct or remove the line")
    values = [[parse_field(path, line, head[i], fields[i]) for i in of_numbers] for line, fields in content]
    return Lines(
        path,
        np.array(values, float).reshape(-1, len(of_numbers)),
        [tuple(fields[i] for i in of_names) for _, fields in content],
        np.array([line for line, _ in content], np.int64),
        cut_off,
    )

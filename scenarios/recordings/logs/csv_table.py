"""Columns of a CSV file by name; every error names the line."""

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.text_tables import Table, parse_number, read_text


def read_csv(path: Path, columns: Sequence[str], delimiter: str) -> Table:
    """Some columns of a CSV file whose first line names them; an empty field is nan.

    Raises:
        BadInput: a column is missing, a line has another number of fields, or a field is not a number.

    """
    content = fields_of(path, read_text(path, "utf-8-sig"), delimiter)
    first, head = next(content, (1, []))
    where = [find_column(path, first, head, name) for name in columns]
    rows, lines = [], []
    for line, fields in content:
        if len(fields) != len(head):
            raise BadInput(f"{path}, line {line}: {len(fields)} fields, not {len(head)}; correct or remove the line")
        rows.append([parse_field(path, line, head[i], fields[i]) for i in where])
        lines.append(line)
    if len(rows) < 2:
        raise BadInput(f"{path}: it has {len(rows)} lines of data, at least two are needed; get the file again")
    return Table(path, np.array(rows), np.array(lines, np.int64))


def fields_of(path: Path, text: str, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """The lines that are not blank: number, and fields."""
    reader = csv.reader(io.StringIO(text), delimiter=delimiter, skipinitialspace=True)
    try:
        for raw in reader:
            fields = [field.strip() for field in raw]
            if any(fields):
                yield reader.line_num, fields
    except csv.Error as e:
        raise BadInput(f"{path}, line {reader.line_num}: this is not a CSV line ({e}); correct or remove it") from None


def find_column(path: Path, line: int, head: list[str], name: str) -> int:
    """Where a column is.

    Raises:
        BadInput: it is missing, or there are two.

    """
    if head.count(name) == 1:
        return head.index(name)
    if name in head:
        raise BadInput(f"{path}, line {line}: two columns are named {name!r}; rename one")
    known = nearest(name, head) if head else "the file is empty; get it again"
    raise BadInput(f"{path}, line {line}: there is no column {name!r}; {known}")


def parse_field(path: Path, line: int, name: str, field: str) -> float:
    """The number in a field, nan where it is empty.

    Raises:
        BadInput: it is not a number.

    """
    value = parse_number(field) if field else np.nan
    if np.isinf(value):
        raise BadInput(
            f"{path}, line {line}: {name} is {field!r}, which is not a number; correct it, or leave it empty"
        )
    return value

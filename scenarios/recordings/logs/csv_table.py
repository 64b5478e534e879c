"""Columns of a CSV file by name, every complaint with its line."""

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from cooploc.estimators import nearest
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.recordings.text_tables import Table


def read_csv(path: Path, columns: Sequence[str], delimiter: str) -> Table:
    """Some columns of a CSV file whose first line names them; an empty field is nan.

    Raises:
        BadInput: a column is not there, a line has another number of fields, or something is no number.

    """
    content = _fields(path, delimiter)
    first, head = next(content, (1, []))
    where = [_find(path, first, head, name) for name in columns]
    rows, lines = [], []
    for line, fields in content:
        if len(fields) != len(head):
            raise BadInput(f"{path}, line {line}: {len(fields)} fields, not {len(head)}; repair or remove the line")
        rows.append([_number(path, line, head[i], fields[i]) for i in where])
        lines.append(line)
    if len(rows) < 2:
        raise BadInput(f"{path}: lines of data are {len(rows)}, where two are the least; get the file again")
    return Table(path, np.array(rows), np.array(lines, np.int64))


def _fields(path: Path, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """The lines that are not blank: number, and fields."""
    reader = csv.reader(io.StringIO(_text(path)), delimiter=delimiter, skipinitialspace=True)
    try:
        for raw in reader:
            fields = [field.strip() for field in raw]
            if any(fields):
                yield reader.line_num, fields
    except csv.Error as e:
        raise BadInput(f"{path}, line {reader.line_num}: this is no CSV line ({e}); repair or remove it") from None


def _find(path: Path, line: int, head: list[str], name: str) -> int:
    if head.count(name) == 1:
        return head.index(name)
    if name in head:
        raise BadInput(f"{path}, line {line}: two columns are named {name!r}; rename one")
    known = nearest(name, head) if head else "the file is empty"
    raise BadInput(f"{path}, line {line}: there is no column {name!r}; {known}")


def _number(path: Path, line: int, name: str, field: str) -> float:
    try:
        value = float(field) if field else np.nan
    except ValueError:
        value = np.inf
    if np.isinf(value):
        raise BadInput(f"{path}, line {line}: {name} is {field!r}, no number; repair it, or leave it empty")
    return value


def _text(path: Path) -> str:
    try:
        raw = path.read_bytes()
    except OSError as e:
        raise BadInput(f"{path}: cannot be read ({e.strerror}); get the file again") from None
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as e:
        line = raw[: e.start].count(b"\n") + 1
        raise BadInput(f"{path}, line {line}: this is no UTF-8 text; save the file as UTF-8") from None
    if "\0" in text:
        raise BadInput(f"{path}, line {text[: text.index(chr(0))].count(chr(10)) + 1}: this is no text; get it again")
    return text.replace("\r\n", "\n").replace("\r", "\n")

"""Text files of recordings: CSV files, and tables of numbers separated by blanks. Every error names file and line."""

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Indices

LARGEST = 1e30  # of a number in a recording; stamps in ns have nineteen digits
MAX_STEP_BACK = 0.5  # [s] stamps that step back by less (MRCLAM 9: by 0.1 s) are sorted; by more, the file is refused


class Table(NamedTuple):
    """Some columns of a file, and the lines that they are on."""

    path: Path
    values: Array  # (m, k)  numbers; nan where a field of a CSV file is empty
    line: Indices  # (m,) from 1
    names: Sequence[tuple[str, ...]] = ()  # (m,) columns of text
    notes: tuple[str, ...] = ()  # what was left out, a sentence each

    def at(self, row: int) -> str:
        """The place of a row, for an error."""
        return f"{self.path}, line {self.line[row]}"


def read_text(path: Path, encoding: str) -> str:
    r"""Return the text of a file, its line ends all \n.

    Raises:
        BadInput: the file cannot be read, or is not text in this encoding.

    """
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        raise BadInput(f"{path}: there is no such file; get the whole recording") from None
    except OSError as e:
        raise BadInput(f"{path}: cannot be read ({e.strerror}); get the file again") from None
    try:
        text, bad = raw.decode(encoding), raw.find(b"\0")
    except UnicodeDecodeError as e:
        text, bad = "", e.start
    if bad >= 0:
        line = raw[:bad].count(b"\n") + 1
        kind = "plain ASCII" if encoding == "ascii" else "UTF-8"
        raise BadInput(f"{path}, line {line}: this is not {kind} text; save the file as {kind}, or get it again")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parse_number(word: str) -> float:
    """Return a word as a number; inf where it is not a number, or is larger than anything that can be measured."""
    try:
        number = float(word)
    except ValueError:
        return np.inf
    return np.inf if abs(number) > LARGEST else number


def read_table(path: Path, columns: Sequence[str]) -> Table:
    """Read numbers separated by blanks, one for each of `columns` in a line; what follows a # is a comment.

    Raises:
        BadInput: the file cannot be read or has no numbers, or a line is not a finite number for each column.

    """
    lines = [line.partition("#")[0] for line in read_text(path, "ascii").split("\n")]
    rows = [(i, line) for i, line in enumerate(lines, 1) if line and not line.isspace()]
    if not rows:
        raise BadInput(f"{path}: the file is empty, it has no line of {', '.join(columns)}; get the file again")
    try:
        values = np.loadtxt([line for _, line in rows], ndmin=2)
    except ValueError as e:
        _refuse(path, rows, columns, str(e))
    if values.shape[1] != len(columns) or not (np.abs(values) <= LARGEST).all():
        _refuse(path, rows, columns, "a field is not a number")
    return Table(path, values, np.array([i for i, _ in rows], np.int64))


def sort_by_time(table: Table) -> tuple[Table, int]:
    """Return the table by rising stamps (column 0) [s], and how often they stepped back.

    Raises:
        BadInput: a stamp is more than `MAX_STEP_BACK` before an earlier one.

    """
    stamps = table.values[:, 0]
    order = time_order(stamps, table.at)
    return Table(table.path, table.values[order], table.line[order]), int((np.diff(stamps) < 0).sum())


def time_order(stamps: Array, where: Callable[[int], str]) -> Indices:
    """Return the order of rising stamps (m,) [s]; equal ones stay as they are. `where` gives the place of a row.

    Raises:
        BadInput: a stamp is more than `MAX_STEP_BACK` before an earlier one.

    """
    late = np.maximum.accumulate(stamps) - stamps if len(stamps) else stamps
    if (late > MAX_STEP_BACK).any():
        row = int(np.argmax(late > MAX_STEP_BACK))
        raise BadInput(f"{where(row)}: its time is {late[row]:.3f} s before an earlier line's; sort the file by time")
    return np.argsort(stamps, kind="stable")


def require_whole(table: Table, column: int, name: str) -> None:
    """Refuse a column with a number that is not whole.

    Raises:
        BadInput: names the first one.

    """
    bad = table.values[:, column] != np.rint(table.values[:, column])
    if bad.any():
        row = int(np.argmax(bad))
        raise BadInput(f"{table.at(row)}: {name} {table.values[row, column]:g} is not a whole number; correct the line")


def require_unique(table: Table, column: int, name: str) -> None:
    """Refuse a column with a number that is not whole, or is there twice.

    Raises:
        BadInput: names the first one.

    """
    require_whole(table, column, name)
    _, first = np.unique(table.values[:, column], return_index=True)
    again = np.setdiff1d(np.arange(len(table.values)), first)
    if len(again):
        row = int(again[0])
        raise BadInput(
            f"{table.at(row)}: {name} {table.values[row, column]:g} was given before; remove one of the lines"
        )


def _refuse(path: Path, rows: list[tuple[int, str]], columns: Sequence[str], reason: str) -> NoReturn:
    """Name the first line that is not a finite number for each column."""
    for i, line in rows:
        words = line.split()
        if len(words) != len(columns):
            raise BadInput(
                f"{path}, line {i}: {len(words)} columns, not {len(columns)} ({', '.join(columns)}); correct the line"
            ) from None
        for word, name in zip(words, columns, strict=True):
            if not np.isfinite(parse_number(word)):
                raise BadInput(
                    f"{path}, line {i}: {name} is {word!r}, which is not a number; correct or remove the line"
                ) from None
    raise BadInput(f"{path}: cannot be read as numbers ({reason}); get the file again") from None


# ---- CSV files, their columns by name


def read_lines(path: Path, numbers: Sequence[str], names: Sequence[str], delimiter: str) -> Table:
    """Read columns by their names in the first line, as numbers or as text.

    A last line without an end is left out where it has fewer fields than the first, or ends inside one of `numbers`,
    as digits may be missing.

    Raises:
        BadInput: a column is missing, a line has another number of fields, or a field is not a number.

    """
    text = read_text(path, "utf-8-sig")
    content = list(fields_of(path, text, delimiter))
    first, head = content.pop(0) if content else (1, [])
    of_numbers = [find_column(path, first, head, name) for name in numbers]
    of_names = [find_column(path, first, head, name) for name in names]
    notes = []
    if content and not text.endswith("\n"):
        line, fields = content[-1]
        if len(fields) < len(head) or (len(fields) == len(head) and len(head) - 1 in of_numbers):
            notes.append(f"{path}, line {line}: the last line has no end and may be cut off; it was left out")
            content.pop()
    for line, fields in content:
        if len(fields) != len(head):
            raise BadInput(f"{path}, line {line}: {len(fields)} fields, not {len(head)}; correct or remove the line")
    values = [[parse_field(path, line, head[i], fields[i]) for i in of_numbers] for line, fields in content]
    rows = np.array(values, float).reshape(-1, len(of_numbers))
    texts = [tuple(fields[i] for i in of_names) for _, fields in content]
    return Table(path, rows, np.array([line for line, _ in content], np.int64), texts, tuple(notes))


def fields_of(path: Path, text: str, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the lines that are not blank: number, and fields."""
    reader = csv.reader(io.StringIO(text), delimiter=delimiter, skipinitialspace=True)
    try:
        for raw in reader:
            fields = [field.strip() for field in raw]
            if any(fields):
                yield reader.line_num, fields
    except csv.Error as e:
        raise BadInput(f"{path}, line {reader.line_num}: this is not a CSV line ({e}); correct or remove it") from None


def find_column(path: Path, line: int, head: list[str], name: str) -> int:
    """Return the index of a column.

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
    """Return the number in a field, nan where it is empty.

    Raises:
        BadInput: it is not a number.

    """
    value = parse_number(field) if field else np.nan
    if np.isinf(value):
        raise BadInput(
            f"{path}, line {line}: {name} is {field!r}, which is not a number; correct it, or leave it empty"
        )
    return value

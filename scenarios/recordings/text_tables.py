"""Reading recordings: text files, and tables of numbers separated by blanks.

A recording comes from someone else, so every error names the file, the line and the remedy. numpy parses; only a file
that numpy refuses is searched line by line.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Indices

LARGEST = 1e30  # of a number in a recording; stamps in ns have nineteen digits
MAX_STEP_BACK = 0.5  # [s] stamps that step back by less (MRCLAM 9: by 0.1 s) are sorted; by more, the file is refused


class Table(NamedTuple):
    """A file's numbers, and the lines that they are on."""

    path: Path
    values: Array  # (rows, columns)
    line: Indices  # (rows,) from 1

    def at(self, row: int) -> str:
        """The place of a row, for an error."""
        return f"{self.path}, line {self.line[row]}"


def read_text(path: Path, encoding: str) -> str:
    r"""A text file, its line ends all \n.

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
    """A word as a number; inf where it is not a number, or is larger than anything that can be measured."""
    try:
        number = float(word)
    except ValueError:
        return np.inf
    return np.inf if abs(number) > LARGEST else number


def read_table(path: Path, columns: Sequence[str]) -> Table:
    """Numbers separated by blanks, one for each of `columns` in a line; what follows a # is a comment.

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
    """The table by rising stamps (column 0) [s], and how often they stepped back.

    Raises:
        BadInput: a stamp is more than `MAX_STEP_BACK` before an earlier one.

    """
    stamps = table.values[:, 0]
    late = np.maximum.accumulate(stamps) - stamps
    if (late > MAX_STEP_BACK).any():
        row = int(np.argmax(late > MAX_STEP_BACK))
        raise BadInput(
            f"{table.at(row)}: its time is {late[row]:.3f} s before an earlier line's; sort the file by time"
        )
    order = np.argsort(stamps, kind="stable")
    return Table(table.path, table.values[order], table.line[order]), int((np.diff(stamps) < 0).sum())


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

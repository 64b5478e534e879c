"""Reading recordings: tables of numbers in text files, and how their stamps get onto a grid of ticks.

A recording is someone else's, so every complaint names the file, the line and what to do. Parsing is numpy's; only a
file that numpy refuses is searched line by line.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from cooploc.estimators.interface import Array, Indices
from cooploc.estimators.plugins.errors import BadInput

BACK = 0.5  # [s] a clock that is set back by less (MRCLAM 9, by 0.1 s) is put in order; by more, the file is refused


class Table(NamedTuple):
    """A file's numbers, and where they stand in it."""

    path: Path
    values: Array  # (rows, columns)
    line: Indices  # (rows,) from 1

    def at(self, row: int) -> str:
        """The place of a row, for an error."""
        return f"{self.path}, line {self.line[row]}"


def only_trial(label: str, trials: Sequence[int]) -> None:
    """Refuse any trial but 0."""
    if list(trials) != [0]:
        raise BadInput(f"scenario {label!r} is a recording and has one trial, 0, not {list(trials)}; ask for trials=1")


def read_table(path: Path, columns: Sequence[str]) -> Table:
    """Numbers between blanks, `columns` of them a line; what follows a # is a remark.

    Raises:
        BadInput: the file cannot be read, is empty, is no text, or a line is not `columns` finite numbers.

    """
    lines = _text(path).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    kept = [line.partition("#")[0] if "#" in line else line for line in lines]
    rows = [(i, line) for i, line in enumerate(kept, 1) if line and not line.isspace()]
    if not rows:
        raise BadInput(f"{path}: the file is empty, it has no line of {', '.join(columns)}; get the file again")
    try:
        values = np.loadtxt([line for _, line in rows], ndmin=2)
    except ValueError as e:
        _refuse(path, rows, columns, str(e))
    if values.shape[1] != len(columns) or not np.isfinite(values).all():
        _refuse(path, rows, columns, "something is not a number")
    return Table(path, values, np.array([i for i, _ in rows], np.int64))


def in_order(table: Table) -> tuple[Table, int]:
    """The table by rising stamps (column 0), and how often its clock was set back.

    Raises:
        BadInput: a stamp is more than `BACK` before an earlier one.

    """
    stamps = table.values[:, 0]
    late = np.maximum.accumulate(stamps) - stamps
    if (late > BACK).any():
        row = int(np.argmax(late > BACK))
        raise BadInput(
            f"{table.at(row)}: its time is {late[row]:.3f} s before an earlier line's; sort the file by time"
        )
    order = np.argsort(stamps, kind="stable")
    return Table(table.path, table.values[order], table.line[order]), int((np.diff(stamps) < 0).sum())


def demand_whole(table: Table, column: int, name: str) -> None:
    """Refuse a number that is not whole."""
    bad = table.values[:, column] != np.rint(table.values[:, column])
    if bad.any():
        row = int(np.argmax(bad))
        raise BadInput(f"{table.at(row)}: {name} {table.values[row, column]:g} is not a whole number; repair the line")


def demand_keys(table: Table, column: int, name: str) -> None:
    """Refuse a number that is not whole, or stands twice."""
    demand_whole(table, column, name)
    _, first = np.unique(table.values[:, column], return_index=True)
    again = np.setdiff1d(np.arange(len(table.values)), first)
    if len(again):
        row = int(again[0])
        raise BadInput(
            f"{table.at(row)}: {name} {table.values[row, column]:g} was given before; remove one of the lines"
        )


def interpolated(stamps: Array, values: Array, at: Array, max_gap: float) -> Array:
    """Values (len(at), k) on the line between the stamps around; nan outside, and in holes longer than `max_gap`."""
    after = np.searchsorted(stamps, at)
    inside = (after < len(stamps)) & (at >= stamps[0])
    after = np.minimum(after, len(stamps) - 1)
    hole = stamps[after] - stamps[np.maximum(after - 1, 0)]
    known = inside & ((hole <= max_gap) | (stamps[after] == at))
    line = np.stack([np.interp(at, stamps, column) for column in values.T], -1)
    return np.where(known[:, None], line, np.nan)


def held_mean(stamps: Array, values: Array, edges: Array) -> Array:
    """Means (len(edges) - 1, k) between the edges of values (len(stamps), k) that hold until the next stamp.

    nan where an interval begins before the first stamp or after the last: nobody knows what held there.
    """
    knots = np.append(stamps, max(stamps[-1], edges[-1]))
    integral = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values * np.diff(knots)[:, None]]), axis=0)
    at_edges = np.stack([np.interp(edges, knots, column) for column in integral.T], -1)
    known = (edges[:-1] >= stamps[0]) & (edges[:-1] <= stamps[-1])
    return np.where(known[:, None], np.diff(at_edges, axis=0) / np.diff(edges)[:, None], np.nan)


def _text(path: Path) -> str:
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        raise BadInput(f"{path}: there is no such file; get the whole recording") from None
    except OSError as e:
        raise BadInput(f"{path}: cannot be read ({e.strerror}); get the file again") from None
    for i, line in enumerate(raw.split(b"\n"), 1) if not raw.isascii() or b"\0" in raw else ():
        if not line.isascii() or b"\0" in line:
            raise BadInput(f"{path}, line {i}: this is no plain text; get the file again")
    return raw.decode("ascii")


def _refuse(path: Path, rows: list[tuple[int, str]], columns: Sequence[str], reason: str) -> NoReturn:
    """Name the first line that is not `columns` finite numbers."""
    for i, line in rows:
        words = line.split()
        if len(words) != len(columns):
            raise BadInput(
                f"{path}, line {i}: {len(words)} columns, not {len(columns)} ({', '.join(columns)}); repair the line"
            ) from None
        for word, name in zip(words, columns, strict=True):
            if not _finite(word):
                raise BadInput(f"{path}, line {i}: {name} is {word!r}, no number; repair or remove the line") from None
    raise BadInput(f"{path}: cannot be read as numbers ({reason}); get the file again") from None


def _finite(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False

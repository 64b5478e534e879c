"""Text files of recordings: CSV files, and tables of numbers separated by blanks.

Lines that cannot be read are left out, and a sentence names the first of them; where less than a tenth is left the file
is refused, with file and line.
"""

import codecs
import csv
import io
import json
import os
import re
import statistics
import zlib
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from itertools import islice
from pathlib import Path
from reprlib import repr as short_repr
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import csv as arrow_csv

from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput, count_of
from cooploc.estimators.interface import Array, Indices
from cooploc.scenarios.recordings import motion_capture

TEXT_ENDINGS = (".csv", ".txt", ".tsv", ".dat", ".log", ".tum")  # and these with .gz
LARGEST = 1e30  # of a number in a recording; stamps in ns have nineteen digits
MAX_STEP_BACK = 0.5  # [s] stamps that step back by less (MRCLAM 9: by 0.1 s) are sorted; by more, lines are left out
MOST_ZEROS = 5  # places with zero bytes, such as an interrupted write leaves; a file with more is no text
LEAST_LEFT = 0.1  # share of the lines of a file that must be readable
RUN_WORDS = {"run", "trial", "test", "exp", "experiment", "seq", "sequence", "take", "session", "round", "rep", "day"}
RUN_COLUMNS = {"run", "trial", "experiment", "episode", "mc", "montecarlo", "realization", "realisation"}
COUNTS = {"id", "no", "nr", "number", "index", "idx"}  # words beside these
# In names of files: 2024-05-11-10-19-31, 20240511_101931, 11-05-2024 10h19, or seconds since 1970.
_DAY = r"(?:(?:19|20)\d\d[-_.]?[01]\d[-_.]?[0-3]\d|[0-3]\d[-_.][01]\d[-_.]20\d\d)"
_TIME = r"[-_T. ]*[0-2]\d[-_.:h]?[0-5]\d(?:[-_.:m]?[0-5]\d)?(?:[-_.]\d{3,9})?[sZ]?"
NAMED_DATE = re.compile(rf"(?<!\d)(?:{_DAY}(?:{_TIME})?|1[5-9]\d{{8}}(?:[-_.]?\d{{3,9}})?)(?![0-9A-Za-z])")


def read_json_lines(path: Path) -> pd.DataFrame:
    """Return a line for each object; of one that is none, such as a torn one, its text in the first column alone."""
    found: list[Any] = []
    for line in filter(str.strip, path.read_text("utf-8", errors="replace").splitlines()):
        with suppress(ValueError):
            found.append(line)
            found[-1] = json.loads(line)
    first = next(key for one in found if isinstance(one, dict) for key in one)
    return pd.json_normalize([one if isinstance(one, dict) else {first: one} for one in found])


def read_json(path: Path) -> pd.DataFrame:
    """Return a line for each object of an array, or of columns by name; either may be all that an object holds."""
    held = json.loads(path.read_text("utf-8"))
    while isinstance(held, dict) and len(held) == 1:
        held = next(iter(held.values()))
    if isinstance(held, list) and held and all(isinstance(one, dict) for one in held):
        return pd.json_normalize(held)
    if isinstance(held, dict) and all(isinstance(column, dict | list) for column in held.values()):
        return pd.DataFrame(held)
    raise ValueError


def table_of_echo(text: str) -> pd.DataFrame:
    """Return what `ros2 topic echo` or `rostopic echo` printed, a line for each whole message; lists are left out."""
    messages, fields, above = list[dict[str, str]](), dict[str, str](), list[tuple[int, str]]()
    for line in text.split("\n"):
        if line.startswith("---"):
            messages.append(fields)
            fields, above = {}, []
            continue
        key, _, value = line.strip().partition(":")
        depth = len(line) - len(line.lstrip())
        while above and above[-1][0] >= depth:
            above.pop()
        above.append((depth, key))
        if value.strip() and not any(name.startswith("-") for _, name in above):
            fields[".".join(name for _, name in above)] = value.strip(" '\"")
    return pd.DataFrame(messages)


# Other files, which are read as the CSV files that they could be.
OTHER_TABLES: Mapping[str, Callable[[Path], pd.DataFrame]] = {
    ".parquet": pd.read_parquet,
    ".jsonl": read_json_lines,
    ".json": read_json,
}


class TextTable(NamedTuple):
    """Some columns of a file, and the lines that they are on."""

    path: Path
    values: Array  # (m, k)  numbers; nan where a field of a CSV file is empty
    line: Indices  # (m,) from 1
    names: Sequence[tuple[str, ...]] = ()  # (m,) columns of text
    notes: tuple[str, ...] = ()  # what was left out, a sentence each

    def at(self, row: int) -> str:
        """The place of a row, for an error."""
        return f"{self.path}, line {self.line[row]}"


def are_called_runs(names: Iterable[str]) -> bool:
    """Return whether names of files or folders are words such as run1 and trial_2, or dates."""
    words = (re.sub("[^a-z]", "", name.lower()) for name in names if not NAMED_DATE.fullmatch(name))
    return {*words} <= RUN_WORDS


def files_below(folder: Path) -> list[Path]:
    """Return the files below a folder, sorted; also of links to other disks, but not of a study that was run here."""
    found, known = list[Path](), set[str]()
    for home, folders, names in os.walk(folder, followlinks=True):
        a_run = "manifest.json" in names and "parts" in folders
        if a_run or (real := os.path.realpath(home)) in known:  # a link may lead back
            folders.clear()
            continue
        known.add(real)
        found += [Path(home) / name for name in names]
    return sorted(found)


def is_text(path: Path) -> bool:
    """Return whether a file is a text by its name, compressed or not, or another table."""
    name = path.name.lower()
    return path.is_file() and (name.removesuffix(".gz").endswith(TEXT_ENDINGS) or name.endswith((*OTHER_TABLES,)))


def read_text(path: Path) -> str:
    r"""Return the text of a file, UTF-8, UTF-16 or of Windows, its line ends all \n; of a .gz file what is in it."""
    if of_table := OTHER_TABLES.get(path.suffix.lower()):
        try:
            table = of_table(path)
        except (ValueError, OSError, StopIteration, RecursionError) as e:  # brackets within brackets
            raise BadInput(f"{path}: this is no {path.suffix[1:]} file, or it is damaged; get the file again") from e
        return table.to_csv(index=table.index.names != [None])
    try:
        raw = path.read_bytes()
        if path.suffix.lower() == ".gz":
            packed, raw = raw, b""
            while packed:  # one that is cut off is read up to there; several may stand one after the other
                part = zlib.decompressobj(zlib.MAX_WBITS | 16)
                raw, packed = raw + part.decompress(packed), part.unused_data
    except FileNotFoundError:
        raise BadInput(f"{path}: there is no such file; get the whole recording") from None
    except OSError as e:
        raise BadInput(f"{path}: cannot be read ({e.strerror}); get the file again") from None
    except zlib.error:
        raise BadInput(f"{path}: this is no gzip file, or it is damaged; get the file again") from None
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raw = raw.decode("utf-16", "replace").encode()
    if b"\0" in raw:
        if len(re.findall(rb"\0+", raw)) > MOST_ZEROS:
            line = raw[: raw.index(b"\0")].count(b"\n") + 1
            raise BadInput(f"{path}, line {line}: this is not UTF-8 text; save the file as UTF-8, or get it again")
        raw = re.sub(rb"\0+", "\ufffd".encode(), raw)  # its line is left out as any other that cannot be read
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("cp1252", "ignore")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if "\n---\n" in text and re.match(r"\w+:", text):
        return table_of_echo(text).to_csv(index=False)
    poses = motion_capture.table_of(text)
    return text if poses is None else poses.to_csv(index=False)


def parse_number(word: str) -> float:
    """Return a word as a number; inf where it is not a number, or is larger than anything that can be measured."""
    try:
        number = float(word)
    except ValueError:
        return np.inf
    return np.inf if abs(number) > LARGEST else number


Fault = tuple[int, str]  # a line that cannot be read, from 1, and why: "17 fields, not 28"


def leave_out(path: Path, faults: Sequence[Fault], lines: int) -> tuple[str, ...]:
    """Return a sentence on the lines that are left out, if any, of so many; refuse a file with too few others."""
    if not faults:
        return ()
    (line, why), more = faults[0], len(faults) - 1
    if len(faults) > (1 - LEAST_LEFT) * lines:
        many = f"{len(faults)} of {lines} lines are like it" if more else "it has no other line"
        raise BadInput(f"{path}, line {line}: {why}; {many}: correct them, or get the file again")
    others = f", and {count_of(more, 'other line')} with it" if more else ""
    return (f"{path}, line {line}: {why}; it was left out{others}",)


def read_table(path: Path, columns: Sequence[str], strict: bool = False) -> TextTable:
    """Read numbers separated by blanks, one for each of `columns` in a line; what follows a # is a comment."""
    lines = [line.partition("#")[0] for line in read_text(path).split("\n")]
    rows = [(i, line) for i, line in enumerate(lines, 1) if line and not line.isspace()]
    if not rows:
        raise BadInput(f"{path}: the file is empty, it has no line of {', '.join(columns)}; get the file again")
    values, faults = np.empty((0, 0)), list[Fault]()
    with suppress(ValueError):
        values = np.loadtxt([line for _, line in rows], ndmin=2)
    if values.shape[1] != len(columns) or not (np.abs(values) <= LARGEST).all():
        faults = [(i, why) for i, line in rows if (why := _fault(line.split(), columns))]
    if faults and strict:
        raise BadInput(f"{path}, line {faults[0][0]}: {faults[0][1]}; correct or remove the line")
    notes = leave_out(path, faults, len(rows))
    if faults:
        rows = [(i, line) for i, line in rows if i not in dict(faults)]
        values = np.array([[float(word) for word in line.split()] for _, line in rows])
    return TextTable(path, values, np.array([i for i, _ in rows], np.int64), notes=notes)


def _fault(words: Sequence[str], columns: Sequence[str]) -> str:
    if len(words) != len(columns):
        return f"{len(words)} columns, not {len(columns)} ({', '.join(columns)})"
    bad = ((name, word) for name, word in zip(columns, words, strict=True) if not np.isfinite(parse_number(word)))
    return next((f"{name} is {short_repr(word)}, which is not a number" for name, word in bad), "")


def time_order(stamps: Array) -> tuple[Indices, tuple[str, ...]]:
    """Return the rows by rising stamps (m,) [s], and sentences of what was done; equal stamps stay as they are.

    Stamps that step back by up to `MAX_STEP_BACK` are sorted. Where one steps back by more, a stamp is wrong: the
    longest sequence of rows that rises in their order is kept. Stamps that fall throughout are sorted, too.
    """
    if len(stamps) > 1 and (np.diff(stamps) < 0).all():
        return np.arange(len(stamps))[::-1], ("the last line is the first in time; they were sorted",)
    late, back = np.maximum.accumulate(stamps) - stamps, int((np.diff(stamps) < 0).sum())
    if (late > MAX_STEP_BACK).any():
        kept = longest_rise(stamps)
        lost = count_of(len(stamps) - len(kept), "line")
        return kept, (f"stamps step back by up to {late.max():.3g} s; left out {lost} out of order",)
    notes = (f"stamps step back, {count_of(back, 'time')}; they were sorted",) if back else ()
    return np.argsort(stamps, kind="stable"), notes


TURNS = {  # [s] after which clocks begin again
    86_400.0: "midnight",
    604_800.0: "the end of a week",
    2**32 * 1e-3: "2^32 ms",
    2**32 * 1e-6: "2^32 us",
}
LONGEST_PAUSE = 10.0  # [s] between the last stamp before and the first after


def unwrap_stamps(stamps: Array) -> tuple[Array, tuple[str, ...]]:
    """Return stamps (m,) [s] that go on where a clock begins again, and a sentence where it does."""
    known = np.flatnonzero(np.isfinite(stamps))
    steps = np.diff(stamps[known])
    for turn, words in TURNS.items():
        again = (-turn < steps) & (steps < LONGEST_PAUSE - turn)
        if again.sum() == 1:
            stamps = stamps.copy()
            stamps[known[1:][np.cumsum(again) > 0]] += turn
            return stamps, (f"stamps begin again after {words}; they go on from there",)
    return stamps, ()


def longest_rise(stamps: Array) -> Indices:
    """Return the rows of the longest sequence of stamps (m,) that does not fall, by patience sorting."""
    tops: list[float] = []  # the least last stamp of a sequence of each length
    rows: list[int] = []
    before = np.full(len(stamps), -1, np.int64)
    for i, stamp in enumerate(stamps.tolist()):
        k = bisect_right(tops, stamp)
        tops[k : k + 1], rows[k : k + 1] = [stamp], [i]
        before[i] = rows[k - 1] if k else -1
    kept = []
    i = rows[-1] if rows else -1
    while i >= 0:
        kept.append(i)
        i = int(before[i])
    return np.array(kept[::-1], np.int64)


def whole_numbers(table: TextTable, column: int, name: str, unique: bool = False) -> list[int]:
    """Return a column of whole numbers; refuse any other number and, with `unique`, one that was given before."""
    values = table.values[:, column]
    again = unique & pd.Series(values).duplicated().to_numpy()
    bad = again | (values != np.rint(values))
    if bad.any():
        row = int(np.argmax(bad))
        why = "was given before" if again[row] else "is not a whole number"
        raise BadInput(f"{table.at(row)}: {name} {values[row]:g} {why}; correct or remove the line")
    return [int(value) for value in values]


# ---- CSV files, their columns by name


COMMENTS = ("#", "%", "//")  # begin a line above the names of the columns
DELIMITERS = (";", ",", "\t", "|", " ")


SAMPLE = 20  # lines that say what columns are called

Rows = list[tuple[int, list[str]]]  # number of a line from 1, and its fields


def infer_delimiter(text: str) -> str:
    """Return what divides the fields: as in the first line that is divided into as many as the next, no title.

    Of two that may, it is the one between numbers: ; in 0,5;1,5 with decimal commas.
    """
    lines = (match[0].strip()[:10_000] for match in re.finditer(r"\S.*", text))
    some = [*islice((line for line in lines if not line.startswith(COMMENTS)), 10)] or text.split("\n", 1)[:1]

    def divide(line: str, delimiter: str) -> list[str]:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])

    def rank(line: str, delimiter: str) -> tuple[bool, bool, bool, int]:
        words = divide(line, delimiter)
        are_numbers = not any(np.isinf(parse_field(word)) for word in words)
        return len(words) > 1, delimiter != " ", are_numbers, len(words)

    likely = [max(DELIMITERS, key=partial(rank, line)) for line in some]
    for delimiter, line, below in zip(likely, some, some[1:], strict=False):
        if 1 < (n := len(divide(line, delimiter))) <= len(divide(below, delimiter)) <= n + 1:
            return delimiter
    return next((d for d, line in zip(likely, some, strict=True) if len(divide(line, d)) > 1), ",")


def split_fields(text: str) -> tuple[list[str], int, Rows]:
    """Return the names of the columns, their line from 1, and the lines below it, those that are blank left out.

    Names stand in the first line, or in the last comment above it, or are "1", "2" ... where half of that line are
    numbers already, as below it. Titles above the names, of another number of fields than most lines, do not count, nor
    does an empty field at the end of a line, for which there is no name.
    """
    delimiter = infer_delimiter(text)
    rows = list(fields_of(text, delimiter))
    above = next((k for k, (_, fields) in enumerate(rows) if not fields[0].startswith(COMMENTS)), len(rows))
    comments, rows = rows[:above], rows[above:]
    named = list[str]()
    if comments:
        words = text.split("\n")[comments[-1][0] - 1].lstrip("#%/ ")
        named = next((fields for _, fields in fields_of(words, delimiter)), [])
    if not rows:
        return named, comments[-1][0] if comments else 1, []
    usual = statistics.mode(len(fields) for _, fields in rows[:1000])
    first = next((k for k, (_, fields) in enumerate(rows[:10]) if len(fields) == usual), 0)
    kinds = [[bool(word) and not np.isinf(parse_field(word)) for word in fields] for _, fields in rows[: first + 4]]
    titles = not any(kinds[first]) or (delimiter == " " and all(kinds[first]) and not any(map(any, kinds[:first])))
    if first and titles and all(rows[first][1]):
        rows, kinds = rows[first:], kinds[first:]
    (line, head), (has_number, *below) = rows[0], kinds[:4]  # nan is a number, too
    if any(b > a for one in below for a, b in zip(has_number, one, strict=False)):
        rows = rows[1:]  # it has a word where there are numbers below
    elif len(named) == len(head) > 1:
        line, head = comments[-1][0], named
    elif below and sum(has_number) >= len(head) / 2 and has_number in below:
        head = [str(k + 1) for k in range(len(head))]
    else:
        rows = rows[1:]
    n = len(head)
    if any(len(fields) == n + 1 and not fields[-1] for _, fields in rows):
        rows = [(i, fields[:n] if len(fields) == n + 1 and not fields[-1] else fields) for i, fields in rows]
    return [name.lstrip("#%").strip() for name in head], line, rows


class NumberTable(NamedTuple):
    """A CSV file of numbers alone."""

    head: list[str]
    named: int  # the line of the names, from 1
    first: int  # that of the first numbers
    values: Array  # (m, n)  nan where a field is empty


def plain_numbers(text: str) -> NumberTable | None:
    """Return what `split_fields` finds in a file of numbers alone, in a twentieth of its time; None of any other.

    A field that is not a number, a column or a line without any, a line with another number of fields, a blank one, or
    a last one without an end make it another.
    """
    delimiter, begins = infer_delimiter(text), "\n".join(text.split("\n", SAMPLE)[:SAMPLE])
    head, named, rows = split_fields(begins)
    if delimiter == " " or len(head) < 2 or not rows or not text.endswith("\n"):
        return None
    first, n = rows[0][0], len(head)
    body = text.split("\n", first - 1)[-1]
    m = body.count("\n")
    words = body.encode().translate(None, f"-+.eE0123456789naN \n{delimiter}".encode())
    if words or "\n\n" in body or body.count(delimiter) != m * (n - 1):
        return None
    columns = {str(k): pa.float64() for k in range(n)}
    try:
        table = arrow_csv.read_csv(
            io.BytesIO(body.encode()),
            arrow_csv.ReadOptions(column_names=[*columns], use_threads=False),
            arrow_csv.ParseOptions(delimiter=delimiter, quote_char=False, ignore_empty_lines=False),
            arrow_csv.ConvertOptions(column_types=columns, null_values=["", " "]),
        )
    except pa.ArrowInvalid:
        return None
    values = np.column_stack([column.to_numpy() for column in table.columns])
    empty, too_large = np.isnan(values), np.abs(values) > LARGEST
    is_plain = values.shape == (m, n) and not (empty.all(0).any() or empty.all(1).any() or too_large.any())
    return NumberTable(head, named, first, values) if is_plain else None


def read_lines(path: Path, numbers: Sequence[str], names: Sequence[str]) -> TextTable:
    """Read columns by their names, as numbers or as text.

    Lines with another number of fields, or with words in place of all `numbers`, are left out; another field that is
    not a number counts as empty. So is a last line without an end that has fewer fields than the first, or ends inside
    one of `numbers`, as digits may be missing.
    """
    text = read_text(path)
    if not names and (plain := plain_numbers(text)):
        columns = [find_column(path, plain.named, plain.head, name) for name in numbers]
        lines = np.arange(plain.first, plain.first + len(plain.values))
        return TextTable(path, plain.values[:, columns], lines, [()] * len(lines))
    head, first, content = split_fields(text)
    n = len(head)
    of_numbers = [find_column(path, first, head, name) for name in numbers]
    of_names = [find_column(path, first, head, name) for name in names]
    faults = [
        (line, "the names of the columns again" if fields == head else f"{count_of(len(fields), 'field')}, not {n}")
        for line, fields in content
        if len(fields) != n or fields == head
    ]
    if content and not text.endswith("\n") and len(content[-1][1]) == n and n - 1 in of_numbers:
        faults.append((content[-1][0], "the last line has no end and may be cut off"))
    torn = {line for line, _ in faults}
    faults += [
        (line, f"{short_repr(fields[of_numbers[0]])} and all others are no numbers")
        for line, fields in content[:2] * (len(of_numbers) > 1)
        if line not in torn and all(np.isinf(parse_field(fields[i])) for i in of_numbers)
    ]
    notes, bad = leave_out(path, faults, len(content)), {line for line, _ in faults}
    content = [(line, fields) for line, fields in content if line not in bad] if bad else content
    rows = np.empty((len(content), len(of_numbers)))
    for k, i in enumerate(of_numbers):
        words = [fields[i] for _, fields in content]
        rows[:, k] = parse_fields(words)
        same = np.flatnonzero(np.isinf(rows[:, k]))
        if len(same):
            where = (
                f"{path}, line {content[same[0]][0]}: {head[i]} is {short_repr(words[same[0]])}, which is not a number"
            )
            if len(same) > (1 - LEAST_LEFT) * len(content):
                raise BadInput(f"{where}, as most are; correct them, or name another column in log.toml")
            many = "it counts as empty" if len(same) == 1 else f"{len(same)} such fields count as empty"
            notes += (f"{where}; {many}",)
    rows[np.isinf(rows)] = np.nan
    texts = (
        [tuple(parse_name(fields[i]) for i in of_names) for _, fields in content] if of_names else [()] * len(content)
    )
    return TextTable(path, rows, np.array([line for line, _ in content], np.int64), texts, notes)


def fields_of(text: str, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the lines that are not blank: number, and fields. A quote without its partner ends with its line."""
    lines, has_quotes = enumerate(text.split("\n"), 1), delimiter == " " or '"' in text
    if not has_quotes and not re.search(rf"[^\S\n{re.escape(delimiter)}]", text):  # nothing to strip: half the time
        yield from (row for row in ((i, line.split(delimiter)) for i, line in lines) if any(row[1]))
        return
    for i, line in lines:
        raw = [line]
        if delimiter == " " or '"' in line:
            whole = line.strip() if delimiter == " " else line  # columns may be aligned by blanks
            with suppress(csv.Error):  # a field of more than 100,000 characters
                raw = next(csv.reader([whole], delimiter=delimiter, skipinitialspace=True), [])
        else:
            raw = line.split(delimiter)
        fields = [field.strip() for field in raw]
        if any(fields):
            yield i, fields


def find_column(path: Path, line: int, head: list[str], name: str) -> int:
    """Return the index of a column."""
    if head.count(name) == 1:
        return head.index(name)
    if name in head:
        raise BadInput(f"{path}, line {line}: two columns are named {short_repr(name)}; rename one")
    known = nearest(name, head) if head else "the file is empty; get it again"
    raise BadInput(f"{path}, line {line}: there is no column {name!r}; {known}")


def parse_fields(fields: Sequence[str]) -> Array:
    """Return `parse_field` of each, at once where all are plain numbers or empty."""
    try:
        numbers = np.array([field or "nan" for field in fields], float)
    except ValueError:
        return np.array([parse_field(field) for field in fields], float)
    numbers[np.abs(numbers) > LARGEST] = np.inf
    return numbers


def parse_name(field: str) -> str:
    """Return the name in a field; of a whole number without decimals: 2.0 and 2.000e+00 are 2."""
    number = parse_number(field) if "." in field else 0.5
    return f"{number:.0f}" if number == np.rint(number) and abs(number) < LARGEST else field


MISSING = {"", "-", "--", "na", "n/a", "none", "null"}  # what fields without a number hold


def parse_field(field: str) -> float:
    """Return the number in a field, nan where it is one of `MISSING`, inf where it is not a number.

    A comma may stand for the decimal point, and " sec" after a number, as MATLAB writes it. A date is seconds since
    1970 (UTC, if it names no other zone), a time of day seconds since midnight.
    """
    if field.lower() in MISSING:
        return np.nan
    number = parse_number(field.removesuffix(" sec"))
    if np.isinf(number):
        number = parse_number(field.replace(",", ".", 1))
    return parse_date(field.replace(",", ".")) if np.isinf(number) and ":" in field else number


# A day and a time beside ISO 8601, 25.11.2026 9:30:00 or 11/25/2026 9:30:00.5 PM (4/5 is of April), or a time alone.
DATE = re.compile(
    r"(?:(\d{1,2})([./-])(\d{1,2})\2(\d{4}),? )?(\d{1,2}):(\d\d):(\d\d(?:\.\d+)?)(?: ?([aApP])\.?[mM]\.?)?"
)


def parse_date(field: str) -> float:
    """Return a date with a time, or a time of day, in seconds; inf where it is neither."""
    with suppress(ValueError):
        if match := DATE.fullmatch(field):
            a, sign, b, year, hours, minutes, seconds, half = match.groups()
            day, month = (b, a) if sign == "/" and int(a) <= 12 else (a, b)
            midnight = datetime(int(year), int(month), int(day), tzinfo=UTC).timestamp() if sign else 0.0
            hours = int(hours) % 12 + 12 * (half in "pP") if half else int(hours)
            return midnight + 3600 * hours + 60 * int(minutes) + float(seconds)
        date = datetime.fromisoformat(field.replace("/", "-"))
        return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
    return np.inf

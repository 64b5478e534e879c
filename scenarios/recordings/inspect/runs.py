"""Which files of a directory are of which run: by a word in their names, by a column, or each file of one robot."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.inspect import naming
from cooploc.scenarios.recordings.inspect.columns import CsvTable, infer_columns, read_csv
from cooploc.scenarios.recordings.inspect.table_parts import STAMPS, parts_of
from cooploc.scenarios.recordings.text_files import COUNTS, RUN_COLUMNS, are_called_runs, files_below, is_text

MOST_SPANS, ENDS = 4, 100  # runs whose first and last lines are looked at, and how many
PAUSE = 10  # usual steps between runs that follow each other
LEAST_LINES, MOST = 20, 0.9  # of a run, where a column tells them, and share of lines in such runs


def text_files(folder: Path) -> list[Path]:
    """Return the text files below a folder."""
    return [p for p in files_below(folder) if is_text(p)]


def runs_in_names(data: Path) -> dict[str, dict[str, str]]:
    """Return runs by a word in the names of files: run -> {file: its name with {run} in place of it}; {} without any.

    They follow each other in time, or are called run1, trial_2 and so on. Robots do not.
    """
    for runs in _possible_runs([p.relative_to(data).as_posix() for p in text_files(data)]):
        common = min({*next(iter(runs.values())).values()}.intersection(*(of.values() for of in runs.values())))
        names = [next(name for name, pattern in of.items() if pattern == common) for of in runs.values()][:MOST_SPANS]
        files = list[CsvTable]()
        for name in names:
            with suppress(BadInput):
                files.append(read_csv(data / name, name, ENDS))
        spans = sorted(filter(None, map(_span_of, files)))
        alike = len({frozenset(file.columns) for file in files}) == 1  # not odometry in one, the truth in another
        apart = all(a[1] < b[0] for a, b in pairwise(spans))
        if alike and len(spans) > 1 and (apart or are_called_runs(runs)):
            return runs
    return {}


def first_of_column(files: Sequence[CsvTable]) -> tuple[list[CsvTable], str]:
    """Return the lines of the first run, and the column that tells runs; all lines, and "", where none does."""
    stamped = [file for file in files if _span_of(file)]
    for file in stamped:
        for column in file.columns:
            if not (is_run_column(column) and are_runs(file.words(column))) or _goes_on(file, column):
                continue
            if lacking := [other.name for other in stamped if column not in other.columns]:
                fact = f"{file.name} has runs in the column {column!r}, and {lacking[0]} has none"
                raise BadInput(f"{fact}; add it, or write a directory for each run")
            first = file.names(column)[0]
            return [_select(one, column, first) if one in stamped else one for one in files], column
    return list(files), ""


def _goes_on(file: CsvTable, column: str) -> bool:
    """Return whether time goes on wherever a column changes, as it does where a robot began to run.

    Runs begin after a pause or at the same time; where lines are in the order of their stamps, most have several words.
    """
    stamps = next(np.asarray(file.columns[g.column]) for g in file.guesses if g.quantity in ("time", "sec"))
    steps, words = np.diff(stamps), np.array(file.words(column))
    there, usual = steps[words[1:] != words[:-1]], np.median(np.abs(steps[steps != 0])) if steps.any() else 0.0
    shared = len({*zip(stamps.tolist(), words.tolist(), strict=True)}) > 1.5 * len({*stamps.tolist()})
    return not shared and bool(((there >= 0) & (there <= PAUSE * usual)).all())


def is_run_column(column: str) -> bool:
    """Return whether a column's name says that it tells runs, as `trial` and `run_id` do."""
    words = {*naming.words_of(column)} - COUNTS
    return bool(words) and words <= RUN_COLUMNS


def are_runs(words: Iterable[str]) -> bool:
    """Return whether words of lines are of several runs; most are of runs with enough lines, as one may end early."""
    count = Counter(filter(None, words))
    enough = [n for n in count.values() if n >= LEAST_LINES]
    return len(enough) > 1 and sum(enough) > MOST * count.total()


def _select(file: CsvTable, column: str, word: str) -> CsvTable:
    """Return the lines with a word in a column, without it."""
    rows = [k for k, one in enumerate(file.words(column)) if one == word]
    kept = {c: v for c, v in file.columns.items() if c != column}
    columns = {c: tuple(v[k] for k in rows) if isinstance(v, tuple) else v[rows] for c, v in kept.items()}
    found = file._replace(columns=columns)
    return found._replace(guesses=infer_columns(found))


def _span_of(file: CsvTable) -> tuple[float, ...]:
    """Return the first and last stamp of a file; none where no column holds them."""
    stamps = next((file.numbers(g.column) for g in file.guesses if g.quantity in ("time", "sec")), np.empty(0))
    return tuple(sorted(stamps[[0, -1]].tolist())) if len(stamps) > 1 else ()


def _possible_runs(files: Sequence[str]) -> Iterator[dict[str, dict[str, str]]]:
    """Yield what may be runs, by a word that files of each have: run -> {file: its name with {run} in place of it}.

    run1_odom.csv and run1_uwb.csv are {run}_odom.csv and {run}_uwb.csv of run1, if run2 has these, too. The runs with
    the most files come first. Directories that hold all files of a run are left out: those are found otherwise.
    """
    words_at: dict[str, dict[str, str]] = {}
    for file in files:
        for word, pattern in naming.word_patterns(file, "{run}"):
            words_at.setdefault(pattern, {})[word] = file
    patterns: dict[frozenset[str], list[str]] = {}
    for pattern, of in words_at.items():
        if len(of) > 1:
            patterns.setdefault(frozenset(of), []).append(pattern)
    for runs in sorted(patterns, key=lambda some: -len(some) * len(patterns[some])):
        if len(patterns[runs]) > 1 and not all(pattern.startswith("{run}/") for pattern in patterns[runs]):
            yield {run: {of[run]: pattern for pattern, of in words_at.items() if run in of} for run in sorted(runs)}


def are_runs_of_one_robot(files: Sequence[CsvTable]) -> tuple[bool, str]:
    """Return whether files are runs of one robot, and why; "" of files that may be either.

    They have the same columns, with odometry and truth, and follow each other in time, or more than a word of their
    names differs. With one word, and stamps in common, they are of robots: surely if they measured each other.
    """
    stamps, measured = [], set[str]()
    for file in files:
        parts = {part.table: part for part in parts_of(file)}
        same = file.columns.keys() == files[0].columns.keys()
        if not same or not {"odometry", "truth"} <= parts.keys() or "robot" in parts["odometry"].columns:
            return False, "their names in the names of the files, or in a column"
        own = parts["odometry"].columns
        t = file.numbers(next(own[q].column for q in STAMPS if q in own))
        measured |= {name for part in parts.values() for name in part.names("other")}
        if len(t) > 1:
            stamps.append((t[0], t[-1]))
    overlaps = sum(later[0] < earlier[1] for earlier, later in pairwise(sorted(stamps)))
    robots = naming.file_pattern([file.name for file in files])[1]
    if len(stamps) > 1 and (overlaps < len(stamps) / 2 or len(robots) < len(files)):
        how = "one after the other in time" if overlaps < len(stamps) / 2 else "whose names differ in more than a word"
        return True, f"{len(files)} files of the same columns, {how}: runs of one robot"
    certain = len(stamps) < 2 or measured & {*robots}
    return False, "their names in the names of the files" if certain else ""

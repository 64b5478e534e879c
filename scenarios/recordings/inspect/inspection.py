"""A look at a recording, from a path to everything that can be said of it."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput, nearest
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings import robot_run as single
from cooploc.scenarios.recordings.inspect.csv_folder import csv_files
from cooploc.scenarios.recordings.inspect.draft import Draft, columns_of, draft_of
from cooploc.scenarios.recordings.inspect.finding import Finding
from cooploc.scenarios.recordings.inspect.log_toml import log_toml
from cooploc.scenarios.recordings.inspect.looks import look_at_all
from cooploc.scenarios.recordings.inspect.one_robot import (
    Files,
    is_one_robot,
    one_robot_log,
    one_robot_tables,
    rssi_remark,
)
from cooploc.scenarios.recordings.inspect.recognized import recognized
from cooploc.scenarios.recordings.inspect.series_table import SeriesRow, series_rows
from cooploc.scenarios.recordings.inspect.settings import settings
from cooploc.scenarios.recordings.inspect.toml_text import written
from cooploc.scenarios.recordings.scenario import reader
from cooploc.scenarios.recordings.schema import EXAMPLE, NAME, TABLES, TeamDescription, load, parse, text_of
from cooploc.scenarios.recordings.team_log import TeamLog


class Inspected(NamedTuple):
    """What a look at a recording found."""

    path: Path
    format: str
    why: str  # it is that format
    runs: tuple[str, ...]
    log: TeamLog  # the run that was looked at, as it was read
    corrected: TeamLog  # the same with what was found corrected: for the eye, never for an estimator
    rows: tuple[SeriesRow, ...]
    findings: tuple[Finding, ...]
    columns: tuple[tuple[str, str, str, str], ...]  # file or topic, column, what it probably is, why
    unused: tuple[str, ...]
    text: str  # of log.toml: the one that is there, or a draft


def inspect_recording(path: Path, run: str = "", again: bool = False) -> Inspected:
    """Look at a directory of CSV files, a bag, a PyFG file or MRCLAM text.

    Args:
        path: a directory or file; a log.toml of a team in the directory is believed.
        run: which recording of several; the first if empty.
        again: guess everything once more, whatever log.toml says.

    Raises:
        BadInput: there is nothing that can be read; one line: fact, place and remedy.

    """
    found = recognized(path)
    home = (path if path.is_dir() else path.parent) / NAME
    if not again and home.is_file() and "\nformat" in f"\n{text_of(home)}":
        return _looked(path, load(home), "log.toml says so", run)._replace(text=text_of(home))
    if found.format == "csv" and is_one_robot(files := csv_files(path).files):
        return _of_one_robot(path, files, run)
    draft = draft_of(path, found)
    description = _parsed(home, written((), draft.entries, draft.tables))
    looked = _looked(path, description, found.why, run)
    more = settings(looked.corrected, len(looked.runs))
    text = log_toml(path, found.why, draft, looked.corrected, looked.findings, more)
    _parsed(home, text)
    return looked._replace(columns=draft.columns, unused=draft.unused, text=text)


def _looked(path: Path, description: TeamDescription, why: str, run: str) -> Inspected:
    """What a reader makes of a recording, and what is odd about that."""
    read = reader(description.format)
    data = path.parent if path.is_file() and description.format == "bag" else path
    places = read.runs(data, description)
    name = _chosen(path, places, run or (path.stem if path.stem in places else ""))
    log = read.read(data, places[name], name, description)
    odd, corrected = look_at_all(log, _arena(description))
    rows = tuple(series_rows(log))
    return Inspected(path, description.format, why, tuple(places), log, corrected, rows, odd, (), (), "")


def _of_one_robot(path: Path, files: Files, run: str) -> Inspected:
    """CSV files that are runs of one robot."""
    log, why = one_robot_log(files, run), "files that follow each other in time: runs of one robot"
    odd, corrected = look_at_all(log)
    draft = Draft(*one_robot_tables(files), columns_of(path, files[:1]), rssi_remark(files))
    text = log_toml(path, why, draft, corrected, odd)
    parse(path / NAME, text, single.Description, single.TABLES, EXAMPLE)
    names, rows = tuple(look.path.stem for look, _ in files), tuple(series_rows(log))
    return Inspected(path, "csv", why, names, log, corrected, rows, odd, draft.columns, draft.unused, text)


def _parsed(path: Path, text: str) -> TeamDescription:
    return parse(path, text, TeamDescription, TABLES, EXAMPLE)


def _chosen(path: Path, places: Mapping[str, Path], run: str) -> str:
    name = run or next(iter(places))
    if name not in places:
        raise BadInput(f"{path}: there is no run {name!r}; {nearest(name, list(places))}")
    return name


def _arena(description: TeamDescription) -> Array | None:
    return None if description.arena is None else np.array(description.arena, float)

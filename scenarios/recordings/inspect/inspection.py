"""The inspection of a recording, from a path to series, findings and a log.toml."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput, nearest
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings import schema
from cooploc.scenarios.recordings.inspect import reading_checks as readings
from cooploc.scenarios.recordings.inspect import robot_checks as robots
from cooploc.scenarios.recordings.inspect.bag_draft import BAGS, bag_draft
from cooploc.scenarios.recordings.inspect.csv_draft import ENDINGS, csv_draft
from cooploc.scenarios.recordings.inspect.draft_toml import Draft, Entry, complete_draft, head_lines
from cooploc.scenarios.recordings.inspect.finding import CheckedLog, Finding
from cooploc.scenarios.recordings.inspect.trial_run import Trial, common_robots, run_draft, try_recordings
from cooploc.scenarios.recordings.scenario import reader
from cooploc.scenarios.recordings.team_log import TeamLog, other_names

GAP = 10.0  # median intervals without a sample are a gap


class SeriesRow(NamedTuple):
    """One series of a recording: its samples, rate and gaps."""

    series: str  # "odometry", "truth" or a channel
    of: str  # a robot, or robot-other
    samples: int
    rate: float  # [1/s], of the median interval
    first: float  # [s] after the recording's first stamp
    last: float  # [s] likewise
    gaps: int
    longest: float  # [s] interval
    time: Array  # (m,) [s] since the recording's first stamp
    source: str


class Inspected(NamedTuple):
    """The result of an inspection."""

    path: Path
    format: str
    why: str  # it is that format
    runs: tuple[str, ...]
    log: TeamLog  # the run that was inspected, as it was read
    corrected: TeamLog  # the same with findings corrected: for the eye, never for an estimator
    rows: tuple[SeriesRow, ...]
    findings: tuple[Finding, ...]
    columns: tuple[tuple[str, str, str, str], ...]  # file or topic, column, its probable meaning, why
    unused: tuple[str, ...]
    text: str  # of log.toml: the one that is there, or a draft
    trial: Trial  # of that log.toml


def inspect_recording(path: Path, run: str = "", again: bool = False) -> Inspected:
    """Inspect a directory of CSV files, a bag, a PyFG file or MRCLAM text.

    Args:
        path: a directory or file; a log.toml of a team in the directory is believed.
        run: which recording of several; the first if empty.
        again: guess everything once more, whatever log.toml says.

    Raises:
        BadInput: there is nothing that can be read; one line: fact, place and remedy.

    """
    form, why = recognize(path)
    directory = path if path.is_dir() else path.parent
    home = directory / schema.NAME
    stated, draft = home.is_file() and not again and not schema.is_of_one_robot(home), Draft(())
    if stated:
        description, text, why = schema.load(home), schema.text_of(home), "log.toml says so"
    else:
        drafted = {"csv": csv_draft, "bag": bag_draft}
        draft = drafted[form](path) if form in drafted else Draft((Entry("format", form, why),))
        description = schema.parse(home, draft.text(), schema.TeamDescription, schema.EXAMPLE)
    read = reader(description.format)
    data = path.parent if path.is_file() and description.format == "bag" else path / description.recordings
    places = read.runs(data, description)
    name = run or (path.stem if path.stem in places else next(iter(places)))
    if name not in places:
        raise BadInput(f"{path}: there is no run {name!r}; {nearest(name, list(places))}")
    log = read.read(data, places[name], name, description)
    if not stated and description.robots and (robots := common_robots(log)) != log.robots:
        left_out = ", ".join(robot for robot in log.robots if robot not in robots)
        entries = tuple(e._replace(value=list(robots)) if e.key == "robots" else e for e in draft.entries)
        unused = (*draft.unused, f"{left_out}: without truth, or too late or too early for the others")
        draft = draft._replace(entries=entries, unused=unused)
        description = schema.parse(home, draft.text(), schema.TeamDescription, schema.EXAMPLE)
        log = read.read(data, places[name], name, description)
    checked = check_recording(log, None if description.arena is None else np.array(description.arena, float))
    findings = checked.result()
    if stated:
        try:
            trial = try_recordings(directory, description)
        except BadInput as e:
            trial = Trial(str(e))
    else:
        draft = complete_draft(path, draft, checked.log, findings, len(places))
        draft, trial = run_draft(directory, home, draft, findings)
        text = draft.text(head_lines(path, why, draft))
    return Inspected(
        path,
        description.format,
        why,
        tuple(places),
        log,
        checked.log,
        tuple(series_rows(log)),
        findings,
        draft.columns,
        draft.unused,
        text,
        trial,
    )


def recognize(path: Path) -> tuple[str, str]:
    """Return the format of a recording without a log.toml, as it is called there, and the reason.

    Raises:
        BadInput: there is nothing at the path, or nothing that is known.

    """
    if not path.exists():
        raise BadInput(f"{path}: there is no such file or directory; name one with a recording")
    if path.is_file() and path.suffix.lower() in ENDINGS:
        raise BadInput(f"{path}: this is one file; name the directory with the files of all robots, odometry and truth")
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    ending = {p.suffix.lower(): p.name for p in reversed(files)}
    if bag := next((ending[e] for e in BAGS if e in ending), ""):
        return "bag", f"{bag} is a bag"
    if graph := ending.get(".pyfg") or ending.get(".fg"):
        return "pyfg", f"{graph} is a factor graph"
    if any(p.name == "Barcodes.dat" for p in files):
        return "mrclam", "Barcodes.dat is of MRCLAM"
    if ending.keys() & {*ENDINGS}:
        return "csv", "text files with columns"
    raise BadInput(f"{path}: there is no CSV file, bag, PyFG file or MRCLAM text in it; name another directory")


def check_recording(log: TeamLog, arena: Array | None = None) -> CheckedLog:
    """Find everything odd about a recording, in an order in which no fault hides the next.

    Args:
        log: as a reader made it, in SI units as described or guessed.
        arena: (2, 2) lower left and upper right corner [m], if it is known.

    """
    c, every = CheckedLog(log), range(len(log.robots))
    for warning in log.warnings:  # such as a last line that was cut off
        c.add("dropped", None, "", warning, "sure", "nothing: it is left out")
    robots.check_gaps(c)
    for check in (robots.check_lengths, robots.check_heading_unit, robots.check_turn_unit):
        for i in every:
            check(c, i)
    robots.check_clocks(c)
    for check in (robots.check_stale, robots.check_jumps):
        for i in every:
            check(c, i)
    readings.check_range_units(c)
    for check in (robots.check_frame, robots.check_scales):
        for i in every:
            check(c, i)
    readings.check_names(c)
    readings.check_reading_clocks(c)
    readings.check_biases(c)
    readings.check_bearings(c)
    readings.check_rssi(c)
    robots.check_arena(c, arena)
    return c


def series_rows(log: TeamLog) -> list[SeriesRow]:
    """Return a row for each series; readings of every pair apart."""
    found = [("odometry", robot, s.time, s.source) for robot, s in zip(log.robots, log.odometry, strict=True)]
    for robot, truth in zip(log.robots, log.truth, strict=True):
        if truth is not None:
            found.append(("truth", robot, truth.time[np.isfinite(truth.values[:, :2]).all(axis=1)], truth.source))
    for channel, r in log.readings.items():
        for i, k in np.unique(np.stack([r.robot, r.other]), axis=1).T:
            of = f"{log.robots[i]}-{other_names(log, channel)[k]}"
            found.append((channel, of, r.time[(r.robot == i) & (r.other == k)], r.source))
    zero = min((time[0] for _, _, time, _ in found if len(time)), default=0.0)
    return [_row(name, of, time - zero, source) for name, of, time, source in found]


def _row(name: str, of: str, time: Array, source: str) -> SeriesRow:
    first, last = time[[0, -1]].tolist() if len(time) else (np.nan, np.nan)
    intervals = np.diff(time)
    usual, longest = (float(f(intervals)) if len(intervals) else np.nan for f in (np.median, np.max))
    gaps, rate = int((intervals > max(GAP * usual, 1.0)).sum()), 1 / usual if usual > 0 else np.nan
    return SeriesRow(name, of, len(time), rate, first, last, gaps, longest, time, source)


def measured_counts(log: TeamLog) -> tuple[tuple[str, ...], tuple[str, ...], Array]:
    """Return the names of robots, of all they measured, and how often (robots, measured); channels together."""
    names = (*log.robots, *log.landmarks.names, *log.anchors.names)
    counts = np.zeros((len(log.robots), len(names)))
    for channel, r in log.readings.items():
        first = names.index(other_names(log, channel)[0])
        np.add.at(counts, (r.robot, first + r.other), 1)
    return log.robots, names, counts

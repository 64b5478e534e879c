"""The inspection of a recording, from a path to series, findings and a log.toml."""

import itertools
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from cooploc.estimators.errors import BadInput, count_of, first_of, nearest
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings import bag_storage, bags, csv_files, mrclam, schema
from cooploc.scenarios.recordings.inspect import draft_toml
from cooploc.scenarios.recordings.inspect.bag_draft import SURE, bag_draft
from cooploc.scenarios.recordings.inspect.checks import GAP, check_recording
from cooploc.scenarios.recordings.inspect.csv_draft import csv_draft
from cooploc.scenarios.recordings.inspect.draft_toml import Draft, Entry, common_span
from cooploc.scenarios.recordings.inspect.findings import CheckedLog, Finding
from cooploc.scenarios.recordings.inspect.reading_checks import VAGUE
from cooploc.scenarios.recordings.inspect.table_parts import READINGS
from cooploc.scenarios.recordings.radio_nodes import NodeRanges, assign
from cooploc.scenarios.recordings.scenario import NO_ORDER, TeamScenario, reader
from cooploc.scenarios.recordings.team_log import TeamLog, other_names
from cooploc.scenarios.recordings.text_files import files_below, is_text

WITH_TABLES = ("csv", "bag")  # formats
TABLES = ("odometry", "truth", "anchors", "landmarks", *READINGS)  # that only these have
NOT_FALLING, NO_RSSI = "does not fall with distance", "[rssi] is left out of log.toml"
ARCHIVES = (".zip", ".tar", ".tgz", ".gz", ".bz2", ".xz", ".7z", ".rar")
WITH_LENGTHS = (("truth", "ranges", "sightings"), ("truth",), ("ranges", "sightings"))  # tables
MOST_RADIOS = 30  # names that are told by their ranges; more are numbers of something else
TOO_LITTLE = "too little for"  # in the problem of a recording that is too short to be fitted


class SeriesRow(NamedTuple):
    """A series of a recording: its samples, rate and gaps."""

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


class Trial(NamedTuple):
    """The result of running all recordings that a log.toml describes."""

    problem: str  # why they do not run; "" if they do
    lines: tuple[str, ...] = ()  # what is judged of each, and why it may rank nothing
    faults: tuple[str, ...] = ()  # of all, what was mended while reading


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

    @property
    def faults(self) -> list[str]:
        """Sentences on what was mended in any run, and on files that cannot be read."""
        unread = [line for line in self.unused if line.startswith(str(self.path))]
        return list(dict.fromkeys([*unread, *self.log.warnings, *self.trial.faults]))


@bags.keep_what_is_read()
def inspect_recording(path: Path, run: str = "", again: bool = False) -> Inspected:
    """Inspect a directory of CSV files, a bag, a PyFG file or MRCLAM text."""
    directory = path if path.is_dir() else path.parent
    home = directory / schema.NAME
    stated, draft = home.is_file() and not again, Draft(())
    form, why = ("", "") if stated and path == directory else recognize(path)  # else it may say where recordings are
    if stated:
        description, text, why = schema.load(home), home.read_text(encoding="utf-8"), "log.toml says so"
    else:
        drafted = {"csv": csv_draft, "bag": bag_draft}
        draft = drafted[form](path) if form in drafted else Draft((Entry("format", form, why),))
        description = schema.parse(home, draft.text())
    of_format = reader(description.format)
    data = path.parent if path.is_file() and description.format == "bag" else path / description.recordings
    places = of_format.find_runs(data, description)
    name = run or (path.stem if path.stem in places else next(iter(places)))
    if name not in places:
        raise BadInput(f"{path}: there is no run {name!r}; {nearest(name, list(places))}")
    log: TeamLog = of_format.read_run(places[name], name, description)
    if not stated and description.robots and (robots := common_robots(log)) != log.robots:
        left_out = first_of((robot for robot in log.robots if robot not in robots), 5)
        entries = tuple(e._replace(value=list(robots)) if e.key == "robots" else e for e in draft.entries)
        unused = (*draft.unused, f"{left_out}: without truth, or too late or too early for the others")
        draft = draft._replace(entries=entries, unused=unused)
        description = schema.parse(home, draft.text())
        log = of_format.read_run(places[name], name, description)

    def read(other: Draft) -> TeamLog:
        found: TeamLog = of_format.read_run(places[name], name, schema.parse(home, other.text()))
        return found

    if not stated and (named := name_radios(draft, log, places[name], description)) != draft:
        draft, log = named, read(named)
    checked = check_recording(log)
    if not stated:
        draft, log, checked = fit_lengths(draft, log, checked, read)
    findings = (*draft.doubts, *checked.findings)
    if description.format not in WITH_TABLES:
        findings = tuple(one if one.nothing or one.kind in ("gap", "dropped") else _in_words(one) for one in findings)
    if not stated:
        draft = draft_toml.complete_draft(path, draft, checked.log, findings, len(places))
        text = draft.text(draft_toml.head_lines(path, why, draft))
    trial = try_draft(directory, schema.parse(home, text))
    if not stated and NOT_FALLING in trial.problem:
        unused = (*draft.unused, f"{NO_RSSI}: {trial.problem}")
        draft = draft._replace(tables=tuple(t for t in draft.tables if t.name != "rssi"), unused=unused)
        text = draft.text(draft_toml.head_lines(path, why, draft))
        trial = try_draft(directory, schema.parse(home, text))
    if not stated and TOO_LITTLE in trial.problem:
        draft = draft_toml.assume_models(draft, re.findall(r"\w+", trial.problem.partition(TOO_LITTLE)[2]))
        assumed = draft.text(draft_toml.head_lines(path, why, draft))
        if not (found_trial := try_draft(directory, schema.parse(home, assumed))).problem:
            text, trial = assumed, found_trial
    found = tuple(places), log, checked.log, tuple(series_rows(log)), findings
    return Inspected(path, description.format, why, *found, draft.columns, draft.unused, text, trial)


def _in_words(one: Finding) -> Finding:
    """Return a finding in a recording whose log.toml has no table for what was recorded."""
    return one._replace(setting=f"nothing: of CSV files and bags it is {one.change}") if one.table in TABLES else one


def name_radios(draft: Draft, log: TeamLog, place: Path, description: schema.TeamDescription) -> Draft:
    """Return the draft with whose the radios, or markers, are that lines call by no robot or place: by their ranges."""
    truth = {robot: series for robot, series in zip(log.robots, log.truth, strict=True) if series is not None}
    if description.format not in WITH_TABLES:
        return draft
    if description.format == "bag":
        files = bags.run_files(place, log.name, description)
    else:
        files = csv_files.RunFiles(place, log.name, description, [])
    tables = list(draft.tables)
    both = [(table, log.anchors) for table in description.ranges] + [(t, log.landmarks) for t in description.sightings]
    for table, fixed in both:
        known = truth | dict(zip(fixed.names, fixed.positions, strict=True))
        measured = csv_files.read_measurements(files, table, (*log.robots, *fixed.names))
        parts = [pd.DataFrame({"a": m.robot, "b": m.other, "t": m.time, "r": m.values[:, 0]}) for m in measured]
        if not parts:
            continue
        lines = pd.concat(parts).query("a != '' and b != '' and a != b")
        ends = {*lines["a"], *lines["b"]}
        unknown = ends - {*log.robots, *fixed.names}
        if not 0 < len(unknown) <= MOST_RADIOS or len(truth) < 2:
            continue
        pairs = [
            NodeRanges(str(own["a"].iloc[0]), str(own["b"].iloc[0]), own["t"].to_numpy(), own["r"].to_numpy())
            for _, own in lines.groupby(["a", "b"])
        ]
        found = assign(pairs, truth, known)
        alike = isinstance(table, schema.RangesTable) and unknown == ends and len(unknown) == len(truth) == 2
        if found.residual < (VAGUE if alike else min(VAGUE, found.second / SURE)):
            why = f"ranges fit the true distances to {found.residual:.2g} m, and the next best to {found.second:.2g} m"
            why = "two radios on two robots: which is whose makes no difference to ranges" if alike else why
            for k, one in enumerate(tables):
                named = {entry.key: entry.value for entry in one.entries if entry.key in ("file", "topic", "nodes")}
                if one.name in READINGS and (named.get("file"), named.get("topic")) == (table.file, table.topic):
                    theirs = named.get("nodes", {}) | {n: robot for robot, n in found.nodes.items()}
                    nodes = Entry("nodes", theirs, why, "likely")
                    tables[k] = one._replace(entries=(*(e for e in one.entries if e.key != "nodes"), nodes))
    return draft._replace(tables=tuple(tables))


def fit_lengths(
    draft: Draft, log: TeamLog, checked: CheckedLog, read: Callable[[Draft], TeamLog]
) -> tuple[Draft, TeamLog, CheckedLog]:
    """Return a draft, its recording and the checks of it, with lengths that span far in m or cm if more fits then."""
    tried = [(draft, log, checked)]
    unlike = any(one.kind == "unit" for one in checked.findings)
    for tables, unit in itertools.product(WITH_LENGTHS, ("m", "cm")) if unlike else ():
        other = draft_toml.in_unit(draft, tables, unit)
        if other != draft:
            again = read(other)
            tried.append((other, again, check_recording(again)))
    return min(tried, key=lambda one: sum(finding.kind == "unit" for finding in one[2].findings))


def recognize(path: Path) -> tuple[str, str]:
    """Return the format of a recording without a log.toml, as it is called there, and the reason."""
    if not path.exists():
        raise BadInput(f"{path}: there is no such file or directory; name one with a recording")
    if is_text(path):
        raise BadInput(f"{path}: this is one file; name the directory with the files of all robots, odometry and truth")
    files = [path] if path.is_file() else files_below(path)
    ending = {p.suffix.lower(): p.name for p in reversed(files)}
    of_bags = [p.name for p in files if bag_storage.is_bag(p)]
    if of_bags := of_bags or [
        f"{p.resolve().parent.name}, with {p.name}," for p in files if p.name == bag_storage.METADATA
    ]:
        return "bag", f"{of_bags[0]} is a bag"
    if graph := ending.get(".pyfg") or ending.get(".fg"):
        return "pyfg", f"{graph} is a factor graph"
    if of_mrclam := next((p.name for p in files if mrclam.NAME.fullmatch(p.name)), ""):
        return "mrclam", f"{of_mrclam} is of MRCLAM"
    if any(map(is_text, files)):
        return "csv", "text files with columns"
    if active := next((p for p in files if p.name.endswith(".bag.active")), None):
        raise BadInput(f"{active}: its recorder was killed; `rosbag reindex {active.name}` mends it, then name it .bag")
    packed = next((p.name for p in files if p.suffix.lower() in ARCHIVES), "")
    here = f" ({files[0].name} is none; save what is in it as CSV)" if files else ""
    here = f" ({packed}: unpack it)" if packed else here
    raise BadInput(f"{path}: there is no CSV file, bag, PyFG file or MRCLAM text in it{here}; name another directory")


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
    rows = []
    for name, of, stamps, source in found:
        time = stamps - zero
        first, last = time[[0, -1]].tolist() if len(time) else (np.nan, np.nan)
        intervals = np.diff(time)
        usual, longest = (float(f(intervals)) if len(intervals) else np.nan for f in (np.median, np.max))
        gaps, rate = int((intervals > max(GAP * usual, 1.0)).sum()), 1 / usual if usual > 0 else np.nan
        rows.append(SeriesRow(name, of, len(time), rate, first, last, gaps, longest, time, source))
    return rows


def count_measurements(log: TeamLog) -> tuple[tuple[str, ...], tuple[str, ...], Array]:
    """Return the names of robots, of all they measured, and how often (robots, measured); channels together."""
    names = (*log.robots, *log.landmarks.names, *log.anchors.names)
    counts = np.zeros((len(log.robots), len(names)))
    for channel, r in log.readings.items():
        first = names.index(other_names(log, channel)[0])
        np.add.at(counts, (r.robot, first + r.other), 1)
    return log.robots, names, counts


# --- The trial of a log.toml


def try_draft(data: Path, description: schema.TeamDescription) -> Trial:
    """Simulate every run in a directory; return what is judged of each, or why they do not run."""
    lines = []
    try:
        scenario = TeamScenario.from_description(data, description)
        for k in range(scenario.count()):
            run = scenario.at([k])
            truth, stream = run.simulate("log", [k], 0, run.world())
            if not truth.valid.any():
                raise BadInput(f"run {run.run!r}: no true position is known in the part that is judged")
            seconds = stream.world.tick * len(stream.time)
            robots = count_of(stream.robots, "robot")
            weak = f"; it {NO_ORDER}: " + "; ".join(reasons) if (reasons := run.weaknesses(truth, stream)) else ""
            known = f", in {truth.valid.mean():.0%} of which the truth is known" if truth.valid.mean() < 0.9 else ""
            lines.append(f"run {run.run!r}: {robots}, {float(f'{seconds:.3g}'):g} s are judged{known}{weak}")
            lines.append(f"run {run.run!r}: {run.judged_run.choice}")
        lines += scenario.left_out.values()
    except BadInput as e:
        return Trial(str(e))
    return Trial("", tuple(lines), tuple(scenario.faults()))


def common_robots(log: TeamLog) -> tuple[str, ...]:
    """Return the robots with truth, without those that leave less than a tenth of the time in which all are there."""
    kept = [i for i, truth in enumerate(log.truth) if truth is not None] or list(range(len(log.robots)))
    longest = max((common_span(log, [i]) for i in kept), default=0.0)
    while len(kept) > 1 and common_span(log, kept) < 0.1 * longest:
        kept = max(([j for j in kept if j != i] for i in kept), key=lambda some: common_span(log, some))
    return tuple(log.robots[i] for i in kept)

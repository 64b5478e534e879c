"""A drafted log.toml: its lines and tables, each with its reason, and its text."""

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.inspect.columns import FAR
from cooploc.scenarios.recordings.inspect.findings import Finding
from cooploc.scenarios.recordings.sampling import span
from cooploc.scenarios.recordings.schema import UNITS, Sample
from cooploc.scenarios.recordings.team_log import TeamLog, arena_around

WIDEST = 100  # characters in a line before its comment moves above it


class Entry(NamedTuple):
    """A line: a key, its value, and where the value comes from."""

    key: str
    value: Any
    why: str
    sure: str = "sure"  # or "likely", "perhaps"


class DraftTable(NamedTuple):
    """A table; several may have the same name."""

    name: str
    entries: tuple[Entry, ...]
    remarks: tuple[str, ...] = ()  # comments above its lines


class Draft(NamedTuple):
    """The tables of a log.toml, guessed before the recording is read."""

    entries: tuple[Entry, ...]  # outside of tables
    tables: tuple[DraftTable, ...] = ()
    columns: tuple[tuple[str, str, str, str], ...] = ()  # file or topic, column, its probable meaning, why
    unused: tuple[str, ...] = ()  # files, columns and topics that are not used, and why
    doubts: tuple[Finding, ...] = ()  # guesses that may be wrong

    def text(self, head: Iterable[str] = ()) -> str:
        """Return log.toml: comments at its head, its keys outside of tables, its tables."""
        names = [table.name for table in self.tables]
        blocks = ["\n".join(f"# {line}" for line in head), "\n".join(map(_line, self.entries))]
        for table in self.tables:
            name = f"[{table.name}]" if names.count(table.name) == 1 else f"[[{table.name}]]"
            blocks.append("\n".join([name, *(f"# {line}" for line in table.remarks), *map(_line, table.entries)]))
        return "\n\n".join(blocks) + "\n"


def in_unit(draft: Draft, names: Collection[str], unit: str) -> Draft:
    """Return the draft with lengths in m or cm, in these tables, where their span alone was for another unit."""
    tables, plain, why = [], set[str](), f"values span far, but in {unit} they fit what else was recorded"
    for table in draft.tables:
        guessed = {e.key: e for e in table.entries if FAR in e.why and table.name in names}
        units = [e.value["unit"] if isinstance(e.value, dict) else e.value for e in guessed.values()]
        entries = [e for e in table.entries if not (e.key == "unit" and e.key in guessed)]
        for k, e in enumerate(entries):
            if e.key in guessed:
                column = e.value["column"]
                entries[k] = Entry(e.key, column if unit == "m" else {"column": column, "unit": unit}, why, "likely")
                plain.add(column)
            elif e.key == "missing_from" and units:
                in_units = e.value * UNITS["m"][unit] / UNITS["m"][units[0]]
                entries[k] = e._replace(value=float(f"{in_units:.3g}"))
        tables.append(table._replace(entries=tuple(entries)))
    rows = [
        (*r[:2], f"{r[2].split(' ')[0]} [{unit}]", why) if r[1] in plain and FAR in r[3] else r for r in draft.columns
    ]
    return draft._replace(tables=tuple(tables), columns=tuple(rows))


def complete_draft(path: Path, draft: Draft, log: TeamLog, findings: tuple[Finding, ...], runs: int) -> Draft:
    """Return the draft with settings that follow from the recording, and findings beside them."""
    name = _one_line(path.resolve().name)
    about = Entry("about", f"recording {name}", "shown in reports; say who recorded it, and where", "perhaps")
    tables = [*draft.tables, *_settings(log, runs)]
    remarks: dict[str, list[str]] = {}
    for f in findings:
        place = f.table if f.table in {table.name for table in tables} else "model"
        remarks.setdefault(place, []).append(_remark(f))
    for i, table in enumerate(tables):  # of several tables of a name, in the first
        tables[i] = table._replace(remarks=(*table.remarks, *remarks.pop(table.name, ())))
    if "model" in remarks:
        tables.append(DraftTable("model", (), (*remarks["model"], "What is not stated here is fitted.")))
    return draft._replace(entries=(*draft.entries, about, *_arena(log)), tables=tuple(tables))


def head_lines(path: Path, why: str, draft: Draft) -> list[str]:
    """Return the comments at the head of log.toml; `why` it has the format that it has."""
    return [
        f"What the recordings in {_one_line(path.resolve().name)} mean, as `cooploc inspect` guesses ({why}).",
        "Each line says where its value comes from, and how sure that is: sure, likely or perhaps. Correct what is",
        "wrong, and run it: cooploc run log --data DIR. What was FOUND stands where it belongs, and changes nothing.",
        *(f"Not used: {_one_line(line)}" for line in draft.unused),
    ]


def _remark(f: Finding) -> str:
    whose = f"{f.kind}{', ' * bool(f.robot)}{f.robot}" + f" ({Path(f.source).name})" * bool(f.source)
    change = f"Nothing to change: {f.nothing}" if f.nothing else f"To change: {f.setting_of_columns}"
    return _one_line(f"FOUND ({f.sure}): {whose}: {f.fact}. {change}")


# --- Settings that follow from the recording

TICKS = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # [s]
ON_CHANGE, LONGEST_HELD = 5.0, 10.0  # usual intervals that every twentieth line has, and [s] that a speed holds then
FIRST_PART = 60.0  # [s] that models are fitted on, at most a third of the recording


def _arena(log: TeamLog) -> tuple[Entry, ...]:
    """Return the line `arena = ...`: around the truth, unless fixed things to take it from surround that."""
    fixed = np.concatenate([log.anchors.positions, log.landmarks.positions])
    places = np.concatenate([s.values[:, :2] for s in log.truth if s is not None] + [fixed])
    places = places[np.isfinite(places).all(axis=1)]
    low, high = arena_around(fixed) if len(fixed) > 1 else (np.inf, -np.inf)
    if not len(places) or ((places >= low) & (places <= high)).all():
        return ()
    corners = [np.floor(places.min(axis=0) - 1.0).tolist(), np.ceil(places.max(axis=0) + 1.0).tolist()]
    why = "whole metres around the truth, which estimators must not know so well: write the corners of the room"
    return (Entry("arena", corners, why, "perhaps"),)


def _settings(log: TeamLog, runs: int) -> tuple[DraftTable, ...]:
    """Return [sample], [prior] and [fit] for a recording of so many runs."""
    stamps = [s.time for s in log.odometry if len(s.time) > 1]
    usual, of_truth = (
        float(np.median([float(np.median(np.diff(s.time))) for s in every if s and len(s.time) > 1] or [0.1]))
        for every in (log.odometry, log.truth)
    )
    length = common_span(log) or max((float(t[-1] - t[0]) for t in stamps), default=FIRST_PART)
    tick = next((t for t in TICKS if t >= 0.99 * max(usual, 0.1)), TICKS[-1])
    max_gap = round(max(0.5, 5 * usual, 2 * of_truth), 3)
    sample: tuple[Entry, ...] = (
        Entry("tick", tick, f"[s] odometry comes every {usual:.3g} s"),
        Entry("max_gap", max_gap, "[s] five intervals of odometry or two of the truth, at least 0.5", "likely"),
    )
    hold, why = (
        max((float(np.quantile(np.diff(t), 0.95)) for t in stamps), default=0.0),
        "as odometry is written seldom",
    )
    if hold > ON_CHANGE * usual:
        longest = max(float(np.diff(t).max()) for t in stamps)
        hold, why = min(longest, LONGEST_HELD), "as lines come at irregular times: they are written on change, perhaps"
    if log.odometry_kind in ("velocity", "path") and 1.5 * hold > Sample().max_hold:
        why = f"[s] some speeds hold so long, {why}"
        sample = (*sample, Entry("max_hold", float(f"{1.5 * hold:.2g}"), why, "perhaps"))
    headed = all(s is None or np.isfinite(s.values[:, 2]).any() for s in log.truth) and any(log.truth)
    why = "the truth has a heading" if headed else "the truth has no heading: the direction of the first motion"
    prior = (
        Entry("position", "first truth", "what the team knows of its start", "perhaps"),
        Entry("position_sd", 0.05, "[m] how well it knows it; usual for a marked start", "perhaps"),
        Entry("heading", "first truth" if headed else "first motion", why, "likely"),
        Entry("heading_sd", 0.05 if headed else 0.2, "[rad]", "perhaps"),
    )
    fit: tuple[Entry, ...] = (Entry("on", "other runs", f"there are {runs} runs: none is fitted on itself"),)
    if runs < 2:
        seconds = float(f"{min(FIRST_PART, length / 3):.3g}")
        fit = (
            Entry("on", "first part", "there is one run: models are fitted on its beginning, which is not judged"),
            Entry("seconds", seconds, f"[s] of {length:.4g}: a minute, at most a third", "likely"),
        )
    return DraftTable("sample", sample), DraftTable("prior", prior), DraftTable("fit", fit)


# What is assumed of a recording that is too short to be fitted on a part of it, by parameter of [model].
ASSUMED = {"length_scale": 1.0, "turn_scale": 1.0, "sigma_v": 0.05, "sigma_omega": 0.1, "sigma_move": 0.02}
ASSUMED |= {"range_bias": 0.0, "range_sigma": 0.2, "anchor_range_bias": 0.0, "anchor_range_sigma": 0.2}
ASSUMED |= {"A": -40.0, "eta": 2.0, "rssi_sigma": 4.0, "anchor_A": -40.0, "anchor_eta": 2.0, "anchor_rssi_sigma": 4.0}
ASSUMED |= {f"{of}_sigma_range": 0.15 for of in ("sighting", "landmark")}
ASSUMED |= {f"{of}_sigma_bearing": 0.05 for of in ("sighting", "landmark")}


def assume_models(draft: Draft, lacking: Collection[str]) -> Draft:
    """Return the draft with the models that are lacking assumed; if odometry's are, all are, and nothing is fitted."""
    short = any(name in lacking for name in ("sigma_v", "sigma_omega", "sigma_move"))
    why = "assumed, as too few are where models are fitted: write what is known, or a later end of that part"
    if short:
        why = "assumed, as the recording is too short to be fitted on a part of it: write what is known"
    entries = tuple(Entry(key, value, why, "perhaps") for key, value in ASSUMED.items() if short or key in lacking)
    remarks = tuple(line for table in draft.tables if table.name == "model" for line in table.remarks)
    nothing = DraftTable("fit", (Entry("on", "nothing", "a part of the recording is too short"),))
    kept = [nothing if short and table.name == "fit" else table for table in draft.tables if table.name != "model"]
    return draft._replace(tables=(*kept, DraftTable("model", entries, remarks)))


def common_span(log: TeamLog, robots: Sequence[int] | None = None) -> float:
    """Return for how long all robots, or some, were recorded [s]; 0 where they share no time."""
    some = range(len(log.robots)) if robots is None else robots
    odometry, truth = tuple(log.odometry[i] for i in some), tuple(log.truth[i] for i in some)
    try:
        begin, end = span(log._replace(odometry=odometry, truth=truth))
    except BadInput:
        return 0.0
    ends = [series.time[-1] for series in truth if series is not None and len(series.time)]
    return max(float(min([end, *ends])) - begin, 0.0)


# --- Text


def _line(entry: Entry) -> str:
    """Return a line with its reason behind it, or above it where both are too long."""
    line, comment = f"{_key(entry.key)} = {toml(entry.value)}", f"# {entry.sure}: {_one_line(entry.why)}"
    return f"{line}  {comment}" if len(line) + len(comment) <= WIDEST else f"{comment}\n{line}"


def _key(key: str) -> str:
    plain = key and all(c.isascii() and (c.isalnum() or c in "_-") for c in key)
    return key if plain else toml(key)


def toml(value: Any) -> str:
    """Return a value as TOML: text, a number, a list, or an inline table."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _one_line(text: str) -> str:
    """Return text without line ends or other control characters, which would end a comment."""
    return "".join(c if c.isprintable() else " " for c in text)

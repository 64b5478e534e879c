"""Recordings of a team in CSV files, as `log.toml` describes them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.logs.columns import LogColumn
from cooploc.scenarios.recordings.team import schema
from cooploc.scenarios.recordings.team.channels import Measured, divided
from cooploc.scenarios.recordings.team.csv_source import Rows, measured, rows_of
from cooploc.scenarios.recordings.team.places_file import places
from cooploc.scenarios.recordings.team.robot_series import odometry_of, truth_of
from cooploc.scenarios.recordings.team.schema import TeamDescription
from cooploc.scenarios.recordings.team.series import in_order
from cooploc.scenarios.recordings.team.team_log import Channel, Readings, Series, TeamLog


def runs(data: Path, description: TeamDescription) -> dict[str, Path]:
    """The runs in a directory: itself, if its files are there, else each directory in it that has them.

    Raises:
        BadInput: there are none.

    """
    file = (description.odometry.file if description.odometry else None) or ""
    pattern = file.replace("{robot}", "*").replace("[", "[[]")
    if any(data.glob(pattern)):
        return {data.resolve().name: data}
    found = {place.name: place for place in sorted(data.iterdir()) if place.is_dir() and any(place.glob(pattern))}
    if not found:
        raise BadInput(
            f"{data}: neither it nor a directory in it has a file {file}; put the runs there, or "
            "correct `file` in [odometry] of log.toml"
        )
    return found


def read(data: Path, place: Path, name: str, description: TeamDescription) -> TeamLog:
    """One run.

    Raises:
        BadInput: a file or column is missing, or a line is malformed; names file, line and remedy.

    """
    if description.odometry is None or description.truth is None:
        raise BadInput(f"{data}: log.toml lacks [odometry] or [truth]; add the table")
    robots = description.robots
    warnings: list[str] = []
    moves, poses = description.odometry, description.truth
    columns = [getattr(moves, name) for name in schema.COLUMNS[moves.kind]]
    odometry = odometry_of(place, _by_robot(place, description, moves, columns, warnings), robots)
    found_poses = _by_robot(place, description, poses, [poses.x, poses.y, poses.heading], warnings)
    truth = truth_of(place, found_poses, robots, poses, warnings)
    anchors = places(data, description.anchors, description.delimiter)
    landmarks = places(data, description.landmarks, description.delimiter)
    readings: dict[Channel, Readings] = {}
    for kind, tables, fixed in (
        ("range", description.ranges, anchors.names),
        ("rssi", description.rssi, anchors.names),
        ("sighting", description.sightings, landmarks.names),
    ):
        several = [m for table in tables for m in _measured(place, description, table, (*robots, *fixed), warnings)]
        found, told = divided(kind, several, robots, fixed)  # type: ignore[arg-type]
        readings |= found
        warnings += told
    return TeamLog(
        name, robots, description.odometry.kind, odometry, truth, readings, landmarks, anchors, tuple(warnings)
    )


def _by_robot(
    place: Path, d: TeamDescription, table: schema.Source, columns: Sequence[LogColumn | None], warnings: list[str]
) -> Mapping[str, Series]:
    found: dict[str, list[Rows]] = {}
    for rows in rows_of(place, table, columns, d.robots, (), d.delimiter):
        warnings += [rows.lines.cut_off] if rows.lines.cut_off else []
        for robot in dict.fromkeys(rows.robot):
            found.setdefault(robot, []).append(rows.of(robot))
    ordered = {}
    for robot, (rows, *_) in found.items():
        if robot not in d.robots:
            warnings.append(
                f"{rows.lines.path}: {len(rows.time)} lines of {robot!r}, which is not in `robots`, were left out"
            )
            continue
        ordered[robot], told = in_order(rows.time, rows.values, str(rows.lines.path), rows.lines.at)
        warnings += told
    return ordered


def _measured(
    place: Path, d: TeamDescription, table: schema.Readings, names: Sequence[str], warnings: list[str]
) -> list[Measured]:
    each: Mapping[str, LogColumn] = getattr(table, "each", {})
    columns = list(each.values()) or [getattr(table, name) for name in VALUES[type(table)]]
    found = []
    for rows in rows_of(place, table, columns, d.robots, names, d.delimiter):
        warnings += [rows.lines.cut_off] if rows.lines.cut_off else []
        if np.isnan(rows.time).any():
            where = rows.lines.at(int(np.argmax(np.isnan(rows.time))))
            raise BadInput(f"{where}: the stamp is missing; correct or remove the line")
        one = measured(rows, list(each))
        if isinstance(table, schema.Rssi):
            one.values[one.values >= table.missing_from] = np.nan
        found.append(one)
    return found


VALUES: Mapping[type[schema.Readings], tuple[str, ...]] = {
    schema.Ranges: ("range",),
    schema.Rssi: ("rssi",),
    schema.Sightings: ("range", "bearing"),
}

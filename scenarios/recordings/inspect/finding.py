"""Findings of an inspection: a fact, its place, how sure it is, and the setting of log.toml that would correct it.

A finding is reported, never applied: it comes from the truth, which would otherwise reach the estimators that are
judged by that same truth.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from cooploc.scenarios.recordings.team_log import Channel, Readings, Series, TeamLog

FOR_ALL_ROBOTS = ("unit", "degrees", "radians", "clock", "axes", "mirrored")  # kinds whose setting is for every robot
Table = TypeVar("Table", Series, Readings)


class Finding(NamedTuple):
    """One thing that is odd about a recording.

    Kinds: unit, degrees, radians (read as another unit), clock (stamps with an offset), robots (files or names of two
    were exchanged), axes (x and y exchanged), mirrored (left is right), frame (turned against odometry's), heading
    (clockwise, or with an offset), turn sign (positive to the right), scale (odometry too long or short), speed (that
    no ground robot reaches), jump (away and back), stale (positions that repeat), outside (of the arena), gap, span
    (begins late or ends early), bias (of ranges), bearing, rssi and dropped (what could not be read).
    """

    kind: str
    robot: str  # whose data it is; "" if it is not one robot's
    source: str  # file or topic
    fact: str  # what was measured, with its numbers
    sure: str  # "sure", "likely" or "perhaps"
    setting: str  # what to write in log.toml, or in words where the files themselves must be corrected
    table: str = ""  # of log.toml: "truth", "odometry" or a channel of readings
    columns: tuple[str, ...] = ()  # quantities in the table that it is about, such as x, y

    @property
    def change(self) -> str:
        """The setting that corrects it, with its table: [truth] clock_offset = -2.5."""
        return f"[{self.table}] " * bool(self.table) + self.setting_of_columns

    @property
    def setting_of_columns(self) -> str:
        """The setting, with the columns it is about."""
        return ", ".join(self.columns) + ": " * bool(self.columns) + self.setting


@dataclass
class CheckedLog:
    """A recording under inspection: findings so far, and the data with them corrected, for the next checks."""

    log: TeamLog
    findings: list[Finding] = field(default_factory=list)

    def add(self, kind: str, robot: int | None, *facts: Any) -> None:
        """Add a finding about a robot or, if it is None, about none; `facts` are the other fields of a `Finding`."""
        name = "" if robot is None else self.log.robots[robot]
        self.findings.append(Finding(kind, name, *facts))

    def correct(self, table: str, robot: int, series: Series) -> None:
        """Replace one robot's "truth" or "odometry"."""
        every = list(getattr(self.log, table))
        every[robot] = series
        changed: dict[str, Any] = {table: tuple(every)}
        self.log = self.log._replace(**changed)

    def correct_readings(self, channel: Channel, readings: Readings) -> None:
        """Replace the readings of one channel."""
        self.log = self.log._replace(readings={**self.log.readings, channel: readings})

    def result(self) -> tuple[Finding, ...]:
        """Return the findings; a setting that is for all robots becomes a remark where it holds for some alone."""
        found = []
        for f in self.findings:
            alike = {g.robot for g in self.findings if (g.kind, g.table) == (f.kind, f.table)}
            if f.robot and len(alike) < len(self.log.robots) and f.kind in FOR_ALL_ROBOTS:
                remark = f"; it is for all robots, so correct {Path(f.source).name} where the others are right"
                f = f._replace(setting=f.setting + remark)
            found.append(f)
        return tuple(found)


def divide_columns(series: Table, factor: float, columns: tuple[int, ...]) -> Table:
    """Return a series or readings with some columns of values divided by a factor."""
    factors = np.ones(series.values.shape[1])
    factors[list(columns)] = 1 / factor
    return series._replace(values=series.values * factors)

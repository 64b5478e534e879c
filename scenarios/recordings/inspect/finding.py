"""What an inspection found: the fact, the place, how sure that is, and the setting of log.toml that would correct it.

A finding is reported, never applied: it comes from the truth, which would otherwise reach the estimators that are
judged by that same truth.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.team_log import Channel, Readings, Series, TeamLog

Sure = Literal["sure", "likely", "perhaps"]
Kind = Literal[
    "unit",  # lengths in mm or cm that were read as metres, or the other way round
    "degrees",  # angles in degrees that were read as radians
    "radians",  # angles in radians that were read as degrees
    "clock",  # a file whose stamps are those of the others plus an offset
    "robots",  # the files or names of two robots were exchanged
    "axes",  # x and y were exchanged
    "mirrored",  # a frame in which left is right
    "frame",  # positions in a frame that is turned against that of odometry
    "heading",  # a heading that is not counter-clockwise from x, or that has an offset
    "turn sign",  # a turn rate that is positive to the right
    "scale",  # odometry that is too long or too short by a factor
    "speed",  # a speed that no ground robot reaches
    "jump",  # positions that jump away and back
    "stale",  # positions that repeat while the robot moves
    "outside",  # positions outside the arena
    "gap",  # an interval without lines in a series that is otherwise regular
    "span",  # a series that begins late or ends early
    "bias",  # ranges that are too long or too short by a constant
    "bearing",  # bearings that do not point where the truth says
    "rssi",  # signal strength that does not fall with distance as radio does
    "dropped",  # lines that could not be read
]
FOR_ALL_ROBOTS = ("unit", "degrees", "radians", "clock", "axes", "mirrored")  # whose setting is for every robot


class Finding(NamedTuple):
    """One thing that is odd about a recording."""

    kind: Kind
    robot: str  # whose data it is; "" if it is not one robot's
    source: str  # file or topic
    fact: str  # what was measured, with its numbers
    sure: Sure
    setting: str  # what to write in log.toml, or in words where the files themselves must be corrected
    table: str = ""  # of log.toml: "truth", "odometry" or a channel of readings
    columns: tuple[str, ...] = ()  # quantities in the table that it is about, such as x, y

    @property
    def change(self) -> str:
        """The setting that corrects it, with its table: [truth] clock_offset = -2.5."""
        return (f"[{self.table}] " if self.table else "") + self.setting_of_columns

    @property
    def setting_of_columns(self) -> str:
        """The setting, with the columns it is about."""
        return f"{', '.join(self.columns)}: {self.setting}" if self.columns else self.setting


@dataclass
class CheckedLog:
    """A recording under inspection: what was found so far, and the data with that corrected, for the next checks."""

    log: TeamLog
    findings: list[Finding] = field(default_factory=list)

    def add(self, kind: Kind, robot: int | None, *facts: Any) -> None:
        """Add a finding about a robot or, if it is None, about none; `facts` are the other fields of a `Finding`."""
        name = "" if robot is None else self.log.robots[robot]
        self.findings.append(Finding(kind, name, *facts))

    def correct_truth(self, robot: int, series: Series) -> None:
        """Replace one robot's truth."""
        self.log = self.log._replace(truth=(*self.log.truth[:robot], series, *self.log.truth[robot + 1 :]))

    def correct_odometry(self, robot: int, values: Array) -> None:
        """Replace the values of one robot's odometry."""
        odometry = self.log.odometry
        series = odometry[robot]._replace(values=values)
        self.log = self.log._replace(odometry=(*odometry[:robot], series, *odometry[robot + 1 :]))

    def correct_readings(self, channel: Channel, readings: Readings) -> None:
        """Replace the readings of one channel."""
        self.log = self.log._replace(readings={**self.log.readings, channel: readings})

    def result(self) -> tuple[Finding, ...]:
        """Return the findings; a setting that is for all robots becomes a remark where it holds for some alone."""
        return tuple(self._for_some(f) for f in self.findings)

    def _for_some(self, f: Finding) -> Finding:
        alike = {g.robot for g in self.findings if (g.kind, g.table) == (f.kind, f.table)}
        if not f.robot or len(alike) == len(self.log.robots) or f.kind not in FOR_ALL_ROBOTS:
            return f
        where = f"; it is for all robots, so correct {Path(f.source).name} where the others are right"
        return f._replace(setting=f.setting + where)


def divide_columns(values: Array, factor: float, columns: tuple[int, ...]) -> Array:
    """Return values (m, k) with some columns divided by a factor."""
    factors = np.ones(values.shape[1])
    factors[list(columns)] = 1 / factor
    return values * factors

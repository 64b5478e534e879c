"""Findings of an inspection: what is odd about a recording, and the data with that corrected, for the next checks."""

import re
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar

import numpy as np

from cooploc.scenarios.recordings.team_log import ReadingSeries, Series, TeamLog

Values = TypeVar("Values", Series, ReadingSeries)


NO_SETTING = "nothing: "  # begins what stands in place of a setting


class Finding(NamedTuple):
    """A fact about a recording that is odd, its place, and the setting of log.toml that would correct it.

    Kinds: unit, degrees, radians (read as another unit), clock (stamps with an offset), robots (truths of two were
    exchanged, or are one), axes (x and y exchanged), mirrored (left is right), frame (turned, or of each robot),
    heading (clockwise, held, or with an offset), turn sign (positive to the right), turn bias, sideways (moves of which
    speeds say nothing), dropout, jump (away), stale (positions that repeat), coarse (rounded, noisy or rare positions),
    gap, span (begins late or ends early), names (who measured whom), height, places (of anchors, landmarks), bias (of
    ranges), floor (of signals), signals (of another fall, or of unlike radios), bearing, and dropped (what could not be
    read).
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
    def setting_of_columns(self) -> str:
        """The setting, with the columns it is about."""
        columns = f"{', '.join(self.columns)}: " * bool(self.columns)
        return self.setting if self.nothing else columns + self.setting

    @property
    def change(self) -> str:
        """The setting that corrects it, with its table: [truth] clock_offset = -2.5."""
        return self.setting if self.nothing else f"[{self.table}] " * bool(self.table) + self.setting_of_columns

    @property
    def nothing(self) -> str:
        """Why there is no setting that corrects it; "" if there is one."""
        return self.setting.removeprefix(NO_SETTING) if self.setting.startswith(NO_SETTING) else ""


@dataclass
class CheckedLog:
    """A recording under inspection: findings so far, and the data with them corrected, for the next checks."""

    log: TeamLog
    findings: list[Finding] = field(default_factory=list)

    def add(self, kind: str, robot: int | None, *facts: Any) -> None:
        """Add a finding about a robot or, if it is None, about none; `facts` are the other fields of a `Finding`."""
        self.findings.append(Finding(kind, "" if robot is None else self.log.robots[robot], *facts))

    def correct(self, table: str, robot: int | None, data: Series | ReadingSeries | None) -> None:
        """Replace one robot's "truth" or "odometry"; without a robot, the readings of the channel `table`."""
        if robot is None:
            changed: dict[str, Any] = {"readings": {**self.log.readings, table: data}}
        else:
            every = getattr(self.log, table)
            changed = {table: (*every[:robot], data, *every[robot + 1 :])}
        self.log = self.log._replace(**changed)

    def join_offsets(self, *keys: str) -> None:
        """Write the offsets of all robots by one key into one setting, as a file has it once."""
        for key in keys:
            joint = re.compile(rf"(?<={key} = {{ ).*(?= }})")
            offsets = ", ".join(found[0] for f in self.findings if (found := joint.search(f.setting)))
            self.findings = [f._replace(setting=joint.sub(offsets, f.setting)) for f in self.findings]


def divide_columns(series: Values, factor: float, columns: tuple[int, ...]) -> Values:
    """Return a series or readings with some columns of values divided by a factor."""
    factors = np.ones(series.values.shape[1])
    factors[list(columns)] = 1 / factor
    return series._replace(values=series.values * factors)


# What checks of motion and of readings have in common.

EVIDENCE = 5.0  # standard errors that a shift, a scale or a bias must have
FOLLOWS = 0.6  # mean resultant length from which one direction follows another
LONGEST_DELAY, LEAST_DELAY = 5.0, 0.1  # [s] of ranges, or of a gyroscope, against the truth
# Values that were read as SI are so many times too large: kind of the finding, unit to write, factor.
Unit = tuple[str, str, float]
LENGTH_UNITS = (("unit", "mm", 1000.0), ("unit", "cm", 100.0), ("unit", "m", 0.01), ("unit", "m", 0.001))


def unit_of_ratio(ratio: float, units: tuple[Unit, ...], near: float) -> Unit | None:
    """Return the unit whose factor the ratio of measured to true values has, up to a factor of `near`."""
    return next((unit for unit in units if unit[2] / near < ratio < unit[2] * near), None)

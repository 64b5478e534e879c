"""What a look at a recording found: the fact, the place, how sure that is, and the setting that would correct it.

A finding is said, never applied: what it says about the truth would otherwise reach the estimators that are judged by
that same truth.
"""

from typing import Literal, NamedTuple

from cooploc.scenarios.recordings.team_log import TeamLog

Sure = Literal["sure", "likely", "perhaps"]

# Every kind of finding. A glitch has one name, wherever it is found.
KINDS: dict[str, str] = {
    "unit": "lengths in mm or cm that were read as metres, or the other way round",
    "degrees": "angles in degrees that were read as radians",
    "radians": "angles in radians that were read as degrees",
    "clock": "a file whose stamps are those of the others plus an offset",
    "robots": "the files or names of two robots were exchanged",
    "axes": "x and y were exchanged",
    "mirrored": "a frame in which left is right",
    "frame": "positions in a frame that is turned or shifted against that of the anchors or landmarks",
    "heading": "a heading that is not counter-clockwise from x, or that has an offset",
    "turn sign": "a turn rate that is positive to the right",
    "scale": "odometry that is too long or too short by a factor",
    "speed": "a speed that no ground robot reaches",
    "jump": "positions that leap away",
    "stale": "positions that repeat while the robot moves",
    "outside": "positions outside the arena",
    "gap": "an interval without lines in a series that is otherwise regular",
    "span": "a series that begins late or ends early",
    "bias": "ranges that are too long or too short by a constant",
    "bearing": "bearings that do not point where the truth says",
    "rssi": "signal strength that does not fall with distance as radio does",
    "dropped": "lines that could not be read",
}


class Change(NamedTuple):
    """The setting of log.toml to change: a table of it, the quantities in that table, and what to write there."""

    table: str  # "truth", "odometry" or a channel of readings
    names: tuple[str, ...]  # quantities in it, such as x, y; empty where the setting belongs to the whole table
    setting: str  # as in TOML, or in words where the files themselves must be corrected


class Finding(NamedTuple):
    """One thing that is odd about a recording."""

    kind: str  # a key of `KINDS`
    robot: str  # whose data it is; "" where it is not one robot's
    source: str  # file or topic
    fact: str  # what was measured, with its numbers
    sure: Sure
    change: Change


class Looked(NamedTuple):
    """What one look found, and the recording as it would be with that corrected, for the looks that follow."""

    findings: tuple[Finding, ...]
    log: TeamLog


def require_known(kind: str) -> str:
    """The kind of a finding, refused where it is not one of `KINDS`."""
    if kind not in KINDS:
        raise KeyError(kind)
    return kind

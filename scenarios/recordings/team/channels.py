"""Measurements between named things, divided into the channels of a team's log."""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.scenarios.recordings.team.team_log import READING_COLUMNS, Channel, Readings

Kind = Literal["range", "rssi", "sighting"]
OF_ROBOTS: Mapping[Kind, Channel] = {"range": "range", "rssi": "rssi", "sighting": "sighting"}
OF_FIXED: Mapping[Kind, Channel] = {"range": "anchor_range", "rssi": "anchor_rssi", "sighting": "landmark"}


class Measured(NamedTuple):
    """Measurements of one source, with names."""

    time: Array  # (m,) [s]
    robot: Sequence[str]  # (m,) who measured
    other: Sequence[str]  # (m,) what was measured
    values: Array  # (m, k)  nan where absent
    source: str  # file or topic


def divided(
    kind: Kind, several: Sequence[Measured], robots: Sequence[str], fixed: Sequence[str]
) -> tuple[dict[Channel, Readings], list[str]]:
    """Readings of teammates, and of fixed things (anchors; of a sighting, landmarks), sorted by time.

    A measurement by or of something that is neither is left out, as are one of oneself, one without a number and a
    range that is not positive; each is told in a warning.
    """
    parts: dict[Channel, list[Readings]] = {OF_ROBOTS[kind]: [], OF_FIXED[kind]: []}
    warnings: list[str] = []
    for one in several:
        robot, mate, thing = (
            _numbers(names, of) for names, of in ((one.robot, robots), (one.other, robots), (one.other, fixed))
        )
        there = np.isfinite(one.values).all(-1)
        positive = there & ((one.values[:, 0] > 0) | (kind == "rssi"))
        known, itself = (robot >= 0) & ((mate >= 0) | (thing >= 0)), (robot == mate) & (robot >= 0)
        warnings += _told(one, robot < 0, one.robot, "measured by {}, which is not a robot of the team")
        warnings += _told(one, (robot >= 0) & ~known, one.other, "of {}, which is not a robot of the team, nor a place")
        warnings += _told(one, known & itself, one.robot, "of {} by itself")
        warnings += _told(one, there & ~positive, one.robot, "by {} that are not positive")
        good = known & ~itself & positive
        for channel, other in ((OF_ROBOTS[kind], mate), (OF_FIXED[kind], thing)):
            rows = np.flatnonzero(good & (other >= 0))
            parts[channel].append(Readings(one.time[rows], robot[rows], other[rows], one.values[rows], one.source))
    return {
        channel: _joined(channel, part) for channel, part in parts.items() if sum(len(p.time) for p in part)
    }, warnings


def _numbers(names: Sequence[str], known: Sequence[str]) -> Indices:
    """The index of each name among those known, -1 where it is not one."""
    index = {name: i for i, name in enumerate(known)}
    return np.array([index.get(name, -1) for name in names], np.int64)


def _told(one: Measured, dropped: Mask, names: Sequence[str], what: str) -> list[str]:
    rows = np.flatnonzero(dropped).tolist()
    if not rows:
        return []
    whose = sorted({names[row] for row in rows})
    shown = ", ".join(repr(name) for name in whose[:3]) + (f" and {len(whose) - 3} more" if len(whose) > 3 else "")
    return [f"{one.source}: {len(rows)} readings {what.format(shown)}, were left out"]


def _joined(channel: Channel, parts: Sequence[Readings]) -> Readings:
    """One table of several, by rising stamps."""
    time, robot, other = (np.concatenate([part[i] for part in parts]) for i in range(3))
    values = np.concatenate([part.values.reshape(-1, len(READING_COLUMNS[channel])) for part in parts])
    order = np.argsort(time, kind="stable")
    sources = dict.fromkeys(part.source for part in parts if len(part.time))
    return Readings(
        time[order], robot[order].astype(np.int64), other[order].astype(np.int64), values[order], ", ".join(sources)
    )

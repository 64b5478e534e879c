"""Reads one run of a user's log: a CSV file whose columns a description names.

What was not recorded becomes nan and is counted: readings that mean "missing", truth that repeats a stale position or
jumps, commands across a gap.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Mask
from cooploc.scenarios.recordings.logs.columns import LogColumn
from cooploc.scenarios.recordings.logs.csv_table import read_csv
from cooploc.scenarios.recordings.logs.schema import Description
from cooploc.scenarios.recordings.text_tables import Table

GAP = 5.0  # [median intervals] a longer interval is a gap, unless the description gives max_gap


class LogRun(NamedTuple):
    """One run. Row 0 is before the first tick; odometry k leads from row k to row k + 1."""

    path: Path
    stamp: Array  # (T + 1,)     as in the file [s]
    time: Array  # (T + 1,)     since row 0, to the nanosecond [s]
    odometry: Array  # (T, 2)       v [m/s], omega [rad/s]; of displacements dx, dy [m]
    known: Mask  # (T,)         False across gaps
    rssi: Array  # (T + 1, a)   [dBm]
    truth: Array  # (T + 1, 3)   x [m], y [m], heading [rad]; nan where unknown
    rows: Array  # (T + 1, c)   as in the file, to find lines that two files share
    counts: dict[str, Any]  # what was dropped

    @property
    def dt(self) -> Array:
        """Length of each tick (T,) [s]."""
        return np.diff(self.time)

    @property
    def t0(self) -> float:
        """The stamp of row 0 [s]."""
        return float(self.stamp[0])

    @property
    def tick(self) -> float:
        """The median length of a tick [s]."""
        return float(np.median(self.dt))

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self.path.stem

    def shared_lines(self, other: "LogRun") -> int:
        """How many lines two runs have in common, digit by digit."""
        _, i, j = np.intersect1d(self.stamp, other.stamp, return_indices=True)
        a, b = self.rows[i], other.rows[j]
        return int(((a == b) | (np.isnan(a) & np.isnan(b))).all(-1).sum())


def read_run(path: Path, description: Description) -> LogRun:
    """One run from its CSV file.

    Raises:
        BadInput: a column is missing, a field is not a number, or the stamps do not rise; names file and line.

    """
    named: dict[str, tuple[LogColumn, ...]] = {
        "time": description.time.columns,
        "odometry": tuple(getattr(description.odometry, name) for name in _odometry_columns(description)),
        "truth": tuple(c for c in (description.truth.x, description.truth.y, description.truth.heading) if c),
        "rssi": description.anchors.rssi if description.anchors else (),
        "status": description.anchors.status if description.anchors else (),
    }
    columns = [column for group in named.values() for column in group]
    table = read_csv(path, [column.column for column in columns], description.delimiter)
    ends = np.cumsum([0, *(len(group) for group in named.values())])
    part = {name: np.s_[:, a:b] for name, a, b in zip(named, ends[:-1], ends[1:], strict=True)}
    table, unplaced = _from_first_truth(table, part["truth"])
    raw, factor = table.values, np.array([column.factor for column in columns])
    time = _elapsed(table, raw[part["time"]], factor[: ends[1]])
    scaled = raw * factor
    truth, lost = _truth(description, time, scaled[part["truth"]])
    rssi, missing = _rssi(description, scaled[part["rssi"]], raw[part["status"]])
    odometry, known = _odometry(description, time, scaled[part["odometry"]])
    counts = {
        "before_first_truth": unplaced,
        **lost,
        "rssi_missing": missing,
        "odometry_missing": int((np.isnan(odometry).any(-1) & known).sum()),
        "gaps": [
            {"line": int(table.line[k + 1]), "seconds": round(float(time[k + 1] - time[k]), 3)}
            for k in np.flatnonzero(~known)
        ],
    }
    return LogRun(path, scaled[:, : ends[1]].sum(-1), time, odometry, known, rssi, truth, raw, counts)


def _from_first_truth(table: Table, truth: Any) -> tuple[Table, int]:
    """The table from the first line on whose truth is known, and how many lines were before it."""
    there = ~np.isnan(table.values[truth]).any(-1)
    first = int(np.argmax(there))
    if there[first:].sum() < 2:
        raise BadInput(f"{table.path}: fewer than two lines have a truth; check the columns named in [truth]")
    return Table(table.path, table.values[first:], table.line[first:]), first


def _elapsed(table: Table, stamps: Array, factor: Array) -> Array:
    """Seconds since the first line; the columns are subtracted before they are summed, which keeps the nanoseconds."""
    time: Array = ((stamps - stamps[0]) * factor).sum(-1)
    bad = np.isnan(time)
    bad[1:] |= ~(np.diff(time) > 0)
    if bad.any():
        row = int(np.argmax(bad))
        later = 0.0 if row == 0 else time[row - 1] - time[row]
        fact = f"is {later:g} s before the previous line's" if later else "equals the previous line's"
        fact = "is missing" if np.isnan(time[row]) else fact
        raise BadInput(f"{table.at(row)}: its stamp {fact}; sort the file by time, or remove the line")
    return time


def _odometry_columns(description: Description) -> tuple[str, str]:
    return {"path": ("length", "turn_rate"), "velocity": ("speed", "turn_rate"), "displacement": ("dx", "dy")}[
        description.odometry.kind
    ]


def _odometry(description: Description, time: Array, values: Array) -> tuple[Array, Mask]:
    """Odometry (T, 2) between the lines, and where it is known.

    Across a gap a speed or a turn rate is unknown (nan), as it may have changed; a counter still gives the distance.
    """
    dt = np.diff(time)
    known: Mask = dt <= (description.time.max_gap or GAP * np.median(dt))
    if description.odometry.kind == "displacement":
        return values[1:], known
    held = values[:-1] if description.odometry.holds == "until the next line" else values[1:]
    u = np.where(known[:, None], held, np.nan)
    if description.odometry.kind == "path":
        u[:, 0] = np.diff(values[:, 0]) / dt
    return u, known


def _rssi(description: Description, rssi: Array, status: Array) -> tuple[Array, list[int]]:
    """Readings with nan where they are missing, and how many are, by anchor."""
    if description.anchors is None:
        return rssi, []
    missing = np.isnan(rssi) | (rssi >= description.anchors.missing_from)
    if status.shape[1]:
        missing |= ~(np.nan_to_num(status) != 0)
    return np.where(missing, np.nan, rssi), missing.sum(0).tolist()


def _truth(description: Description, time: Array, values: Array) -> tuple[Array, dict[str, Any]]:
    """True poses (T + 1, 3), nan where they are not valid, and how many are not, by reason."""
    absent = np.isnan(values).any(-1)
    stale = np.zeros(len(time), bool)
    if description.truth.repeats == "stale":
        stale[1:] = (np.diff(values[:, :2], axis=0) == 0).all(-1)
    use = ~absent & ~stale
    jumped = _unreachable(time, values[:, :2], use, description.truth.max_speed or np.inf)
    heading = values[:, 2:] if values.shape[1] > 2 else np.full((len(time), 1), np.nan)
    poses = np.where((use & ~jumped)[:, None], np.concatenate([values[:, :2], heading], -1), np.nan)
    reasons = {"absent": absent, "stale": stale & ~absent, "jumps": jumped}
    return poses, {f"truth_{reason}": int(mask.sum()) for reason, mask in reasons.items()}


def _unreachable(time: Array, positions: Array, use: Mask, speed: float) -> Mask:
    """Positions that cannot be reached from the last valid one at `speed` [m/s]."""
    bad, last = np.zeros(len(time), bool), 0
    for k in map(int, np.flatnonzero(use)[1:]):
        bad[k] = np.hypot(*(positions[k] - positions[last])) > speed * (time[k] - time[last])
        last = last if bad[k] else k
    return bad

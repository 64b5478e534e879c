"""Reading one run of a user's own log: a CSV file whose columns a description names.

What was not recorded becomes nan and is counted: readings that mean "missing", truth that stood still while its robot
drove or jumped, commands across a gap.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.recordings.logs.columns import Column
from cooploc.scenarios.recordings.logs.csv_table import read_csv
from cooploc.scenarios.recordings.logs.schema import Description
from cooploc.scenarios.recordings.text_tables import Table

GAP = 5.0  # median intervals; a longer one is a gap where the description does not say


class Run(NamedTuple):
    """One run. Row 0 is before the first tick; odometry k leads from row k to row k + 1."""

    path: Path
    stamp: Array  # (T + 1,)     as they stand in the file [s]
    time: Array  # (T + 1,)     since row 0, to the nanosecond [s]
    odometry: Array  # (T, 2)       v [m/s], omega [rad/s]; of displacements dx, dy [m]
    known: Mask  # (T,)         False across gaps
    rssi: Array  # (T + 1, a)   [dBm]
    truth: Array  # (T + 1, 3)   x [m], y [m], heading [rad]; nan where nobody knows
    rows: Array  # (T + 1, c)   as they stand in the file, to find what is in two files
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
        """The file's, without its ending."""
        return self.path.stem

    def shares(self, other: "Run") -> int:
        """How many lines two runs have in common, digit by digit."""
        _, i, j = np.intersect1d(self.stamp, other.stamp, return_indices=True)
        a, b = self.rows[i], other.rows[j]
        return int(((a == b) | (np.isnan(a) & np.isnan(b))).all(-1).sum())


def read_run(path: Path, about: Description) -> Run:
    """One CSV file.

    Raises:
        BadInput: a column is not there, something is no number, or the stamps do not rise; names file and line.

    """
    named: dict[str, tuple[Column, ...]] = {
        "time": about.time.columns,
        "odometry": tuple(getattr(about.odometry, name) for name in _odometry_columns(about)),
        "truth": tuple(c for c in (about.truth.x, about.truth.y, about.truth.heading) if c),
        "rssi": about.anchors.rssi if about.anchors else (),
        "status": about.anchors.status if about.anchors else (),
    }
    columns = [column for group in named.values() for column in group]
    table = read_csv(path, [column.column for column in columns], about.delimiter)
    ends = np.cumsum([0, *(len(group) for group in named.values())])
    part = {name: np.s_[:, a:b] for name, a, b in zip(named, ends[:-1], ends[1:], strict=True)}
    table, unplaced = _from_first_truth(table, part["truth"])
    raw, factor = table.values, np.array([column.factor for column in columns])
    time = _elapsed(table, raw[part["time"]], factor[: ends[1]])
    scaled = raw * factor
    truth, lost = _truth(about, time, scaled[part["truth"]])
    rssi, missing = _rssi(about, scaled[part["rssi"]], raw[part["status"]])
    odometry, known = _odometry(about, time, scaled[part["odometry"]])
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
    return Run(path, scaled[:, : ends[1]].sum(-1), time, odometry, known, rssi, truth, raw, counts)


def _from_first_truth(table: Table, truth: Any) -> tuple[Table, int]:
    """The table from the first line on whose truth is known, and how many lines were before it."""
    there = ~np.isnan(table.values[truth]).any(-1)
    first = int(np.argmax(there))
    if there[first:].sum() < 2:
        raise BadInput(f"{table.path}: fewer than two lines have a truth; name its columns in [truth]")
    return Table(table.path, table.values[first:], table.line[first:]), first


def _elapsed(table: Table, stamps: Array, factor: Array) -> Array:
    """Seconds since the first line; the columns are subtracted before they are summed, which keeps the nanoseconds."""
    time: Array = ((stamps - stamps[0]) * factor).sum(-1)
    bad = np.isnan(time)
    bad[1:] |= ~(np.diff(time) > 0)
    if bad.any():
        row = int(np.argmax(bad))
        back = 0.0 if np.isnan(time[row]) else time[row - 1] - time[row]
        fact = f"its stamp is {back:g} s before the last line's" if back else "its stamp is the last line's"
        fact = "its stamp is missing" if np.isnan(time[row]) else fact
        raise BadInput(f"{table.at(row)}: {fact}; sort the file by time, or remove the line")
    return time


def _odometry_columns(about: Description) -> tuple[str, str]:
    return {"path": ("length", "turn_rate"), "velocity": ("speed", "turn_rate"), "displacement": ("dx", "dy")}[
        about.odometry.kind
    ]


def _odometry(about: Description, time: Array, values: Array) -> tuple[Array, Mask]:
    """Odometry (T, 2) between the lines, and where it is known.

    Across a gap a speed or a turn rate is unknown (nan): nothing says that it held. A counter knows how far it went.
    """
    dt = np.diff(time)
    known: Mask = dt <= (about.time.max_gap or GAP * np.median(dt))
    if about.odometry.kind == "displacement":
        return values[1:], known
    held = values[:-1] if about.odometry.holds == "until the next line" else values[1:]
    u = np.where(known[:, None], held, np.nan)
    if about.odometry.kind == "path":
        u[:, 0] = np.diff(values[:, 0]) / dt
    return u, known


def _rssi(about: Description, rssi: Array, status: Array) -> tuple[Array, list[int]]:
    """Readings with nan where they are missing, and how many are, by anchor."""
    if about.anchors is None:
        return rssi, []
    missing = np.isnan(rssi) | (rssi >= about.anchors.missing_from)
    if status.shape[1]:
        missing |= ~(np.nan_to_num(status) != 0)
    return np.where(missing, np.nan, rssi), missing.sum(0).tolist()


def _truth(about: Description, time: Array, values: Array) -> tuple[Array, dict[str, Any]]:
    """True poses (T + 1, 3), nan where they do not count, and how many do not, by reason."""
    absent = np.isnan(values).any(-1)
    stale = np.zeros(len(time), bool)
    if about.truth.repeats == "stale":
        stale[1:] = (np.diff(values[:, :2], axis=0) == 0).all(-1)
    use = ~absent & ~stale
    jumped = _unreachable(time, values[:, :2], use, about.truth.max_speed or np.inf)
    heading = values[:, 2:] if values.shape[1] > 2 else np.full((len(time), 1), np.nan)
    poses = np.where((use & ~jumped)[:, None], np.concatenate([values[:, :2], heading], -1), np.nan)
    reasons = {"absent": absent, "stale": stale & ~absent, "jumps": jumped}
    return poses, {f"truth_{reason}": int(mask.sum()) for reason, mask in reasons.items()}


def _unreachable(time: Array, places: Array, use: Mask, speed: float) -> Mask:
    """Places that lie farther from the last good one than `speed` reaches in the time between."""
    bad, last = np.zeros(len(time), bool), 0
    for k in map(int, np.flatnonzero(use)[1:]):
        bad[k] = np.hypot(*(places[k] - places[last])) > speed * (time[k] - time[last])
        last = last if bad[k] else k
    return bad

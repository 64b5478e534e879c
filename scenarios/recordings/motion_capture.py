"""What motion capture systems export, OptiTrack's Motive and Vicon's Tracker and Nexus, as a table with names.

Their CSV files name rigid bodies and axes in several lines above the numbers. Here each body has lines of its own, of
`time` [s], `robot`, `x` and `y` [m], and the orientation as `qx` to `qw` or as `yaw` [rad]. Of an export with Y up, as
Motive's usually is, x and y are X and -Z: up is the axis of the two along which all bodies together extend least.
"""

import csv
import io
import re
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from cooploc.estimators.interface import Array

METRES = {"meters": 1.0, "centimeters": 1e-2, "millimeters": 1e-3, "mm": 1e-3, "cm": 1e-2, "m": 1.0}
HEAD = 12  # lines in which the names of axes are looked for
BODY = "Rigid Body"


def table_of(text: str) -> pd.DataFrame | None:
    """Return the poses in an export, a line for each frame and body; None of any other text."""
    if text.startswith("Format Version,"):
        return _motive(text)
    return _vicon(text) if re.match(r"\W*(Objects|Trajectories|Model Outputs)\W*\n\s*\d", text) else None


def _motive(text: str) -> pd.DataFrame | None:
    head = list(csv.reader(io.StringIO("\n".join(text.split("\n", HEAD)[:HEAD]))))
    rows = {row[1]: row for row in head if len(row) > 2 and row[0] == ""}
    at = next((k for k, row in enumerate(head) if row[:1] == ["Frame"]), None)
    if at is None or not {"Type", "Name"} <= rows.keys():
        return None
    names = [name if kind == BODY else "" for name, kind in zip(rows["Name"], rows["Type"], strict=False)]
    kinds = [{"Rotation": "R", "Position": "T"}.get(kind, "") for kind in head[at - 1]]
    columns = [(name, kind + axis) for name, kind, axis in zip(names, kinds, head[at], strict=False)]
    stated = dict(zip(head[0][::2], head[0][1::2], strict=False))
    metres, numbers = METRES.get(stated.get("Length Units", "").lower(), 1.0), _numbers(text, at + 1)
    degrees = "" if stated.get("Rotation Type") == "Quaternion" else "deg"
    return _poses(columns, numbers, numbers[:, 1], metres, degrees)


def _vicon(text: str) -> pd.DataFrame | None:
    head = list(csv.reader(io.StringIO("\n".join(text.split("\n", HEAD)[:HEAD]))))
    at = next((k for k, row in enumerate(head) if row[:1] == ["Frame"]), None)
    if at is None or at < 2 or len(head) <= at + 1:
        return None
    name, columns = "", []
    for body, axis in zip(head[at - 1], head[at], strict=False):
        name = body.rpartition(":")[2].strip() or name
        columns.append((name, axis.strip()))
    units = dict(zip(head[at], head[at + 1], strict=False))
    numbers = _numbers(text, at + 2)
    time = (numbers[:, 0] - 1) / float(re.sub(r"[^\d.]", "", head[1][0]) or 100)
    return _poses(columns, numbers, time, METRES.get(units.get("TX", "mm"), 1e-3), units.get("RZ", "rad"))


def _numbers(text: str, skipped: int) -> Array:
    """Return the numbers (m, columns) below the first `skipped` lines, nan in fields that hold none."""
    lines = [line for line in text.split("\n")[skipped:] if line.strip()]
    rows = [line.split(",") for line in lines]
    width = max([2, *map(len, rows)])  # frame and time, at least
    whole = pd.DataFrame([row + [""] * (width - len(row)) for row in rows], columns=range(width))
    return np.asarray(whole.apply(pd.to_numeric, errors="coerce"), float)


def _poses(
    columns: Sequence[tuple[str, str]], numbers: Array, time: Array, metres: float, angle: str
) -> pd.DataFrame | None:
    """Return the table of bodies whose `columns` are (body, axis): TX to TZ, and RX to RZ with or without RW.

    `metres` is one unit of length, and `angle` that of RX to RZ, "deg" or "rad". A column without a body has no name.
    """
    of = {column: k for k, column in enumerate(columns[: numbers.shape[1]])}
    bodies = [name for name, axis in of if name and axis == "TX" and (name, "TY") in of]
    if not bodies:
        return None
    values: dict[tuple[str, str], Array] = defaultdict(lambda: np.full(len(numbers), np.nan))  # nan: axes not there
    values |= {(name, axis): numbers[:, k] for (name, axis), k in of.items()}
    spread_y, spread_z = (_spread(np.concatenate([values[name, axis] for name in bodies])) for axis in ("TY", "TZ"))
    y_up = spread_y < spread_z
    tables = []
    for name in bodies:
        x, y = values[name, "TX"], -values[name, "TZ"] if y_up else values[name, "TY"]
        table: dict[str, Any] = {"time": time, "robot": name, "x": metres * x, "y": metres * y}
        if (name, "RW") in of:
            qx, qy, qz, qw = (values[name, f"R{axis}"] for axis in "XYZW")
            parts = (qx, -qz, qy, qw) if y_up else (qx, qy, qz, qw)
            table |= {f"q{axis}": part for axis, part in zip("xyzw", parts, strict=True)}
        elif (name, "RZ") in of:
            turned = values[name, "RY" if y_up else "RZ"]
            table["yaw"] = np.radians(turned) if angle.startswith("deg") else turned
        tables.append(pd.DataFrame(table))
    return pd.concat(tables).sort_values("time", kind="stable")


def _spread(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if len(known) else 0.0

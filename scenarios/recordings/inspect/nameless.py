"""What the columns of files without names are: numbers alone, as robots, loggers and MATLAB write them.

What a file is about its own name must say (odom_red.txt, gt.txt, uwb.txt); its values then decide. Stamps rise, numbers
of robots and anchors are few and whole, a heading follows the direction of travel, a quaternion has length 1.
"""

from collections.abc import Mapping
from itertools import takewhile
from pathlib import Path

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.inspect import naming

QUATERNION = ("qx", "qy", "qz", "qw")
TUM = ("timestamp", "x", "y", "z", *QUATERNION)
TWIST = ("linear.x", "linear.y", "linear.z", "angular.x", "angular.y", "angular.z")
PLACE, COVARIANCE = TUM[1:], tuple(f"covariance{k}" for k in range(36))
# What `ros2 topic echo --csv` prints behind the stamp and its frame, by the number of columns.
ECHO = {
    len(names): names
    for names in (
        PLACE,  # PoseStamped
        (*PLACE, *COVARIANCE),  # PoseWithCovarianceStamped
        ("child_frame_id", *PLACE),  # TransformStamped
        ("child_frame_id", *PLACE, *COVARIANCE, *TWIST, *(f"twist.{name}" for name in COVARIANCE)),  # Odometry
        TWIST,  # TwistStamped
    )
}
MOST_NAMES = 100  # that a column of names has
FOLLOWS = 0.7  # least mean cosine between the heading and the direction of travel, forwards or backwards
SPARE = "count"  # in the name of a column that is not used
MOVED = 0.5  # [m] that true positions span at least: degrees on the globe do not
POSE = ("x", "y", "z", "roll", "pitch", "yaw")
SPEEDS = 8.0  # [m/s] or [rad/s], which no speed and no turn rate exceeds


def names_by_values(columns: Mapping[str, Array | tuple[str, ...]], file: str) -> dict[str, str]:
    """Return the probable names of the columns "1", "2", ... of a file; none where they do not become clear.

    One column of names says whose a pose is, or what was measured; two say who measured what.
    """
    numbers = {column: values for column, values in columns.items() if not isinstance(values, tuple)}
    first, *rest = columns or ("",)
    if {"anchors", "landmarks"} & {naming.OTHERS.get(word) for word in naming.words_of(Path(file).stem)}:
        is_places = len(rest) in (2, 3) and {*rest} <= {*numbers} and len({*columns[first]}) == len(columns[first])
        return dict(zip(columns, ("name", "x", "y", "z"), strict=False)) if is_places else {}
    rows = np.array([*numbers.values()]).T
    whole = rows[np.isfinite(rows).all(-1)] if len(numbers) else np.empty((0, 0))
    if len(whole) < 2:
        return {}
    if len(columns) == len(numbers) == len(TUM) and _is_quaternion(whole[:, 4:]):
        return dict(zip(columns, TUM, strict=True))
    of = dict(zip(numbers, whole.T, strict=True))
    stamps, are_numbers = whole[:, :2], [column in numbers for column in columns]
    is_echo = len(columns) - 3 in ECHO and are_numbers[:3] == [True, True, False]
    if is_echo and (stamps == np.rint(stamps)).all() and stamps[:, 1].max() > 1e6:  # nanoseconds
        return dict(zip(columns, ("sec", "nanosec", "frame_id", *ECHO[len(columns) - 3]), strict=True))
    clocks = [column for column, values in of.items() if _is_clock(values)]
    counters = [column for column in clocks if (np.diff(of[column]) == 1).all()][: len(clocks) - 1]
    if not (time := next((column for column in clocks if column not in counters), "")):
        return {}
    rest = [column for column in of if column not in (time, *counters)]
    leading = takewhile(lambda column: _are_numbers_of_things(of[column]), rest)
    texts = [column for column in columns if column not in numbers]
    labels = [
        c
        for c in texts
        if len({*columns[c]}) == 1 and (naming.side_of(w := columns[c][0]) or naming.name_meaning(w)[0])
    ]
    names = [*(column for column in texts if column not in labels), *leading]
    rest = [column for column in rest if column not in names]
    measured = _measured([of[column] for column in rest], file)
    things = ("robot", "other")[:: 1 if len(names) > 1 else -1] if "range" in measured else ("robot",)
    if not measured or len(names) > len(things):
        return {}
    known = {
        time: "time",
        **{column: f"{SPARE} {column}" for column in (*counters, *labels)},
        **dict(zip(rest, measured, strict=True)),
        **dict(zip(names, things, strict=False)),
    }
    return {column: known[column] for column in columns}


def _measured(values: list[Array], file: str) -> tuple[str, ...]:
    """Return the names of the columns that are neither stamps nor names."""
    path, n = Path(file), len(values)
    side = naming.side_of(path.stem) or naming.side_of(path.parent.name)
    if not side:
        is_range = naming.name_meaning(path.stem)[0] == "range" and 1 <= n <= 2 and (values[0] >= 0).all()
        is_bearing = n == 2 and np.abs(values[1]).max() <= np.pi
        return ("range", "bearing")[:n] if is_range and n == 1 + is_bearing else ()
    if n > 2 and _follows(*values[:3]):
        return ("x", "y", "yaw", *(f"{SPARE} {k}" for k in range(3, n)))
    if n == len(POSE) and _follows(values[0], values[1], values[-1]):
        return POSE
    if n > 6 and _is_quaternion(np.array(values[3:7]).T):
        return (*PLACE, *(f"{SPARE} {k}" for k in range(7, n)))
    if n == 2 and side == "odometry" and np.max(np.abs(values)) < SPEEDS and not _is_path(*values):
        return ("v", "w")
    is_place = side == "truth" and n in (2, 3) and np.ptp(values[:2], axis=1).max() > MOVED
    return ("x", "y", "z")[:n] if is_place else ()


def _is_clock(values: Array) -> bool:
    """Whether values are stamps: they rise, but for a few places where another robot or run begins.

    Several readings may have one stamp.
    """
    steps = np.diff(values)
    return bool((steps < 0).mean() < 0.02 and (steps > 0).sum() > max(1, 0.05 * len(steps)))


def _are_numbers_of_things(values: Array) -> bool:
    different = np.unique(values)
    return bool(len(different) <= min(MOST_NAMES, len(values) / 5) and (different == np.abs(np.rint(different))).all())


def _is_quaternion(values: Array) -> bool:
    return bool((np.abs(np.linalg.norm(values, axis=-1) - 1) < 0.01).mean() > 0.9)


def _is_path(x: Array, y: Array) -> bool:
    """Whether values are positions: each step goes on in the direction of the one before, as noisy speeds do not."""
    steps = np.diff(x) + 1j * np.diff(y)
    turns = steps[1:] * steps[:-1].conj()
    turns = turns[turns != 0]
    return bool(len(turns) and (turns / np.abs(turns)).real.mean() > 0.5)


def _follows(x: Array, y: Array, heading: Array) -> bool:
    """Whether a heading, in radians or degrees, is that of travel along x and y, as well as one constant would be."""
    driven = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    at = np.unique(np.searchsorted(driven, np.linspace(0, driven[-1], 200)[:-1]))
    if len(at) < 3 or np.ptp(heading) == 0:
        return False
    angle = np.deg2rad(heading) if np.abs(heading).max() > 4 * np.pi else heading
    travel = np.arctan2(np.diff(y[at]), np.diff(x[at]))
    constant = abs(np.exp(1j * travel).mean())  # how well the best one heading for all would do
    return bool(abs(np.cos(travel - angle[at[:-1]]).mean()) > max(FOLLOWS, constant - 0.01))

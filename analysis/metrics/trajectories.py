"""Trajectories of a team that any program wrote, judged against true ones in files: errors, drift and covariances.

A team is a folder with a file for each robot, the same names in every folder; its name is the robot's.

- `NAME.txt` is a TUM file: a line `stamp tx ty tz qx qy qz qw` for each pose, of which x, y and yaw count. Beside it
  `NAME.cov.txt` may have the covariances, a line `stamp xx xy yy` [m^2], the upper triangle of the position's, or
  `stamp xx xy xh yy yh hh` [m^2, m rad, rad^2], of position and heading h, at the stamps of the poses.
- `NAME.csv` has a header with `stamp` (or `time`, `t`), `x`, `y`, and where they are known `heading` (or `theta`,
  `yaw`) [rad] and the covariance's `xx`, `xy`, `yy`, `xh`, `yh`, `hh` (or `Pxx`, `Pxy`, ...), as MATLAB's
  `writetable` writes it.
- `covariances.npz` may have them for all robots: an array `NAME` (T, 3, 3) or (T, 2, 2), at the stamps of the poses.

Or it is a ROS bag, whose topics of nav_msgs/Odometry and geometry_msgs/PoseWithCovarianceStamped have the robots' names
in their own. Poses and stamps are matched, aligned and their errors taken as evo does (M. Grupp, github.com/
MichaelGrupp/evo): the nearest stamp counts, up to a largest difference; RPE is that of the translation between
neighbouring poses.
"""

import hashlib
import re
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.metrics.errors import errors
from cooploc.analysis.metrics.external import COLUMNS, COVARIANCE, COVARIANCES, ELSEWHERE
from cooploc.analysis.metrics.statistics import FIXED
from cooploc.estimators.errors import BadInput, nearest
from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings.bag_storage import KINDS, bag_paths, open_bag, stamp_of
from cooploc.scenarios.recordings.text_files import TextTable, read_table
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.runner.trace import Trace
from cooploc.scenarios.stream import Truth

ALIGNMENTS = "none", "origin", "se2", "team"
AXES = "world", "body"
WITH_COVARIANCE = ("nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseWithCovarianceStamped")
OTHER_NAMES = {"time": "stamp", "timestamp": "stamp", "t": "stamp", "theta": "heading", "yaw": "heading"}
TRIANGLE = np.triu_indices(3)
LATEST = 1e10  # [s] stamps beyond are in another unit; those of today are below 2e9
EQUAL = 1e-5  # [s] stamps of a pose and of its covariance differ by less
MIRRORED = 0.3  # a path fits so much better once it is mirrored: its frame is
BLOCKS = 10  # into which ticks are cut, to see in which axes covariances fit


class Trajectory(NamedTuple):
    """The poses of one robot, and their covariances."""

    stamp: Array  # (T,) [s]
    x: Array  # (T, 3)  x [m], y [m], heading [rad]; nan where there is no heading
    P: Array  # (T, 3, 3)  nan where it is not known


Team = Mapping[str, Trajectory]


def judge_trajectories(
    truth: str | Path,
    estimates: Mapping[str, str | Path],
    align: str = "none",
    axes: str = "world",
    pieces: int = 1,
    largest_difference: float = 0.01,
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Return errors of trajectories of any program, a row for each robot and piece, and remarks on them.

    Only true poses count that every method has an estimate for, so that all are judged at the same times. Columns are
    those of `cl.errors`, with the robot's `name`, `rpe` [m] and `heading` [rad], root mean squares; a trial is a piece.

    Args:
        truth: the folder, or bag, of true trajectories.
        estimates: by name, each a folder or bag; what a team is, the module says.
        align: each robot's path to the truth by its first pose (`origin`) or by a rotation and a translation of least
            squares (`se2`), one for the whole `team`, or not at all (`none`).
        axes: in which covariances are stated: those of the `world`, or of the robot's `body`, x forward.
        pieces: into so many the recording is cut, as trials from which intervals come; they are not independent.
        largest_difference: [s] between stamps that belong together.

    Raises:
        BadInput: a robot has no file, stamps do not meet, a path is mirrored, a covariance is none; says where.

    """
    for name, value, known in (("align", align, ALIGNMENTS), ("axes", axes, AXES)):
        if value not in known:
            raise BadInput(f"there is no {name} {value!r}; {nearest(value, list(known))}")
    if not estimates:
        raise BadInput("there are no estimates to judge: name a folder or bag")
    true = read_team(Path(truth))
    teams = {name: read_team(Path(folder), true) for name, folder in estimates.items()}
    matched = {robot: _common(robot, true[robot], teams, largest_difference) for robot in true}
    paths = {robot: true[robot].x[index] for robot, (index, _) in matched.items()}
    remarks = _shared_remarks(true, teams, paths, largest_difference)
    chosen: dict[str, dict[str, Trajectory]] = {}
    for name, team in teams.items():
        rows = {robot: matched[robot][1][name] for robot in true}
        there = {robot: Trajectory(*(field[rows[robot]] for field in team[robot])) for robot in true}
        chosen[name], said = _align(name, there, paths, align, axes)
        remarks += said
    return _rows(Path(truth), true, paths, chosen, pieces), tuple(remarks)


def drift_and_heading(rows: pd.DataFrame) -> pd.DataFrame:
    """Return RPE [m] and error of the heading [rad] of every method, root mean squares with intervals over pieces."""
    found = []
    for name, part in rows.groupby("estimator", sort=False):
        one: dict[str, object] = {"estimator": name}
        for column in ("rpe", "heading"):
            squares = part.assign(square=part[column] ** 2).groupby("trial")["square"].mean().to_numpy(float)
            ends = FIXED.mean_of_positive(squares) if np.isfinite(squares).all() else (np.nan,) * 3
            one |= dict(zip((column, f"{column}_low", f"{column}_high"), np.sqrt(ends), strict=True))
        found.append(one)
    return pd.DataFrame(found)


# ---- files


def read_team(place: Path, true: Team | None = None) -> Team:
    """Read the trajectories of a folder or bag by robot; with the true ones, of their robots."""
    if place.is_file() or (place.is_dir() and not _paths(place)):
        found = _read_bag(place, list(true or ()))
    elif not place.is_dir():
        raise BadInput(f"there is no folder {place}; name the one that holds a file for each robot")
    else:
        found = {name: _read_file(path) for name, path in _paths(place).items() if not true or name in true}
        stored = place / "covariances.npz"
        found = _with_stored(stored, found) if stored.exists() else found
    for robot in [robot for robot in true or () if robot not in found]:
        known = [*found, *(_paths(place) if place.is_dir() else ())]
        raise BadInput(f"{place}: robot {robot!r} has no trajectory; {nearest(robot, known)}")
    for robot, one in found.items():
        if np.abs(one.stamp).max() > LATEST:
            raise BadInput(f"{place}: stamps of robot {robot!r} reach {np.abs(one.stamp).max():.3g}: write seconds")
    return {robot: Trajectory(*_by_time(*one)) for robot, one in found.items()}


def _paths(folder: Path) -> dict[str, Path]:
    files = sorted(path for path in folder.iterdir() if path.suffix in (".txt", ".csv") and ".cov." not in path.name)
    named = {path.stem: path for path in files}
    for path in files:
        if named[path.stem] != path:
            raise BadInput(f"{path} and {named[path.stem].name} are of one robot: remove one of them")
    return named


def _read_file(path: Path) -> Trajectory:
    """Read one robot's poses, and the covariances that stand with or beside them."""
    if path.suffix == ".csv":
        return _read_csv(path)
    table = read_table(path, COLUMNS)
    q = table.values[:, 4:]
    for row in np.flatnonzero(np.abs(np.linalg.norm(q, axis=1) - 1) > 0.01).tolist():
        raise BadInput(f"{table.at(row)}: qx qy qz qw is not a unit quaternion; heading 0 is 0 0 0 1")
    x, y, z, w = q.T
    heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    stamp, pose = table.values[:, 0], np.column_stack([table.values[:, 1:3], heading])
    P, beside = np.full((len(pose), 3, 3), np.nan), path.with_name(path.stem + COVARIANCE)
    if beside.exists():
        width = len(beside.read_text("utf-8", "replace").rstrip().rpartition("\n")[2].split())
        names = COVARIANCES[3 if width == len(COVARIANCES[3]) else 2]
        triangle = read_table(beside, names)
        if len(triangle.values) != len(stamp) or (np.abs(triangle.values[:, 0] - stamp) > EQUAL).any():
            raise BadInput(f"{beside}: its stamps are not those of {path.name}: write one line for each pose")
        P = _from_triangle(pd.DataFrame(triangle.values, columns=list(names)))
        _require_positive(P, triangle)
    return Trajectory(stamp, pose, P)


def _read_csv(path: Path) -> Trajectory:
    """Read a CSV file with a header."""
    try:
        table = pd.read_csv(path)
    except (ValueError, OSError) as e:
        raise BadInput(f"{path}: cannot be read as CSV ({' '.join(str(e).split())[:100]}); write it again") from None
    table.columns = pd.Index([OTHER_NAMES.get(name, name) for name in table.columns.str.strip().str.lower()])
    table = table.rename(columns=lambda name: name.removeprefix("p") if re.fullmatch("p[xyh]{2}", name) else name)
    for name in ("stamp", "x", "y"):
        if name not in table:
            raise BadInput(f"{path} has no column {name}; it has {', '.join(table.columns)}, parted by commas")
    if not table.columns.is_unique or table.empty:
        fault = "it has no line" if table.empty else f"two columns are one: {', '.join(table.columns)}"
        raise BadInput(f"{path}: {fault}; correct the file")
    values = table.apply(pd.to_numeric, errors="coerce")
    pose = values.reindex(columns=["x", "y", "heading"]).to_numpy(float)
    for row in np.flatnonzero(~np.isfinite(np.column_stack([values["stamp"], pose[:, :2]])).all(1)).tolist():
        raise BadInput(f"{path}, line {row + 2}: stamp, x or y is not a number; correct or remove the line")
    P = _from_triangle(values)
    _require_positive(P, TextTable(path, pose, np.arange(2, len(pose) + 2)))
    return Trajectory(values["stamp"].to_numpy(float), pose, P)


def _with_stored(path: Path, team: dict[str, Trajectory]) -> dict[str, Trajectory]:
    """Return trajectories with the covariances of an npz file."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: np.asarray(stored[name], float) for name in stored.files}
    except (ValueError, TypeError, OSError, zipfile.BadZipFile) as e:
        raise BadInput(f"{path}: cannot be read ({' '.join(str(e).split())[:100]}); write it with np.savez") from None
    found = {}
    for name, one in team.items():
        P, T = arrays.get(name, np.full((len(one.stamp), 3, 3), np.nan)), len(one.stamp)
        if P.shape not in ((T, 2, 2), (T, 3, 3)):
            raise BadInput(
                f"{path}: {name} has shape {P.shape}, not ({T}, 2, 2) or ({T}, 3, 3), a matrix for each pose"
            )
        if not np.allclose(P, P.swapaxes(1, 2), rtol=1e-6, atol=1e-12, equal_nan=True):
            raise BadInput(f"{path}: {name} holds a matrix that is not symmetric, which a covariance is: store P alone")
        whole = np.full((T, 3, 3), np.nan)
        whole[:, : P.shape[1], : P.shape[1]] = P
        _require_positive(whole, TextTable(path, one.x, np.arange(T)), "index")
        found[name] = one._replace(P=whole)
    return found


def _read_bag(place: Path, robots: list[str]) -> dict[str, Trajectory]:
    """Read the poses with covariances of a bag's topics; a topic's robot is the name that is a part of its own."""
    rows: dict[str, list[tuple[float, ...]]] = {}
    for path in bag_paths(place):
        try:
            _collect_poses(path, rows)
        except Exception as e:  # rosbags raises whatever its parsers raise on damaged files
            raise BadInput(f"{path}: cannot be read as a bag ({' '.join(str(e).split())[:100]}); repair it") from None
    found: dict[str, Trajectory] = {}
    for topic, lines in rows.items():
        parts, table = topic.strip("/").split("/"), np.array(lines)
        name = next((robot for robot in robots if robot in parts), parts[0] if not robots else None)
        if name is None or name in found:
            continue
        P = table[:, 4:].reshape(-1, 3, 3)
        P = np.where((P == 0).all((1, 2), keepdims=True), np.nan, P)  # ROS has zeros where it is not known
        _require_positive(P, TextTable(place, table, np.arange(len(table))), f"{topic}, message")
        found[name] = Trajectory(table[:, 0], table[:, 1:4], P)
    if not found:
        raise BadInput(
            f"{place} holds no NAME.txt or NAME.csv, nor a bag with topics of {' or '.join(WITH_COVARIANCE)}"
        )
    return found


def _collect_poses(path: Path, rows: dict[str, list[tuple[float, ...]]]) -> None:
    """Add the stamp, pose and covariance of every message of one bag to the rows of its topic."""
    with open_bag(path) as bag:
        kinds = {topic: kind for topic, kind in bag.types.items() if kind in WITH_COVARIANCE}
        for topic, received, raw in bag.messages(kinds):
            message = bag.decode(raw, kinds[topic])
            x, y, _, heading = KINDS[kinds[topic]].rows(message)[0][:4]
            C = np.asarray(message.pose.covariance, float).reshape(6, 6)[np.ix_([0, 1, 5], [0, 1, 5])]
            stamp = 1e-9 * (stamp_of(message) or received)
            rows.setdefault(topic, []).append((stamp, x, y, heading, *C.ravel()))


def _from_triangle(values: pd.DataFrame) -> Array:
    """Return covariances (T, 3, 3) of columns xx, xy, ...; nan where there are none."""
    P = np.full((len(values), 3, 3), np.nan)
    names = ["xx", "xy", "xh", "yy", "yh", "hh"]
    P[:, TRIANGLE[0], TRIANGLE[1]] = values.reindex(columns=names).to_numpy(float)
    P[:, TRIANGLE[1], TRIANGLE[0]] = P[:, TRIANGLE[0], TRIANGLE[1]]
    return P


def _require_positive(P: Array, table: TextTable, line: str = "line") -> None:
    """Refuse matrices that are no covariance of a position, or of a pose."""
    for d in (2, 3):
        known: Mask = np.asarray(np.isfinite(P[:, :d, :d]).all((1, 2)))
        least = np.linalg.eigvalsh(np.where(known[:, None, None], P[:, :d, :d], np.eye(d))).min(1)
        for row in np.flatnonzero(least <= -1e-12).tolist():
            where = f"{table.path}, {line} {table.line[row]}"
            raise BadInput(
                f"{where}: the covariance is not positive, its least eigenvalue is {least[row]:.3g}: correct it"
            )


def _by_time(stamp: Array, x: Array, P: Array) -> tuple[Array, Array, Array]:
    order = np.argsort(stamp, kind="stable")
    return stamp[order], x[order], P[order]


# ---- stamps and frames


def _common(
    robot: str, true: Trajectory, teams: Mapping[str, Team], largest: float
) -> tuple[Indices, dict[str, Indices]]:
    """Return the true poses that all methods have an estimate for, and which of each method's poses those are."""
    pairs = {name: match_stamps(true.stamp, team[robot].stamp, largest) for name, team in teams.items()}
    for name, (index, _) in pairs.items():
        if not len(index):
            own = teams[name][robot].stamp
            raise BadInput(
                f"{name}: no stamp of robot {robot!r} ({own[0]:.10g} to {own[-1]:.10g} s) is within {largest:g} s of "
                f"one of the truth ({true.stamp[0]:.10g} to {true.stamp[-1]:.10g} s): write both by one clock"
            )
    if len(pairs) == 1:
        (name, (index, rows)), *_ = pairs.items()
        return index, {name: rows}
    first = {
        name: dict(zip(reversed(index.tolist()), reversed(rows.tolist()), strict=True))
        for name, (index, rows) in pairs.items()
    }
    common = sorted(set.intersection(*(set(one) for one in first.values())))
    if not common:
        raise BadInput(f"robot {robot!r}: no true pose is met by all of {', '.join(pairs)}: judge them one by one")
    return np.array(common), {name: np.array([one[k] for k in common]) for name, one in first.items()}


def _shared_remarks(true: Team, teams: Mapping[str, Team], paths: Mapping[str, Array], largest: float) -> list[str]:
    """Return a remark on each robot of which a method lacks a tenth of the poses, as others are not judged there."""
    remarks = []
    for robot, path in paths.items():
        met = max(len(match_stamps(true[robot].stamp, team[robot].stamp, largest)[0]) for team in teams.values())
        if len(path) < 0.9 * met:
            remarks.append(f"robot {robot!r}: {len(path)} of {met} poses are judged; not every method has the others")
    return remarks


def match_stamps(a: Array, b: Array, largest: float) -> tuple[Indices, Indices]:
    """Return the rows of a and of b whose stamps are nearest, for each stamp of the shorter one, as evo does."""
    if len(b) > len(a):
        rows, index = match_stamps(b, a, largest)
        return index, rows
    right = np.searchsorted(a, b).clip(1, max(len(a) - 1, 1))
    candidates = np.stack([right - 1, np.minimum(right, len(a) - 1)])
    away = np.abs(a[candidates] - b)
    nearer = np.take_along_axis(candidates, away.argmin(0)[None], 0)[0]
    met = away.min(0) <= largest
    return nearer[met], np.flatnonzero(met)


def _align(
    name: str, team: Mapping[str, Trajectory], paths: Mapping[str, Array], align: str, axes: str
) -> tuple[dict[str, Trajectory], list[str]]:
    """Return a team's trajectories in the frame of the truth, covariances in its axes, and remarks."""
    remarks, found = [], {}
    together = fit_frame(*(np.concatenate([one[robot][:, :2] for robot in paths]) for one in (
        {robot: trajectory.x for robot, trajectory in team.items()}, paths
    )))  # fmt: skip
    for robot, one in team.items():
        true = paths[robot]
        angle, shift, residual = fit_frame(one.x[:, :2], true[:, :2])
        mirrored = fit_frame(one.x[:, :2] * [1, -1], true[:, :2])[2]
        if mirrored < MIRRORED * residual:
            raise BadInput(
                f"{name}: the path of robot {robot!r} is mirrored: it fits the truth to {mirrored:.3g} m with y turned "
                f"round, and to {residual:.3g} m as it is: write it with x forward and y left"
            )
        plain = float(np.sqrt(((one.x[:, :2] - true[:, :2]) ** 2).sum(1).mean()))
        if align == "none" and residual < plain / 5:
            remarks.append(
                f"{name}: robot {robot!r} errs by {plain:.3g} m, and by {residual:.3g} m once aligned: if it is in "
                "another frame, --align se2"
            )
        if align == "origin" and not np.isfinite(true[0, 2] - one.x[0, 2]):
            raise BadInput(
                f"{name}: robot {robot!r} has no heading in its first pose, or the truth: choose --align se2"
            )
        if axes == "body" and np.isfinite(one.P[:, :2, :2]).any() and not np.isfinite(one.x[:, 2]).all():
            raise BadInput(
                f"{name}: robot {robot!r} has no heading for axes of its body: add it, or choose --axes world"
            )
        if axes == "body":
            one = one._replace(P=turn_covariances(one.P, one.x[:, 2]))
        else:
            remarks += _axes_remark(name, robot, one, true)
        if align == "origin":
            angle = float(wrap(true[0, 2] - one.x[0, 2]))
            shift = true[0, :2] - rotation(angle) @ one.x[0, :2]
        elif align == "team":
            angle, shift, _ = together
        if align != "none":
            x = np.column_stack([one.x[:, :2] @ rotation(angle).T + shift, wrap(one.x[:, 2] + angle)])
            one = one._replace(x=x, P=turn_covariances(one.P, np.full(len(x), angle)))
        found[robot] = one
    return found, remarks


def rotation(angle: float) -> Array:
    """Return the matrix (2, 2) that turns the plane by an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def fit_frame(a: Array, b: Array) -> tuple[float, Array, float]:
    """Return the angle and shift of least squares that take points a (m, 2) to b, and the RMSE that is left.

    Source: S. Umeyama, IEEE Trans. PAMI 13, 1991, without scale; in the plane its rotation is one angle.
    """
    from_a, from_b = a - a.mean(0), b - b.mean(0)
    angle = float(
        np.arctan2((from_a[:, 0] * from_b[:, 1] - from_a[:, 1] * from_b[:, 0]).sum(), (from_a * from_b).sum())
    )
    shift = b.mean(0) - rotation(angle) @ a.mean(0)
    left = from_b - from_a @ rotation(angle).T
    return angle, shift, float(np.sqrt((left**2).sum(1).mean()))


def turn_covariances(P: Array, angle: Array) -> Array:
    """Return covariances (T, 3, 3) in axes that are turned back by an angle (T,) [rad]: R P R'; heading's stays."""
    R = np.zeros_like(P)
    R[:, 0, 0] = R[:, 1, 1] = np.cos(angle)
    R[:, 1, 0], R[:, 0, 1], R[:, 2, 2] = np.sin(angle), -np.sin(angle), 1.0
    known = np.where(np.isnan(P), 0.0, P)
    return np.where(np.isnan(P), np.nan, R @ known @ R.swapaxes(1, 2))


def _axes_remark(name: str, robot: str, one: Trajectory, true: Array) -> list[str]:
    """Return a remark where errors fit the covariances in the robot's axes better, in almost every part of the path.

    The determinant is the same in both, so that the smaller NEES is the likelier.
    """
    error, body = one.x[:, :2] - true[:, :2], turn_covariances(one.P, one.x[:, 2])
    known: Mask = np.asarray(np.isfinite(one.P[:, :2, :2] + body[:, :2, :2]).all((1, 2)))
    known &= np.linalg.det(np.where(known[:, None, None], one.P[:, :2, :2], 0.0)) > 0
    if np.count_nonzero(known) < 10 * BLOCKS:
        return []
    here, there = (
        np.einsum("ti,ti->t", error[known], np.linalg.solve(P[known, :2, :2], error[known][..., None])[..., 0]) / 2
        for P in (one.P, body)
    )
    parts = zip(np.array_split(here, BLOCKS), np.array_split(there, BLOCKS), strict=True)
    better = sum(b.mean() < a.mean() for a, b in parts)
    if better < BLOCKS - 1 or there.mean() > 0.8 * here.mean():
        return []
    return [
        f"{name}: the covariances of robot {robot!r} fit in the axes of the robot (ANEES {there.mean():.3g}) better "
        f"than in those of the world ({here.mean():.3g}): if they are stated so, --axes body"
    ]


# ---- rows


def _rows(
    place: Path, true: Team, paths: Mapping[str, Array], teams: Mapping[str, Mapping[str, Trajectory]], pieces: int
) -> pd.DataFrame:
    """Return the rows of `errors` of every method, robot and piece, with RPE and the heading's error."""
    short = min(len(path) for path in paths.values())
    if short < 2:
        raise BadInput("a robot has 1 pose to judge, less than 2: see that the stamps are of one clock, in seconds")
    if not 1 <= pieces <= short // 2:
        raise BadInput(
            f"pieces is {pieces}; it must lie between 1 and {short // 2}, as a robot has {short} poses to judge"
        )
    length, n = -(-max(len(path) for path in paths.values()) // pieces), len(paths)
    heading = all(np.isfinite(one[:, 2]).all() for one in _every(paths.values(), teams))
    d = 3 if heading else 2

    def cut(values: Iterable[Array], fill: float) -> Array:
        """Return arrays of the robots (T, ...) as one (piece, tick, robot, ...)."""
        robots = [np.array_split(one, pieces) for one in values]
        out = np.full((pieces, length, n, *robots[0][0].shape[1:]), fill)
        for r, parts in enumerate(robots):
            for k, part in enumerate(parts):
                out[k, : len(part), r] = part
        return out

    valid = cut([np.ones(len(path)) for path in paths.values()], 0.0) > 0
    every = np.concatenate([path[:, :2] for path in paths.values()])
    words = [f"{robot} {len(path)} {float(path[:, :2].sum()):.17g}" for robot, path in paths.items()]
    hashes = tuple(hashlib.sha256(f"{k} of {pieces} {words}".encode()).hexdigest() for k in range(pieces))
    label, trial = place.resolve().name, np.arange(pieces)
    truth = Truth(label, trial, cut([path[:, :d] for path in paths.values()], 0.0), valid,
                  np.stack([every.min(0), every.max(0)]), hashes)  # fmt: skip
    traces = {
        name: Trace.of(cut([team[robot].x[:, :d] for robot in paths], 0.0), _without_gaps(name, cut(
            [team[robot].P[:, :d, :d] for robot in paths], np.nan), valid))
        for name, team in teams.items()
    }  # fmt: skip
    rows = errors(truth, Run(label, 0, trial, hashes, traces)).assign(certificate=ELSEWHERE)
    apart = []
    for name in traces:
        if not all(np.isfinite(teams[name][robot].P).all() for robot in paths):  # without covariances of the heading
            rows.loc[rows["estimator"] == name, "pose_nees"] = np.nan
        for k in range(pieces):
            for r, robot in enumerate(paths):
                a, b = (np.array_split(one, pieces)[k] for one in (teams[name][robot].x, paths[robot]))
                turn = float(np.sqrt((wrap(a[:, 2] - b[:, 2]) ** 2).mean()))
                apart.append((name, k, r, robot, relative_error(a, b), turn))
    return rows.merge(pd.DataFrame(apart, columns=["estimator", "trial", "robot", "name", "rpe", "heading"]))


def _every(paths: Iterable[Array], teams: Mapping[str, Mapping[str, Trajectory]]) -> Iterable[Array]:
    yield from paths
    for team in teams.values():
        yield from (one.x for one in team.values())


def _without_gaps(name: str, P: Array, valid: Mask) -> Array:
    """Return covariances if every pose has one or none has; refuse those that are left out in part."""
    for d in (2, 3):
        known: Mask = np.asarray(np.isfinite(P[..., :d, :d]).all((3, 4)))
        if known[valid].any() and not known[valid].all():
            raise BadInput(
                f"{name}: {(~known[valid]).sum()} of {valid.sum()} poses have no covariance: add them, or remove all"
            )
    return P


def relative_error(x: Array, true: Array) -> float:
    """Return the root mean square error [m] of the motion between neighbouring poses (T, 3)."""
    steps = []
    for poses in (x, true):
        step, h = np.diff(poses[:, :2], axis=0), poses[:-1, 2]
        c, s = np.cos(h), np.sin(h)
        steps.append(np.column_stack([c * step[:, 0] + s * step[:, 1], c * step[:, 1] - s * step[:, 0]]))
    return float(np.sqrt(((steps[0] - steps[1]) ** 2).sum(1).mean())) if len(x) > 1 else np.nan

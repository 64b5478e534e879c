"""Files of a team's trajectories, of any program, read with their covariances.

A team is a folder with a file for each robot, or a folder with one; what differs between their names is the robot's.
The true ones may lie with them, if their names say so: `red_gt.txt` beside `red_mine.txt`, of the method `mine`.

- `NAME.txt` or `NAME.tum` is a TUM file: a line `stamp tx ty tz qx qy qz qw` for each pose, of which x, y and yaw
  count; a quaternion of zeros means that the heading is not known. Twelve numbers a line are a pose of KITTI.
- `NAME.csv` has a header, and what `cooploc inspect` takes for `stamp`, `x`, `y` and `heading`, by their names: `time`,
  `theta`, `yaw`, quaternions, units (`x [mm]`, `heading_deg`), as EuRoC or MATLAB's `writetable` write it; without a
  header by their values. It may have the covariance's `xx`, `xy`, `yy`, `xh`, `yh`, `hh` (or `Pxx`, `cov_xx`, ...), or
  standard deviations (`sigma_x`). Commas, semicolons, tabs or blanks part fields. Without stamps a line is a tick.
  One file may have all robots, with a column `robot`, or with columns for each (`red_x`, `blue_x`), and the truth and
  all methods, with a column that names them, or with columns of the truth beside others (`gt_x`, `x`).
- `NAME.cov.txt` beside either may have the covariances, a line `stamp xx xy yy` [m^2], the upper triangle of the
  position's, or `stamp xx xy xh yy yh hh` [m^2, m rad, rad^2], of position and heading h, at the stamps of the poses.
- `covariances.npz` may have them for all robots: an array `NAME` (T, 3, 3) or (T, 2, 2), at the stamps of the poses.

Or it is a ROS bag: `trajectory_bags` reads its poses.

A team of one robot may be one file, of any name. Covariances of a robot that are all zero are not known, as in ROS.

Source: the TUM RGB-D benchmark, J. Sturm et al., IROS 2012.
"""

import re
import zipfile
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.metrics.trajectory_bags import TRUTH, read_poses
from cooploc.estimators.errors import BadInput, count_of, first_of, nearest
from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.scenarios.recordings.inspect.columns import (
    EPOCHS,
    SINCE_1970,
    CsvTable,
    Guess,
    infer_columns,
)
from cooploc.scenarios.recordings.inspect.naming import (
    SI,
    columns_of_robots,
    file_pattern,
    is_on_globe,
    is_second_choice,
    letters_of,
    match_names,
    name_meaning,
    side_of,
    without_dates,
    words_of,
)
from cooploc.scenarios.recordings.schema import UNITS
from cooploc.scenarios.recordings.text_files import (
    TextTable,
    is_text,
    parse_fields,
    read_lines,
    read_table,
    read_text,
    split_fields,
)

COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
COVARIANCES = {2: ("timestamp", "xx", "xy", "yy"), 3: ("timestamp", "xx", "xy", "xh", "yy", "yh", "hh")}  # by d
PLACES = {"landmark", "landmarks", "anchor", "anchors"}  # words of files that are of no robot
COVARIANCE, STORED, ENDINGS = ".cov.txt", "covariances.npz", (".txt", ".tum", ".csv", ".dat", ".tsv", ".parquet")
CLOCKS = ("time",), ("sec", "nsec"), ("sec",)  # quantities that make a stamp
PLACED = "x", "y", "heading"  # quantities that the truth has beside an estimate
AXES = {"x": 0, "y": 1, **dict.fromkeys(("h", "th", "theta", "yaw", "phi", "psi", "heading"), 2)}  # rows of P
OF_ROS = {0: 0, 1: 1, 5: 2}  # rows of P by those of ROS's 6 x 6
_AXIS, _DEVIATION = "|".join(AXES), "sigma|std|stddev|sd"
_MEASURE = f"cov|covariance|var|variance|{_DEVIATION}"
ENTRY = re.compile(rf"((p|c)|{_MEASURE})?({_AXIS})({_AXIS})?")
OF_PLACES = {"pose", "position", "pos"}  # words before an axis
NUMBERED = re.compile(r"(?:.*[^a-z])?(p|c|cov|sigma)[\W_]{0,2}(\d)[\W_]*(\d)\W?", re.IGNORECASE)  # P01, cov[0][1]
OTHER_UNITS = {"mm", "cm", "deg", "degs", "degree", "degrees"}  # than m and rad
KITTI = 12  # numbers in a line: the upper three rows of a 4 x 4 matrix
TRIANGLE = {d: np.triu_indices(d) for d in (2, 3)}
LATEST = 1e10  # [s] stamps beyond are in another unit; those of today are below 2e9
EQUAL = 1e-5  # [s] stamps of a pose and of its covariance differ by less
TORN = 0.1  # share of poses whose lines of covariances may be torn
UNIT = 0.01  # a quaternion's length may differ from 1 by so much
ENOUGH = 10_000  # lines from which columns are inferred
UNTIMED = "poses without stamps have the numbers of their lines, as ticks"
FLAT = 0.2  # a path with so little extent along x or y, of that along z, is not of a robot on a floor
SHARED = 0.3  # share of poses that have the stamp of another, as those of two robots or methods do
TILTED = 0.5  # cosine of the median angle from z up, below which poses are not those of a robot in the plane
ROUNDING = 1e-6  # asymmetry of a covariance that is written in text, and 0.001 of it below zero, of its largest entry


class Trajectory(NamedTuple):
    """The poses of one robot by rising stamps, and their covariances."""

    stamp: Array  # (T,) [s]
    x: Array  # (T, 3)  x [m], y [m], heading [rad]; nan where there is no heading
    P: Array  # (T, 3, 3)  nan where it is not known
    notes: tuple[str, ...] = ()  # on lines that were left out

    def select(self, rows: Array | Mask | Indices) -> "Trajectory":
        """Return some poses."""
        return self._replace(stamp=self.stamp[rows], x=self.x[rows], P=self.P[rows])


Team = Mapping[str, Trajectory]


def read_team(place: Path, robots: Sequence[str] = (), method: str = TRUTH) -> Team:
    """Read the trajectories of a folder, file or bag by robot; of these robots alone, where they are named."""
    if not place.exists():
        raise BadInput(f"there is no folder {place}; name the one that holds a file for each robot")
    files = team_files(place, method)
    words = file_pattern([f"{name}.txt" for name in files])[1] if files else ()
    files = dict(zip(words, files.values(), strict=True)) if len(words) == len(files) else files  # red_truth is of red
    meant = match_names([name for name in files if name not in robots], robots)  # Robot_1 is robot1
    files = {meant.get(name, name): path for name, path in files.items()}
    named = {name: path for name, path in files.items() if not robots or name in robots or len(files) == 1}
    found = read_files(named, method) if files else _read_bag(place, robots, method)
    for name, robot in meant.items():
        if letters_of(name) != letters_of(robot) and robot in found:
            taken = f"{files[robot]} is taken for robot {robot!r}"
            found[robot] = found[robot]._replace(notes=(*found[robot].notes, taken))
    if len(robots) == len(found) == 1:  # whatever its name
        found = dict(zip(robots, found.values(), strict=True))
    known = list(files) if len(files) > 1 else list(found)
    for robot in [robot for robot in robots if robot not in found]:
        raise BadInput(f"{place}: robot {robot!r} has no trajectory; {nearest(robot, known)}")
    return found


def team_files(place: Path, method: str = "") -> dict[str, Path]:
    """Return the files of poses of a folder, or the file itself, by the names of their robots.

    Where some are true ones by their names, such as `red_gt.txt`, these are of the truth alone, and of all others those
    with the name of the `method`, if there are any.
    """
    there = sorted(p for p in place.iterdir() if p.name[0] != ".") if place.is_dir() else []  # ._red.txt is macOS's
    files = there if place.is_dir() else [place] * is_text(place)
    files = [path for path in files if ".cov." not in path.name and (path == place or path.suffix in ENDINGS)]
    files = [path for path in files if path == place or not PLACES & {*words_of(path.stem)}]
    true = [path for path in files if side_of(path.stem) == TRUTH]
    if method and 0 < len(true) < len(files):
        others = [path for path in files if path not in true]
        own = [path for path in others if method in re.split(r"[_\-. ]", path.stem)]
        files = true if method == TRUTH else own or others
    if not files and place.is_dir():  # a folder for each robot
        folders = [path for path in there if path.is_dir()]
        inside = {name: team_files(path, method) for path, name in zip(folders, _undated(folders), strict=True)}
        return {name: next(iter(own.values())) for name, own in inside.items() if len(own) == 1}
    names = [name.rpartition(".")[0] or name for name in _undated(files)]
    named = dict(zip(names, files, strict=True))
    for path, name in zip(files, names, strict=True):
        if named[name] != path:
            raise BadInput(f"{path} and {named[name].name} are of one robot: remove one of them")
    return named


def _undated(paths: Sequence[Path]) -> list[str]:
    """Return the names of files or folders, without dates that their recorders wrote into them."""
    starred = without_dates([path.name for path in paths])
    return [re.sub(r"[-_ ]*\*[-_ ]*(?=\.|$)|^\*[-_ ]*|\*", "", starred.get(path.name, path.name)) for path in paths]


def read_files(files: Mapping[str, Path], method: str = "") -> dict[str, Trajectory]:
    """Read the poses of robots, those of a method where a file has several, and covariances with or beside them."""
    stored = {folder: _read_stored(folder / STORED) for folder in {path.parent for path in files.values()}}
    found: dict[str, Trajectory] = {}
    for key, path in files.items():
        first = next((line for line in read_text(path).split("\n") if line.partition("#")[0].strip()), "")
        is_tum = path.suffix != ".csv" and not re.search("[,;]", first) and 7 <= len(first.split()) <= 9
        own = {"": _poses_of_tum(read_table(path, COLUMNS))} if is_tum else _read_csv(path, method)
        if len(own) > 1 < len(files):
            raise BadInput(f"{path} has poses of several robots, and is one of several files: keep one, or part it")
        if len(own) > 1:
            found |= {robot: _by_time(path, one) for robot, one in own.items()}
            continue
        one = own[""]
        if (beside := path.with_name(path.stem + COVARIANCE)).exists():
            one = _add_triangles(one, beside)
        if path.stem in stored[path.parent]:
            T, P, where = len(one.stamp), stored[path.parent][path.stem], path.parent / STORED
            if P.shape not in ((T, 2, 2), (T, 3, 3)):
                raise BadInput(
                    f"{where}: {path.stem} has shape {P.shape}, not ({T}, 2, 2) or ({T}, 3, 3), a matrix for each pose"
                )
            one = one._replace(P=_covariances(P, TextTable(where, one.x, np.arange(T)), "index"))
        found[key] = _by_time(path, one)
    return found


def _by_time(place: Path, one: Trajectory) -> Trajectory:
    """Return poses by rising stamps [s], those of a smaller unit since 1970 converted; refuse others.

    Of several poses at one stamp the first counts; where most stamps have several, nothing says whose they are.
    """
    if (latest := np.abs(one.stamp).max()) > LATEST:
        low, high = SINCE_1970
        units = [unit for unit in EPOCHS.values() if low < np.median(one.stamp) / unit < high]
        if not units:
            raise BadInput(f"{place}: stamps reach {latest:.3g}: write seconds")
        one = one._replace(stamp=one.stamp / units[0])
    one = one.select(np.argsort(one.stamp, kind="stable"))
    again = np.append(False, np.diff(one.stamp) == 0)
    if len(one.stamp) > 2 and (share := again.mean()) > SHARED:
        remedy = "name robots in a column robot, methods in another as in --tum NAME=, or write stamps with more digits"
        raise BadInput(f"{place}: {share:.0%} of its poses have the stamp of another: {remedy}")
    left_out = (f"{place}: left out {count_of(int(again.sum()), 'pose')} with the stamp of another",) * bool(
        again.any()
    )
    return one._replace(notes=(*one.notes, *left_out)).select(~again)


def _poses_of_tum(table: TextTable) -> Trajectory:
    """Return the poses in the lines of a TUM file."""
    q = table.values[:, 4:]
    length = np.linalg.norm(q, axis=1)
    for row in np.flatnonzero((np.abs(length - 1) > UNIT) & (length > 0)).tolist():
        raise BadInput(f"{table.at(row)}: qx qy qz qw is not a unit quaternion; heading 0 is 0 0 0 1")
    _require_flat(table.path, table.values[:, 1:4])
    poses = np.column_stack([table.values[:, 1:3], _heading_of(table.path, q)])
    return Trajectory(table.values[:, 0], poses, np.full((len(q), 3, 3), np.nan), table.notes)


def _poses_of_kitti(table: TextTable) -> Trajectory:
    """Return the poses in the lines of a KITTI file, one a tick."""
    matrices = table.values.reshape(-1, 3, 4)
    _require_flat(table.path, matrices[:, :, 3])
    if np.median(matrices[:, 2, 2]) < TILTED:
        raise BadInput(f"{table.path}: z of most poses does not point up: write matrices of a robot in the plane")
    poses = np.column_stack([matrices[:, :2, 3], np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0])])
    return Trajectory(_count_lines(table), poses, np.full((len(poses), 3, 3), np.nan), (*table.notes, UNTIMED))


def _require_flat(place: Path | str, xyz: Array) -> None:
    """Refuse a path (T, 3) in a plane that stands upright, such as that of a camera, whose z points forward."""
    x, y, z = np.ptp(xyz, axis=0).tolist()
    if z > max(0.5, 0.3 * x, 0.3 * y) and min(x, y) < FLAT * z:
        spans = f"spans {x:.3g}, {y:.3g} and {z:.3g} m along x, y and z"
        raise BadInput(f"{place}: its path {spans}: turn it so that z points up; a camera's z points forward")


def _count_lines(table: TextTable) -> Array:
    """Return the number of each line, from 0 for the first, as its stamp, where there is none."""
    return np.asarray(table.line - table.line[0], float)


def _heading_of(path: Path, q: Array) -> Array:
    """Return headings of quaternions (T, 4), nan where one is zero; refuse those of poses that lie on their side."""
    x, y, z, w = q.T
    if np.median(1 - 2 * (x * x + y * y)) < TILTED:
        raise BadInput(f"{path}: z of most poses does not point up: write qx qy qz qw, w last, of a robot in the plane")
    return np.where(q.any(1), np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)), np.nan)


def _add_triangles(one: Trajectory, path: Path) -> Trajectory:
    """Add covariances from a file with a line of their upper triangle for each pose; leave out those of torn lines."""
    lines = (line.partition("#")[0].split() for line in path.read_text("utf-8", "replace").splitlines())
    first = next(filter(None, lines), [])
    triangle = read_table(path, COVARIANCES[3 if len(first) == len(COVARIANCES[3]) else 2])
    order = np.argsort(triangle.values[:, 0], kind="stable")
    stamps = triangle.values[order, 0]
    rows = order[np.searchsorted(stamps, one.stamp - EQUAL).clip(0, len(stamps) - 1)]
    absent = np.abs(triangle.values[rows, 0] - one.stamp) > EQUAL
    if absent.any() and not (triangle.notes and absent.mean() <= TORN):
        poses = path.name.removesuffix(COVARIANCE)
        raise BadInput(f"{path}: its stamps are not those of {poses}: write one line for each pose")
    P = _covariances(_from_triangle(triangle.values[rows, 1:]), triangle._replace(line=triangle.line[rows]))
    lost = (f"{path}: {count_of(int(absent.sum()), 'pose')} without covariance count nowhere",) if absent.any() else ()
    return one._replace(P=P, notes=(*one.notes, *triangle.notes, *lost)).select(~absent)


def _read_csv(path: Path, method: str) -> dict[str, Trajectory]:
    """Read a CSV file by its header, by robot where a column names several, or where each has columns of its own."""
    text = read_text(path)
    head = split_fields(text[:100_000])[0]
    patterns, robots = columns_of_robots(head)
    own = next((robot for robot in robots if robot.lower() == method.lower()), "")
    if not own and any(_is_x_of(name, method) for name in {*head} - {*patterns}):
        return _read_columns(path, text, method, patterns)  # x_gt beside x_mine and x_theirs
    found: dict[str, Trajectory] = {}
    for robot in (own,) if own else robots:
        named = {column: pattern for column, pattern in patterns.items() if pattern.replace("{robot}", robot) == column}
        each = _read_columns(path, text, method, {*patterns} - {*named}, named)
        if own:  # x_mine beside x_theirs
            return each
        if len(each) > 1:
            remedy = f"name the method by its column, as in {robot}={path.name}"
            raise BadInput(f"{path} has columns of {first_of(robots)}, and none of {method!r}: {remedy}")
        found[robot] = each[""]
    return found or _read_columns(path, text, method)


def _is_x_of(name: str, method: str) -> bool:
    """Return whether a column is x of a method or of the truth, by its words."""
    quantity, _, side = name_meaning(name)
    return quantity == "x" and method.lower() in {side, *re.split(r"[\W_]", name.lower())}


def _columns_of(
    path: Path, text: str, method: str, others: Collection[str] = ()
) -> tuple[list[str], dict[str, Guess], dict[str, set[str]]]:
    """Return the names of a CSV file's columns, but for those of `others`, and what the first of each quantity mean.

    They mean nothing in a file of KITTI. Of columns of the truth, of odometry and of an estimate the method's count.
    The column that names methods comes last, with its words for this one.
    """
    head, _, rows = split_fields(text)
    whole = [fields for _, fields in rows if len(fields) == len(head)]
    if not whole or len({*head}) < len(head):
        fault = f"two columns have one name: {', '.join(head)}" if whole else f"it has no line of {len(head)} fields"
        raise BadInput(f"{path}: {fault}; correct the file")
    columns: dict[str, Array | tuple[str, ...]] = {}
    of_method: dict[str, set[str]] = {}
    for k, name in enumerate(head):
        if name in others:
            continue
        some = tuple(fields[k] for fields in whole[:ENOUGH])
        numbers = parse_fields(some)
        if not np.isinf(numbers).all():
            columns[name] = np.where(np.isinf(numbers), np.nan, numbers)
            continue
        words = {fields[k] for fields in whole}
        is_flag = {word.lower() for word in words} <= {"true", "false"}
        if own := {
            word
            for word in words
            if word.lower() == method.lower() or (method == TRUTH == side_of(word) and not is_flag)
        }:
            of_method = {name: own}
        else:
            columns[name] = some
    head, table = [*columns], CsvTable(path.name, columns)
    if table.is_nameless and len(head) == KITTI and not any(isinstance(each, tuple) for each in columns.values()):
        rotations = np.column_stack([*columns.values()]).reshape(-1, 3, 4)[:, :, :3]
        rotations = rotations[np.isfinite(rotations).all((1, 2))]
        if len(rotations) and np.median(np.abs(np.linalg.det(rotations) - 1)) < UNIT:
            return head, {}, {}
    guesses = infer_columns(table._replace(name=f"{TRUTH}/{path.name}") if table.is_nameless else table)
    both = len({guess.side == TRUTH for guess in guesses if guess.quantity == "x"}) == 2
    wanted = [g for g in guesses if not both or g.quantity not in PLACED or (g.side == TRUTH) == (method == TRUTH)]
    # Of odom_x and ekf_x that of the method comes first, and those of odometry and of what was wanted last.
    wanted.sort(
        key=lambda g: (
            method.lower() not in re.split(r"[\W_]", g.column.lower()),
            g.side == "odometry",
            is_second_choice(g.column),
        )
    )
    known = {guess.quantity: guess for guess in reversed(wanted)}
    if missing := [quantity for quantity in ("x", "y") if quantity not in known]:
        remedy = "write their names above: stamp,x,y,heading" if table.is_nameless else "name one so"
        raise BadInput(f"{path} has no column {missing[0]}; it has {', '.join(head)}: {remedy}")
    if is_on_globe(known["x"].column):
        raise BadInput(f"{path}: {known['x'].column} and {known['y'].column} are degrees on the globe: write x, y [m]")
    return head, known, of_method


def _read_columns(
    path: Path, text: str, method: str, others: Collection[str] = (), patterns: Mapping[str, str] | None = None
) -> dict[str, Trajectory]:
    """Read the columns of a CSV file but for `others`, by robot; eight columns without names as TUM.

    In `patterns`, the names of one robot's columns, {robot} stands for its own.
    """
    head, own, of_method = _columns_of(path, text, method, others)
    if not own or head == [*"12345678"]:
        table = _keep(read_lines(path, head, ()), len(head))
        return {"": _poses_of_tum(table) if own else _poses_of_kitti(table)}
    turned, clock = own.get("heading"), next((clock for clock in CLOCKS if {*clock} <= {*own}), ())
    turns = (turned.quaternion or (turned.column,)) if turned else ()
    placed = [own[quantity] for quantity in ("x", "y", *clock)]
    entries = _entries_of(path, {name: (patterns or {}).get(name, name) for name in head})
    wanted = (*(guess.column for guess in placed), *turns, *(name for *_, name in entries))
    whose = [own["robot"].column] if "robot" in own else []
    table = _keep(read_lines(path, wanted, [*whose, *of_method]), len(placed), *of_method.values())
    units = [UNITS[SI.get(g.quantity, "m")].get(name_meaning(g.column)[1], 1.0) for g in placed if g.quantity != "nsec"]
    units += [1e-9] * ("nsec" in clock)
    n, values, notes = len(placed), table.values, table.notes
    if entries and units[0] != 1.0:
        remedy = f"whose unit is not told, beside {placed[0].column}: write all of m and rad"
        raise BadInput(f"{path} has {entries[0][-1]}, {remedy}")
    of_turns, x = values[:, n : n + len(turns)], np.full((len(values), 3), np.nan)
    x[:, :2] = values[:, :2] * units[:2]
    if len(turns) > 1:
        x[:, 2] = _heading_of(path, np.pad(of_turns, ((0, 0), (4 - len(turns), 0))))
    elif turned:
        x[:, 2] = of_turns[:, 0] * _radians_in(path, turned)
    P, is_diagonal = _matrices_of(values[:, n + len(turns) :], entries)
    if is_diagonal:
        notes += (f"{path}: no columns have covariances beside the diagonal: they count as 0",)
    places = {n for n in (*head, *others) if name_meaning(n)[0] == "x" and side_of(n) != TRUTH}
    if entries and places - {placed[0].column} and method != TRUTH:
        notes += (f"{path}: {entries[0][-1]} does not say of which x it is: it counts for {placed[0].column}",)
    if CsvTable(path.name, dict.fromkeys(head, ())).is_nameless:
        means = {column: quantity for quantity, guess in own.items() for column in guess.quaternion or (guess.column,)}
        taken = ", ".join(f"{name} for {means.get(name) or 'nothing'}" for name in head)
        notes += (f"{path.parent}: columns without names are by their values {taken}; if that is wrong, write names",)
    names = np.array([row[0] for row in table.names]) if whose else np.empty(0, str)
    one = not 1 < len({*names.tolist()}) <= len(x) / 2  # with a name for every line, they number lines
    if clock:
        stamps = (values[:, 2:n] * units[2:]).sum(1)
    else:
        stamps = _count_lines(table) if one else np.asarray(pd.Series(names).groupby(names).cumcount(), float)
        notes += (UNTIMED,)
    every = Trajectory(stamps, x, _covariances(P, table), notes)
    return {"": every} if one else {robot: every.select(names == robot) for robot in sorted({*names.tolist()})}


def _radians_in(path: Path, heading: Guess) -> float:
    """Return the unit of a column of headings; refuse those of a compass, and degrees that its name does not tell."""
    named = UNITS["rad"].get(name_meaning(heading.column)[1], 1.0)
    if heading.unit.startswith("-"):
        raise BadInput(f"{path}: {heading.column} is clockwise from north: write heading, [rad] from x to y")
    if heading.unit == "deg" and named == 1.0:
        name, why = heading.column, heading.reason.rpartition("; ")[2]
        raise BadInput(f"{path}: {name}: {why}: call it {name}_deg if it is in degrees, else {name}_rad")
    return named


CovarianceColumn = tuple[
    bool, int, int, str
]  # of a covariance, not a standard deviation; row, column; the name of its column


def _matrices_of(values: Array, entries: Sequence[CovarianceColumn]) -> tuple[Array, bool]:
    """Return covariances (T, 3, 3) of their entries (T, k), and whether those of some axes have the diagonal alone.

    Their other entries are 0 then.
    """
    P = np.full((len(values), 3, 3), np.nan)
    for (is_entry, i, j, _), own in zip(entries, values.T, strict=True):  # entries come after standard deviations
        P[:, i, j] = P[:, j, i] = own if is_entry else own**2
    alone = [d for d in (1, 2) if np.isfinite(P[:, d, d]).any() and np.isnan(P[:, :d, d]).all()]
    for d in alone:
        P[:, :d, d] = P[:, d, :d] = np.where(np.isnan(P[:, :1, 0]), np.nan, 0.0)
    return P, bool(alone)


def _entries_of(path: Path, head: Mapping[str, str]) -> list[CovarianceColumn]:
    """Return the columns of covariances among those of a file; refuse other units than m and rad, and half of them."""
    entries = sorted(entry for name, named in _letter_rows(head).items() if (entry := _entry_of(named, name)))
    own = {row for _, row, other, _ in entries if row == other} & {0, 1}
    names = ", ".join(name for *_, name in entries)
    if len(own) == 1:
        raise BadInput(f"{path} has {names}, and none of {'xy'[1 - min(own)]} with itself: add it, or remove them")
    if odd := [name for *_, name in entries if OTHER_UNITS & {*words_of(name)}]:
        raise BadInput(f"{path}: {odd[0]} has another unit: write covariances, or deviations, of m and rad")
    return entries if own else []  # x_h and y_h alone are of places


def _letter_rows(head: Mapping[str, str]) -> dict[str, str]:
    """Return names with letters for the rows and columns of a matrix: P00, P01, P11 as of numpy, P11, P12 as of MATLAB.

    A matrix of more than three rows has states that are not known.
    """
    found = {name: NUMBERED.fullmatch(named) for name, named in head.items()}
    rows = {int(row) for m in found.values() if m for row in m.groups()[1:]}
    letters = {row: letter for row, letter in zip(sorted(rows), "xyh", strict=False) if len(rows) in (2, 3)}
    return {
        name: f"{m[1]}{letters[int(m[2])]}{letters[int(m[3])]}" if (m := found[name]) and letters else named
        for name, named in head.items()
    }


def _entry_of(named: str, column: str) -> CovarianceColumn | None:
    """Return whether a column is of a covariance, or of a standard deviation, and the row and the column of its entry.

    By its name: xx, Pxy, cov_yy, var_x, sigma_x, pos_x_std, or covariance7 and covariance[7] of ROS's 36.
    """
    plain = re.sub(r"[\[(]\D.*", "", named.replace("{robot}", ""))
    if numbered := re.search(r"covariance[^a-z\d]?(\d+)\W?$", plain):
        row, other = (OF_ROS.get(k, -1) for k in divmod(int(numbered[1]), 6))
        return (True, row, other, column) if "twist" not in plain and 0 <= row <= other else None
    words = [word for word in words_of(plain) if word not in OTHER_UNITS | OF_PLACES]
    words = words[-1:] + words[:-1] if re.fullmatch(_MEASURE, "".join(words[-1:])) else words
    entry = ENTRY.fullmatch("".join(words)) if not re.search(r"\d", plain) else None
    if not entry or not (entry[4] or (entry[1] and not entry[2])):
        return None
    row, other = sorted((AXES[entry[3]], AXES[entry[4] or entry[3]]))
    return not re.fullmatch(_DEVIATION, entry[1] or "") or bool(entry[4]), row, other, column


def _keep(table: TextTable, width: int, words: Collection[str] = ()) -> TextTable:
    """Return the lines whose first numbers, so many, are all known, and whose last name is one of the words, if any."""
    known = np.isfinite(table.values[:, :width]).all(1)
    if words:
        known &= np.array([row[-1] in words for row in table.names])
    if not known.any():
        raise BadInput(f"{table.path}: no line has a stamp, x and y; correct the file")
    names = [table.names[row] for row in np.flatnonzero(known).tolist()] if table.names else ()
    return table._replace(values=table.values[known], line=table.line[known], names=names)


def _read_stored(path: Path) -> dict[str, Array]:
    """Read the arrays of an npz file; none where there is no file."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return {name: np.asarray(stored[name], float) for name in stored.files}
    except FileNotFoundError:
        return {}
    except (ValueError, TypeError, OSError, zipfile.BadZipFile) as e:
        raise BadInput(f"{path}: cannot be read ({' '.join(str(e).split())[:100]}); write it with np.savez") from None


def _read_bag(place: Path, robots: Sequence[str], method: str) -> dict[str, Trajectory]:
    """Read the poses in a bag, with their covariances, by robot; of a damaged bag what can be recovered."""
    found, notes = read_poses(place, robots, method)
    team = {}
    for robot, (topic, rows, is_named) in found.items():
        lines = TextTable(place, rows, np.arange(len(rows)))
        _require_flat(f"{place}, {topic}", rows[:, 1:4])
        P = _covariances(rows[:, 5:].reshape(-1, 3, 3), lines, f"{topic}, message")
        taken = () if is_named else (f"{place}: topic {topic} is taken for robot {robot!r}",)
        team[robot] = _by_time(place, Trajectory(rows[:, 0], rows[:, [1, 2, 4]], P, (*notes, *taken)))
    return team


def _from_triangle(values: Array) -> Array:
    """Return matrices (T, d, d) of their upper triangles (T, d (d + 1) / 2); those of a pose may lack the heading's."""
    d = 2 if values.shape[1] == len(TRIANGLE[2][0]) else 3
    P = np.full((len(values), d, d), np.nan)
    P[:, TRIANGLE[d][0], TRIANGLE[d][1]] = P[:, TRIANGLE[d][1], TRIANGLE[d][0]] = values
    return P


def _covariances(P: Array, table: TextTable, line: str = "line") -> Array:
    """Return covariances (T, 3, 3) of matrices (T, d, d), nan where none is known; refuse what is no covariance."""
    out = np.full((len(P), 3, 3), np.nan)
    out[:, : P.shape[1], : P.shape[1]] = P
    if (out[:, :2, :2] == 0).all():
        out[:] = np.nan
    if (out[:, 2] == 0).all():
        out[:, 2] = out[:, :, 2] = np.nan
    scale = np.abs(np.nan_to_num(out)).max((1, 2))
    asymmetry = np.abs(np.nan_to_num(out - out.mT)).max((1, 2))
    for row in np.flatnonzero(asymmetry > ROUNDING * scale).tolist():
        raise BadInput(f"{table.path}, {line} {table.line[row]}: the covariance is not symmetric: correct it")
    for d in (2, 3):
        known: Mask = np.asarray(np.isfinite(out[:, :d, :d]).all((1, 2)))
        least = np.linalg.eigvalsh(np.where(known[:, None, None], out[:, :d, :d], np.eye(d))).min(1)
        for row in np.flatnonzero(least < -1e-3 * ROUNDING * scale).tolist():
            where = f"{table.path}, {line} {table.line[row]}"
            raise BadInput(
                f"{where}: the covariance is not positive, its least eigenvalue is {least[row]:.3g}: correct it"
            )
    return out

"""UTIAS MRCLAM: real robots with cameras, commanded velocities as odometry, and motion capture as the truth.

Any of the nine data sets can be read; each is one trial. The scenario `mrclam` states its models; as recordings of a
team, `log`, they are fitted. Gross outliers are kept: gating them is the estimator's task. A measurement carries a
barcode, which `Barcodes.dat` maps to a subject: a robot (1 to n) or a landmark.

Source: K. Leung, Y. Halpern, T. Barfoot, H. Liu, "The UTIAS multi-robot cooperative localization and mapping
dataset", IJRR 30(8), 2011.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Belief, Mask, Senses, World
from cooploc.estimators.models import Sighting, Unicycle, wrap_heading
from cooploc.scenarios.recordings.sampling import Grid, cells, interpolate, mean_held
from cooploc.scenarios.recordings.schema import TeamDescription
from cooploc.scenarios.recordings.team_log import Measured, Places, Readings, Series, TeamLog, in_order, split_channels
from cooploc.scenarios.recordings.text_files import Table, read_table, require_unique, require_whole, sort_by_time
from cooploc.scenarios.stream import Air, Stream, Truth
from cooploc.scenarios.worlds.radio import Positive


class DataSet(NamedTuple):
    """The files of a data set, robots in order."""

    truth: list[Table]  # time, x, y, heading
    odometry: list[Table]  # time, v, omega
    readings: list[Table]  # time, barcode, range, bearing
    steps_back: dict[str, int]  # by file: how often its clock stepped back
    landmarks: Array  # (l, 2) [m] in the order of Landmark_Groundtruth.dat
    subjects: tuple[int, ...]  # (l,) the landmarks' numbers
    columns: Mapping[int, int]  # barcode -> robot 0..n-1, or n + landmark


def read_data_set(data: Path) -> DataSet:
    """Read every file of the data set in a directory.

    Raises:
        BadInput: a file is missing or malformed; names file, line and remedy.

    """
    if not data.is_dir():
        raise BadInput(
            f"{data}: there is no such directory; name the one that holds Barcodes.dat and Robot1_Odometry.dat"
        )
    found = [re.fullmatch(r"Robot([1-9]\d*)_Odometry\.dat", path.name) for path in data.iterdir()]
    n = max((int(match[1]) for match in found if match), default=1)
    surveyed = read_table(
        data / "Landmark_Groundtruth.dat", ("subject", "x [m]", "y [m]", "x sd [m]", "y sd [m]"), True
    )
    columns = _columns(read_table(data / "Barcodes.dat", ("subject", "barcode"), True), surveyed, n)
    steps_back: dict[str, int] = {}

    def team(kind: str, *names: str) -> list[Table]:
        tables = [read_table(data / f"Robot{i + 1}_{kind}.dat", ("time [s]", *names)) for i in range(n)]
        ordered = [sort_by_time(table) for table in tables]
        steps_back.update({table.path.name: steps for table, steps in ordered if steps})
        return [table for table, _ in ordered]

    truth = team("Groundtruth", "x [m]", "y [m]", "heading [rad]")
    odometry = team("Odometry", "v [m/s]", "omega [rad/s]")
    readings = team("Measurement", "barcode", "range [m]", "bearing [rad]")
    for table in readings:
        require_whole(table, 1, "barcode")
    subjects = tuple(map(int, surveyed.values[:, 0]))
    return DataSet(truth, odometry, readings, steps_back, surveyed.values[:, 1:3], subjects, columns)


def unknown_barcodes(files: DataSet) -> dict[str, Any]:
    """Count the barcodes of no subject (misread, or of a landmark not surveyed): how many, and where the first is."""
    found: dict[str, Any] = {}
    for table in files.readings:
        for row, code in enumerate(map(int, table.values[:, 1])):
            if code not in files.columns:
                first = f"{table.path.name}, line {table.line[row]}"
                found.setdefault(str(code), {"count": 0, "first": first})["count"] += 1
    return found


def _columns(barcodes: Table, surveyed: Table, n: int) -> dict[int, int]:
    """Barcode -> robot 0..n-1, or n + landmark.

    Raises:
        BadInput: a number is there twice, a landmark has a robot's number, or a subject has no barcode.

    """
    for table, column, name in ((barcodes, 0, "subject"), (barcodes, 1, "barcode"), (surveyed, 0, "subject")):
        require_unique(table, column, name)
    code = {int(subject): int(barcode) for subject, barcode in barcodes.values}
    columns = {}
    for subject in range(1, n + 1):
        if subject not in code:
            raise BadInput(f"{barcodes.path}: robot {subject} has no barcode; add its line")
        columns[code[subject]] = subject - 1
    for row, subject in enumerate(map(int, surveyed.values[:, 0])):
        where = f"{surveyed.at(row)}: landmark {subject}"
        if subject <= n:
            raise BadInput(f"{where} has a robot's number; number landmarks above {n}")
        if subject not in code:
            raise BadInput(f"{where} has no barcode; add its line to {barcodes.path.name}")
        columns[code[subject]] = n + row
    return columns


# ---- The scenario `mrclam`

MARGIN = 2.0  # [m] around the landmarks: the arena must not be taken from the truth


class Mrclam(BaseModel):
    """Parameters of the scenario. All lengths in m, times in s, angles in rad."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    data: Path  # the directory of one data set
    sees: Literal["all", "one", "none"] = "all"  # who uses landmarks: all robots, only robot 1, none
    tick: Annotated[float, Field(ge=0.01, le=10)] = 0.1
    start: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0  # [s] after every robot has truth and odometry
    until: Literal["any", "all"] = "all"  # while all robots have truth; or while any has, masking the others'
    duration: Positive | None = None  # [s] at most
    sigma_v: Positive = 0.04  # [m/s]
    sigma_omega: Positive = 0.15  # [rad/s]
    sigma_range: Positive = 0.15
    sigma_bearing: Positive = 0.02
    prior_position: Positive = 0.01  # sd per axis; the prior's mean is the true start
    prior_heading: Positive = 0.01  # sd
    max_gap: Positive = 0.5  # [s] the truth is not interpolated across longer gaps

    def world(self) -> World:
        """Return what the team knows: landmarks, and assumed models of motion and camera.

        Raises:
            BadInput: a file is missing or malformed; names file, line and remedy.

        """
        files, camera = read_data_set(self.data), Sighting(self.sigma_range, self.sigma_bearing)
        return World(
            robots=len(files.odometry),
            tick=self.tick,
            arena=_arena(files.landmarks),
            motion=Unicycle(self.sigma_v, self.sigma_omega, self.tick),
            sensors={"landmark": camera, "sighting": camera},
            landmarks=files.landmarks,
            t0=self._span(files)[0],
        )

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Truth and stream of the one trial, with `world` as what the team knows; the seed changes nothing.

        Raises:
            BadInput: trials is not [0], a file is missing or malformed, or the chosen part has no truth.

        """
        if list(trials) != [0]:
            raise BadInput(
                f"scenario {label!r} is a recording and has one trial, 0, not {list(trials)}; ask for trials=1"
            )
        files = read_data_set(self.data)
        t0, edges = self._span(files)
        poses = np.stack([self._poses(table, t0, edges) for table in files.truth], 1)
        path = poses[None, 1:]
        valid: Mask = np.asarray(np.isfinite(path).all(-1))
        senses, notes = self._senses(files, t0, edges)
        t, T, n = valid.shape
        linked = np.broadcast_to(~np.eye(n, dtype=bool), (t, T, n, n)).copy()
        stream = Stream(
            scenario=label,
            seed=seed,
            trial=np.zeros(1, np.int64),
            time=t0 + edges[1:],
            world=world,
            prior=self._prior(poses[0]),
            senses=senses,
            air=Air(linked, np.empty((t, T, n, 0)), np.empty((t, T, n, 0))),
            notes=self._notes() | notes | {"truth_masked": (~valid[0]).sum(0).tolist()},
        )
        return Truth(label, stream.trial, path, valid, _arena(files.landmarks), stream.hashes), stream

    def _span(self, files: DataSet) -> tuple[float, Array]:
        """The prior's time [s], and the edges (T + 1,) of the ticks after it [s]."""
        begin = max(table.values[0, 0] for table in (*files.truth, *files.odometry))
        last = {"any": max, "all": min}[self.until]
        end = min(last(t.values[-1, 0] for t in tables) for tables in (files.truth, files.odometry))
        length = min(end - begin - self.start, self.duration or np.inf)
        if length < self.tick:
            raise BadInput(
                f"{self.data}: truth and odometry of all robots begin at {begin:.3f} s and end at {end:.3f} s; "
                f"start={self.start:g} leaves no tick of {self.tick:g} s: choose another start, duration or tick"
            )
        return float(begin) + self.start, self.tick * np.arange(int(length / self.tick + 1e-6) + 1.0)

    def _poses(self, table: Table, t0: float, at: Array) -> Array:
        """True poses (len(at), 3), interpolated along the unwrapped heading; nan where the truth was not recorded."""
        stamps, poses = table.values[:, 0] - t0, table.values[:, 1:].copy()
        poses[:, 2] = np.unwrap(poses[:, 2])
        return wrap_heading(interpolate(stamps, poses, at, self.max_gap))

    def _prior(self, poses: Array) -> Belief:
        """The true poses (n, 3) at t0."""
        lost = np.isnan(poses).any(-1)
        if lost.any():
            raise BadInput(
                f"{self.data}: robot {np.argmax(lost) + 1} has no truth at start={self.start:g} s, where the prior is "
                "taken: choose another start or a larger max_gap"
            )
        P = np.diag([self.prior_position**2, self.prior_position**2, self.prior_heading**2])
        return Belief(poses[None], np.broadcast_to(P, (1, len(poses), 3, 3)).copy())

    def _senses(self, files: DataSet, t0: float, edges: Array) -> tuple[Senses, dict[str, Any]]:
        """Return odometry and readings, and notes of what was dropped."""
        commands = [mean_held(table.values[:, 0] - t0, table.values[:, 1:], edges) for table in files.odometry]
        odometry = np.stack(commands, 1)[None]
        seen, notes = self._cells(files, t0, len(edges) - 1)
        t, T, n, _ = odometry.shape
        # A robot that does not use landmarks gets nan, not width 0: an estimator that runs on one variant runs on all.
        users = np.arange(n) < {"all": n, "one": 1, "none": 0}[self.sees]
        landmark = np.where(users[:, None, None], seen[None, :, :, n:], np.nan)
        dt, anchors = np.full((t, T, n), self.tick), np.empty((t, T, n, 0))
        notes |= {
            "clock_set_back": files.steps_back,
            "odometry_missing": np.isnan(odometry[0]).any(-1).sum(0).tolist(),
        }
        return Senses(odometry, dt, anchors, landmark, seen[None, :, :, :n], {}), notes

    def _cells(self, files: DataSet, t0: float, ticks: int) -> tuple[Array, dict[str, Any]]:
        """Range and bearing (T, n, n + l, 2), each at the tick nearest to its stamp, and what was dropped."""
        n, columns = len(files.readings), len(files.readings) + len(files.landmarks)
        table = np.concatenate([t.values for t in files.readings])
        robot = np.repeat(np.arange(n), [len(t.values) for t in files.readings])
        column = np.array([files.columns.get(int(code), -1) for code in table[:, 1]])
        itself = column == robot
        good = (column >= 0) & ~itself
        readings = Readings(table[good, 0], robot[good], column[good], table[good, 2:], "")
        found, counts = cells(readings, Grid(t0, self.tick, ticks), n, columns)
        return found, {
            "readings": len(table),
            "readings_kept": counts["kept"],
            "collisions": counts["collisions"],
            "outside_span": counts["outside_span"],
            "self_sightings": int(itself.sum()),
            "unknown_barcodes": unknown_barcodes(files),
        }

    def _notes(self) -> dict[str, Any]:
        return {
            "world": type(self).__name__,
            "parameters": self.model_dump(mode="json", exclude={"data"}),
            "recording": self.data.resolve().name,
            "source": "UTIAS MRCLAM; Leung, Halpern, Barfoot, Liu, IJRR 30(8), 2011",
            "prior": f"true pose at t0, interpolated; assumed sd {self.prior_position:g} m, {self.prior_heading:g} rad",
        }


def _arena(landmarks: Array) -> Array:
    return np.stack([landmarks.min(0) - MARGIN, landmarks.max(0) + MARGIN])


# ---- Data sets as recordings of a team of any number of robots, whose models are fitted

BARCODES = "Barcodes.dat"


def runs(data: Path, description: TeamDescription) -> dict[str, Path]:
    """Return the data sets in a directory: itself, or each directory in it.

    Raises:
        BadInput: there are none.

    """
    if (data / BARCODES).exists():
        return {data.resolve().name: data}
    found = {path.name: path for path in sorted(data.iterdir()) if (path / BARCODES).exists()}
    if not found:
        raise BadInput(f"{data}: neither it nor a directory in it holds {BARCODES}; name a data set of MRCLAM")
    return found


def read(data: Path, place: Path, name: str, description: TeamDescription) -> TeamLog:
    """Read one data set: robots "1", "2" ..., landmarks by their numbers.

    Raises:
        BadInput: a file is missing or malformed; names file, line and remedy.

    """
    files = read_data_set(place)
    robots = tuple(str(i + 1) for i in range(len(files.odometry)))
    landmarks = tuple(str(subject) for subject in files.subjects)
    warnings: list[str] = []

    def series(table: Table) -> Series:
        found, notes = in_order(table.values[:, 0], table.values[:, 1:], str(table.path))
        warnings.extend([*table.notes, *notes])
        return found

    odometry, truth = (tuple(map(series, tables)) for tables in (files.odometry, files.truth))
    names = (*robots, *landmarks)
    measured = []
    for robot, table in zip(robots, files.readings, strict=True):
        codes = [int(code) for code in table.values[:, 1]]
        other = [names[files.columns[code]] if code in files.columns else f"barcode {code}" for code in codes]
        warnings.extend(table.notes)
        measured.append(Measured(table.values[:, 0], [robot] * len(codes), other, table.values[:, 2:], str(table.path)))
    readings, notes = split_channels("sighting", measured, robots, landmarks)
    places, none = Places(landmarks, files.landmarks), Places((), np.empty((0, 2)))
    return TeamLog(name, robots, "velocity", odometry, truth, readings, places, none, (*warnings, *notes))

"""UTIAS MRCLAM: real robots with cameras, commanded velocities as odometry, and motion capture as the truth.

A measurement carries the barcode of what was seen, which `Barcodes.dat` maps to a robot (1 to n) or to a landmark.
Gross outliers are left in: gating them is an estimator's business. Any of the nine data sets fits; there is one trial.

Source: K. Leung, Y. Halpern, T. Barfoot, H. Liu, "The UTIAS multi-robot cooperative localization and mapping dataset",
IJRR 30(8), 2011.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from cooploc.estimators.interface import Array, Belief, Mask, Senses, World
from cooploc.estimators.models.angles import wrap_heading
from cooploc.estimators.models.motion import Unicycle
from cooploc.estimators.models.sensors import Sighting
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.recordings import text_tables
from cooploc.scenarios.recordings.text_tables import Table, read_table
from cooploc.scenarios.stream import Air, Stream, Truth
from cooploc.scenarios.worlds.radio_arena import Positive

MARGIN = 2.0  # [m] the robots drive around the landmarks; the arena is told without looking at the truth


class Recording(NamedTuple):
    """The files of a data set, robots in order."""

    truth: list[Table]  # time, x, y, heading
    odometry: list[Table]  # time, v, omega
    readings: list[Table]  # time, barcode, range, bearing
    set_back: dict[str, int]  # by file: how often its clock was set back
    places: Array  # (l, 2) of the landmarks, as Landmark_Groundtruth.dat lists them
    seen: Mapping[int, int]  # barcode -> robot 0..n-1, or n + landmark


class Mrclam(BaseModel):
    """Parameters of the recording. All lengths in m, times in s, angles in rad."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    data: Path  # the directory of one data set
    sees: Literal["all", "one", "none"] = "all"  # who uses landmarks: everybody, only robot 1, nobody
    tick: Annotated[float, Field(ge=0.01, le=10)] = 0.1
    start: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0  # [s] after every robot has truth and odometry
    until: Literal["any", "all"] = "all"  # to the last truth of any robot, others' masked; or while all have truth
    duration: Positive | None = None  # [s] ends earlier
    sigma_v: Positive = 0.04  # [m/s]
    sigma_omega: Positive = 0.15  # [rad/s]
    sigma_range: Positive = 0.15
    sigma_bearing: Positive = 0.02
    prior_position: Positive = 0.01  # sd per axis; the prior's mean is the true start
    prior_heading: Positive = 0.01  # sd
    max_gap: Positive = 0.5  # [s] the truth is not interpolated across longer holes

    def world(self) -> World:
        """What the team is told of this recording."""
        recording = _load(self.data)
        seen, places = Sighting(self.sigma_range, self.sigma_bearing), recording.places
        return World(
            robots=len(recording.odometry),
            tick=self.tick,
            arena=_arena(places),
            motion=Unicycle(self.sigma_v, self.sigma_omega, self.tick),
            sensors={"landmark": seen, "sighting": seen},
            landmarks=places,
            t0=self._span(recording)[0],
        )

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Truth and stream of the one trial. `world` is what the team is told; the seed changes nothing."""
        text_tables.only_trial(label, trials)
        recording = _load(self.data)
        t0, edges = self._span(recording)
        poses = np.stack([self._poses(table, t0, edges) for table in recording.truth], 1)
        path = poses[None, 1:]
        valid: Mask = np.asarray(np.isfinite(path).all(-1))
        senses, notes = self._senses(recording, t0, edges)
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
        return Truth(label, stream.trial, path, valid, _arena(recording.places), stream.hashes), stream

    def _span(self, recording: Recording) -> tuple[float, Array]:
        """The prior's time [s], and the edges (T + 1,) of the ticks after it [s]."""
        begin = max(table.values[0, 0] for table in (*recording.truth, *recording.odometry))
        last = {"any": max, "all": min}[self.until]
        end = min(last(t.values[-1, 0] for t in tables) for tables in (recording.truth, recording.odometry))
        length = min(end - begin - self.start, self.duration or np.inf)
        if length < self.tick:
            raise BadInput(
                f"{self.data}: every robot has truth and odometry from {begin:.3f} s on, they end at {end:.3f} s; "
                f"start={self.start:g} leaves no tick of {self.tick:g} s: choose another start, duration or tick"
            )
        return float(begin) + self.start, self.tick * np.arange(int(length / self.tick + 1e-6) + 1.0)

    def _poses(self, table: Table, t0: float, at: Array) -> Array:
        """True poses (len(at), 3), interpolated along the unwrapped heading; nan where the truth was not recorded."""
        stamps, poses = table.values[:, 0] - t0, table.values[:, 1:].copy()
        poses[:, 2] = np.unwrap(poses[:, 2])
        return wrap_heading(text_tables.interpolated(stamps, poses, at, self.max_gap))

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

    def _senses(self, recording: Recording, t0: float, edges: Array) -> tuple[Senses, dict[str, Any]]:
        """What was sensed, and notes of what was dropped."""
        commands = [
            text_tables.held_mean(table.values[:, 0] - t0, table.values[:, 1:], edges) for table in recording.odometry
        ]
        odometry = np.stack(commands, 1)[None]
        cells, notes = self._cells(recording, t0, len(edges) - 1)
        t, T, n, _ = odometry.shape
        # Whoever does not use landmarks gets nan, not width 0: whatever runs on one of the three runs on all.
        users = np.arange(n) < {"all": n, "one": 1, "none": 0}[self.sees]
        landmark = np.where(users[:, None, None], cells[None, :, :, n:], np.nan)
        dt, anchors = np.full((t, T, n), self.tick), np.empty((t, T, n, 0))
        notes |= {
            "clock_set_back": recording.set_back,
            "odometry_missing": np.isnan(odometry[0]).any(-1).sum(0).tolist(),
        }
        return Senses(odometry, dt, anchors, landmark, cells[None, :, :, :n], {}), notes

    def _cells(self, recording: Recording, t0: float, ticks: int) -> tuple[Array, dict[str, Any]]:
        """Range and bearing (T, n, n + l, 2), each at the tick nearest to its stamp, and what was dropped."""
        n, columns = len(recording.readings), len(recording.readings) + len(recording.places)
        table = np.concatenate([t.values for t in recording.readings])
        robot = np.repeat(np.arange(n), [len(t.values) for t in recording.readings])
        column = np.array([recording.seen.get(int(code), -1) for code in table[:, 1]])
        tick = np.floor((table[:, 0] - t0) / self.tick + 0.5).astype(np.int64) - 1
        known, itself, inside = column >= 0, column == robot, (tick >= 0) & (tick < ticks)
        good = known & ~itself & inside
        cell = np.ravel_multi_index((tick[good], robot[good], column[good]), (ticks, n, columns))
        cell, last = np.unique(cell[::-1], return_index=True)
        cells = np.full((ticks * n * columns, 2), np.nan)
        cells[cell] = table[good, 2:][::-1][last]
        return cells.reshape(ticks, n, columns, 2), {
            "readings": len(table),
            "readings_kept": len(cell),
            "collisions": int(good.sum()) - len(cell),
            "outside_span": int((known & ~itself & ~inside).sum()),
            "self_sightings": int(itself.sum()),
            "unknown_barcodes": _unknown(recording),
        }

    def _notes(self) -> dict[str, Any]:
        return {
            "world": type(self).__name__,
            "parameters": self.model_dump(mode="json", exclude={"data"}),
            "recording": self.data.resolve().name,
            "source": "UTIAS MRCLAM; Leung, Halpern, Barfoot, Liu, IJRR 30(8), 2011",
            "prior": f"true pose at t0, interpolated; told sd {self.prior_position:g} m, {self.prior_heading:g} rad",
        }


def _arena(places: Array) -> Array:
    return np.stack([places.min(0) - MARGIN, places.max(0) + MARGIN])


def _unknown(recording: Recording) -> dict[str, Any]:
    """Barcodes that nothing here has (misread, or of a landmark not surveyed): how many, and where the first is."""
    found: dict[str, Any] = {}
    for table in recording.readings:
        for row, code in enumerate(map(int, table.values[:, 1])):
            if code not in recording.seen:
                first = f"{table.path.name}, line {table.line[row]}"
                found.setdefault(str(code), {"count": 0, "first": first})["count"] += 1
    return found


def _load(data: Path) -> Recording:
    """Every file of a data set."""
    if not data.is_dir():
        raise BadInput(
            f"{data}: there is no such directory; name the one that holds Barcodes.dat and Robot1_Odometry.dat"
        )
    found = [re.fullmatch(r"Robot([1-9]\d*)_Odometry\.dat", path.name) for path in data.iterdir()]
    n = max((int(match[1]) for match in found if match), default=1)
    places = read_table(data / "Landmark_Groundtruth.dat", ("subject", "x [m]", "y [m]", "x sd [m]", "y sd [m]"))
    seen = _subjects(read_table(data / "Barcodes.dat", ("subject", "barcode")), places, n)
    set_back: dict[str, int] = {}

    def team(kind: str, *columns: str) -> list[Table]:
        tables = [read_table(data / f"Robot{i + 1}_{kind}.dat", ("time [s]", *columns)) for i in range(n)]
        ordered = [text_tables.in_order(table) for table in tables]
        set_back.update({table.path.name: steps for table, steps in ordered if steps})
        return [table for table, _ in ordered]

    truth = team("Groundtruth", "x [m]", "y [m]", "heading [rad]")
    odometry = team("Odometry", "v [m/s]", "omega [rad/s]")
    readings = team("Measurement", "barcode", "range [m]", "bearing [rad]")
    for table in readings:
        text_tables.demand_whole(table, 1, "barcode")
    return Recording(truth, odometry, readings, set_back, places.values[:, 1:3], seen)


def _subjects(barcodes: Table, places: Table, n: int) -> dict[int, int]:
    """Barcode -> robot 0..n-1, or n + landmark.

    Raises:
        BadInput: a number stands twice, a landmark has a robot's number, or somebody has no barcode.

    """
    for table, column, name in ((barcodes, 0, "subject"), (barcodes, 1, "barcode"), (places, 0, "subject")):
        text_tables.demand_keys(table, column, name)
    code = {int(subject): int(barcode) for subject, barcode in barcodes.values}
    seen = {}
    for subject in range(1, n + 1):
        if subject not in code:
            raise BadInput(f"{barcodes.path}: robot {subject} has no barcode; add its line")
        seen[code[subject]] = subject - 1
    for row, subject in enumerate(map(int, places.values[:, 0])):
        if subject <= n:
            raise BadInput(f"{places.at(row)}: landmark {subject} has a robot's number; number landmarks above {n}")
        if subject not in code:
            raise BadInput(f"{places.at(row)}: landmark {subject} has no barcode; add its line to {barcodes.path.name}")
        seen[code[subject]] = n + row
    return seen

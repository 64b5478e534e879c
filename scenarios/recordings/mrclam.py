"""UTIAS MRCLAM: real robots with cameras, commanded velocities as odometry, and motion capture as the truth.

Any of the nine data sets can be read; each is one trial. Gross outliers are kept: gating them is the estimator's task.

Source: K. Leung, Y. Halpern, T. Barfoot, H. Liu, "The UTIAS multi-robot cooperative localization and mapping dataset",
IJRR 30(8), 2011.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Belief, Mask, Senses, World
from cooploc.estimators.models import Sighting, Unicycle, wrap_heading
from cooploc.scenarios.recordings.mrclam_files import DataSet, read_data_set, unknown_barcodes
from cooploc.scenarios.recordings.resampling import interpolate, mean_held
from cooploc.scenarios.recordings.text_tables import Table
from cooploc.scenarios.stream import Air, Stream, Truth
from cooploc.scenarios.worlds.radio import Positive

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
        """What the team knows: landmarks, and assumed models of motion and camera.

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
        """What was sensed, and notes of what was dropped."""
        commands = [mean_held(table.values[:, 0] - t0, table.values[:, 1:], edges) for table in files.odometry]
        odometry = np.stack(commands, 1)[None]
        cells, notes = self._cells(files, t0, len(edges) - 1)
        t, T, n, _ = odometry.shape
        # A robot that does not use landmarks gets nan, not width 0: an estimator that runs on one variant runs on all.
        users = np.arange(n) < {"all": n, "one": 1, "none": 0}[self.sees]
        landmark = np.where(users[:, None, None], cells[None, :, :, n:], np.nan)
        dt, anchors = np.full((t, T, n), self.tick), np.empty((t, T, n, 0))
        notes |= {
            "clock_set_back": files.steps_back,
            "odometry_missing": np.isnan(odometry[0]).any(-1).sum(0).tolist(),
        }
        return Senses(odometry, dt, anchors, landmark, cells[None, :, :, :n], {}), notes

    def _cells(self, files: DataSet, t0: float, ticks: int) -> tuple[Array, dict[str, Any]]:
        """Range and bearing (T, n, n + l, 2), each at the tick nearest to its stamp, and what was dropped."""
        n, columns = len(files.readings), len(files.readings) + len(files.landmarks)
        table = np.concatenate([t.values for t in files.readings])
        robot = np.repeat(np.arange(n), [len(t.values) for t in files.readings])
        column = np.array([files.columns.get(int(code), -1) for code in table[:, 1]])
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

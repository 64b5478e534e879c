"""UTIAS MRCLAM: real robots with cameras, commanded velocities as odometry, and motion capture as the truth.

Any of the nine data sets can be read; each is one trial. The scenario `mrclam` states its models; as recordings of a
team, `log`, they are fitted. Gross outliers are kept: gating them is the estimator's task. A measurement carries a
barcode, which `Barcodes.dat` maps to a subject: a robot (1 to n) or a landmark.

Source: K. Leung, Y. Halpern, T. Barfoot, H. Liu, "The UTIAS multi-robot cooperative localization and mapping
dataset", IJRR 30(8), 2011.
"""

import re
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Belief, Mask, World
from cooploc.estimators.models import Sighting, Unicycle
from cooploc.scenarios.recordings import team_log
from cooploc.scenarios.recordings.sampling import Gaps, Grid, sample_log
from cooploc.scenarios.recordings.schema import TeamDescription
from cooploc.scenarios.recordings.team_log import Measured, Places, Series, TeamLog, arena_around, shift_stamps
from cooploc.scenarios.recordings.text_files import TextTable, read_table, whole_numbers
from cooploc.scenarios.stream import Stream, Truth
from cooploc.scenarios.worlds.radio import Positive

BARCODES = "Barcodes.dat"
NAME = re.compile(r"Barcodes\.dat|Robot[1-9]\d*_(Groundtruth|Odometry|Measurement)\.dat")  # of its files
FILES = {  # of each robot, and their columns
    "Groundtruth": ("time [s]", "x [m]", "y [m]", "heading [rad]"),
    "Odometry": ("time [s]", "v [m/s]", "omega [rad/s]"),
    "Measurement": ("time [s]", "barcode", "range [m]", "bearing [rad]"),
}


def find_runs(data: Path, description: TeamDescription | None) -> dict[str, Path]:
    """Return the data sets in a directory: itself, or each directory in it."""
    if not data.is_dir():
        raise BadInput(f"{data}: there is no such directory; name the one that holds {BARCODES}")
    if (data / BARCODES).exists():
        return {data.resolve().name: data}
    found = {path.name: path for path in sorted(data.iterdir()) if (path / BARCODES).exists()}
    if not found:
        raise BadInput(f"{data}: neither it nor a directory in it holds {BARCODES} of a data set of MRCLAM: add it")
    return found


def read_run(place: Path, name: str, description: TeamDescription | None) -> TeamLog:
    """Read one data set: robots "1", "2" ..., landmarks by their numbers."""
    found = [re.fullmatch(r"Robot([1-9]\d*)_[A-Z]\w+\.dat", path.name) for path in place.iterdir()]
    numbers = sorted({int(match[1]) for match in found if match}) or [1]
    surveyed = read_table(
        place / "Landmark_Groundtruth.dat", ("subject", "x [m]", "y [m]", "x sd [m]", "y sd [m]"), True
    )
    named = _names_of_barcodes(read_table(place / BARCODES, ("subject", "barcode"), True), surveyed, numbers)
    landmarks, warnings = tuple(str(int(k)) for k in surveyed.values[:, 0]), list[str]()
    tables, lost = dict[str, list[TextTable]](), list[str]()
    for robot in team_log.chosen_robots([*map(str, numbers)], description, place):
        try:
            tables[robot] = [read_table(place / f"Robot{robot}_{kind}.dat", of) for kind, of in FILES.items()]
            warnings += [note for table in tables[robot] for note in table.notes]
        except BadInput as e:
            lost.append(f"{e}; robot {robot} was left out")
    if not tables:
        raise BadInput(lost[0].rpartition("; ")[0])
    robots = tuple(tables)

    def series(table: TextTable, last: bool = False) -> Series:
        ordered, notes = team_log.order_series(table.values[:, 0], table.values[:, 1:], str(table.path), last)
        warnings.extend(notes)
        return ordered

    truth = tuple(series(table) for table, _, _ in tables.values())
    odometry = tuple(series(table, last=True) for _, table, _ in tables.values())
    measured = []
    for robot, (_, _, table) in tables.items():
        other = [named.get(code, f"barcode {code}") for code in whole_numbers(table, 1, "barcode")]
        measured.append(Measured(table.values[:, 0], [robot] * len(other), other, table.values[:, 2:], str(table.path)))
    readings, notes = team_log.split_channels("sighting", measured, robots, landmarks)
    places, none = Places(landmarks, surveyed.values[:, 1:3]), Places((), np.empty((0, 2)))
    return TeamLog(name, robots, "velocity", odometry, truth, readings, places, none, (*lost, *warnings, *notes))


def _names_of_barcodes(barcodes: TextTable, surveyed: TextTable, robots: Sequence[int]) -> dict[int, str]:
    """Return the name of the robot or landmark that carries each barcode."""
    landmarks = whole_numbers(surveyed, 0, "subject", unique=True)
    subjects, codes = (whole_numbers(barcodes, k, name, unique=True) for k, name in enumerate(("subject", "barcode")))
    barcode, named = dict(zip(subjects, codes, strict=True)), [*robots, *landmarks]
    if taken := [k for k in landmarks if k <= robots[-1]]:
        raise BadInput(
            f"{surveyed.path}: landmark {taken[0]} has a robot's number; number landmarks above {robots[-1]}"
        )
    if lost := [k for k in named if k not in barcode]:
        raise BadInput(f"{barcodes.path}: subject {lost[0]} has no barcode; add its line")
    return {barcode[k]: str(k) for k in named}


# ---- The scenario `mrclam`


class Mrclam(BaseModel):
    """Parameters of the scenario. All lengths in m, times in s, angles in rad."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    data: Path  # the directory of one data set, or one with it
    sees: Literal["all", "one", "none"] = "all"  # who uses landmarks: all robots, only robot 1, none
    tick: Annotated[float, Field(ge=0.01, le=10)] = 0.1
    start: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0  # [s] after every robot has truth and odometry
    duration: Positive | None = None  # [s] at most
    sigma_v: Positive = 0.04  # [m/s]
    sigma_omega: Positive = 0.15  # [rad/s]
    sigma_range: Positive = 0.15
    sigma_bearing: Positive = 0.02
    prior_position: Positive = 0.01  # sd per axis; the prior's mean is the true start
    prior_heading: Positive = 0.01  # sd
    max_gap: Positive = 0.5  # [s] the truth is not interpolated across longer gaps

    @cached_property
    def log(self) -> TeamLog:
        """The data set."""
        (name, place), *others = find_runs(self.data, None).items()
        if others:
            raise BadInput(f"{self.data} holds several data sets: name one, such as {place}")
        return read_run(place, name, None)

    def world(self) -> World:
        """Return what the team knows: landmarks, and assumed models of motion and camera."""
        camera, landmarks = Sighting(self.sigma_range, self.sigma_bearing), self.log.landmarks.positions
        return World(
            robots=len(self.log.robots),
            tick=self.tick,
            arena=arena_around(landmarks),
            motion=Unicycle(self.sigma_v, self.sigma_omega, self.tick),
            sensors={"landmark": camera, "sighting": camera},
            landmarks=landmarks,
            t0=self._span[0],
        )

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Truth and stream of the one trial, with `world` as what the team knows; the seed changes nothing."""
        if list(trials) != [0]:
            raise BadInput(
                f"scenario {label!r} is a recording and has one trial, 0, not {list(trials)}; ask for trials=1"
            )
        log, (t0, ticks), n, i = self.log, self._span, len(self.log.robots), np.empty(0, np.int64)
        none, grid = team_log.ReadingSeries(np.empty(0), i, i, np.empty((0, 2)), ""), Grid(0.0, self.tick, ticks)
        since_t0 = shift_stamps(log._replace(readings={"sighting": none, "landmark": none, **log.readings}), -t0)
        sampled = sample_log(since_t0, grid, Gaps(self.max_gap, np.inf))
        path = sampled.poses[None, 1:]
        valid: Mask = np.asarray(np.isfinite(path).all(-1))
        start = sampled.poses[:1]
        if (lost := np.isnan(start).any((0, 2))).any():
            raise BadInput(
                f"{self.data}: robot {np.argmax(lost) + 1} has no truth at start={self.start:g} s, where the prior is "
                "taken: choose another start or a larger max_gap"
            )
        P = np.diag([self.prior_position**2, self.prior_position**2, self.prior_heading**2])
        # A robot that does not use landmarks gets nan, not width 0: an estimator that runs on one variant runs on all.
        users = np.arange(n) < {"all": n, "one": 1, "none": 0}[self.sees]
        landmark = np.where(users[:, None, None], sampled.senses.landmark, np.nan)
        prior = f"true pose at t0, interpolated; assumed sd {self.prior_position:g} m, {self.prior_heading:g} rad"
        stream = Stream(
            scenario=label,
            seed=seed,
            trial=np.zeros(1, np.int64),
            time=t0 + grid.edges[1:],
            world=world,
            prior=Belief(start, np.broadcast_to(P, (1, n, 3, 3)).copy()),
            senses=sampled.senses._replace(landmark=landmark),
            air=sampled.air,
            notes={
                "world": type(self).__name__,
                "parameters": self.model_dump(mode="json", exclude={"data"}),
                "recording": self.log.name,
                "source": "UTIAS MRCLAM; Leung, Halpern, Barfoot, Liu, IJRR 30(8), 2011",
                "prior": prior,
                **sampled.counts,
                "odometry_missing": np.isnan(sampled.senses.odometry[0]).any(-1).sum(0).tolist(),
                "warnings": [line.replace(f"{self.data}/", "") for line in log.warnings],
                "truth_masked": (~valid[0]).sum(0).tolist(),
            },
        )
        return Truth(label, stream.trial, path, valid, arena_around(log.landmarks.positions), stream.hashes), stream

    def faults(self) -> list[str]:
        """Return sentences on what was left out, sorted or repaired while reading."""
        return list(self.log.warnings)

    explanations = faults

    @cached_property
    def _span(self) -> tuple[float, int]:
        """The prior's time [s], and the number of ticks after it."""
        times = [series.time for series in (*self.log.truth, *self.log.odometry) if series]
        begin, end = max(time[0] for time in times), min(time[-1] for time in times)
        length = min(end - begin - self.start, self.duration or np.inf)
        if length < self.tick:
            raise BadInput(
                f"{self.data}: truth and odometry of all robots begin at {begin:.3f} s and end at {end:.3f} s; "
                f"start={self.start:g} leaves no tick of {self.tick:g} s: choose another start, duration or tick"
            )
        return float(begin) + self.start, int(length / self.tick + 1e-6)

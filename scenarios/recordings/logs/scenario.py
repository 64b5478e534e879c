"""A user's own log as a scenario: real runs of one robot.

A directory holds one CSV file per run, and `log.toml`, which states what the columns mean. `log/RUN` is one run;
`log/all` has a trial for each run, so intervals are over runs. The models of a run are fitted on the *other* runs: each
run has a world of its own, so a stream holds one run. The WiFi recordings of Latif & Parasuraman, `wifi/RUN` and
`wifi/all`, are such a directory with a shipped description.
"""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Mask, Senses, World
from cooploc.scenarios.recordings import one_run
from cooploc.scenarios.recordings.logs import models
from cooploc.scenarios.recordings.logs.folder import ALL, LogFolder, read_folder
from cooploc.scenarios.recordings.logs.models import AssumedModels
from cooploc.scenarios.recordings.logs.run import LogRun
from cooploc.scenarios.recordings.logs.schema import Model, Prior
from cooploc.scenarios.stream import Air, Stream, Truth
from cooploc.scenarios.worlds.radio import Positive


class Log(BaseModel):
    """Parameters of the scenario, in SI units; None: as the description states, or fitted on the other runs."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    data: Path  # the directory of the runs
    described: str = ""  # the name of a shipped description; where empty, log.toml beside the runs
    run: str = ALL
    fitted_on: Literal["same set-up", "all others"] = "same set-up"  # which of the other runs
    correlation: Literal["inflate", "ignore"] = "inflate"  # of RSSI in time: a larger assumed sigma, or none
    robust: bool = False  # whether the models are fitted with Huber's loss, so that one bad run counts little
    A: float | None = None  # [dBm] at 1 m
    eta: Positive | None = None  # path-loss exponent
    sigma: Positive | None = None  # [dB]
    length_scale: Positive | None = None  # true length by odometry's
    turn_scale: Positive | None = None  # true turn by odometry's
    sigma_v: Positive | None = None  # [m/s] at the median interval
    sigma_omega: Positive | None = None  # [rad/s] at the median interval
    sigma_move: Positive | None = None  # [m] per axis in the median interval
    position: Literal["first truth", "arena"] | None = None  # source of the prior's position
    position_sd: Positive | None = None
    heading: Literal["first motion", "first truth", "unknown"] | None = None
    heading_sd: Positive | None = None

    @cached_property
    def folder(self) -> LogFolder:
        """The runs in the directory."""
        return read_folder(self.data, self.described)

    def count(self) -> int:
        """How many trials there are: one, or one for each different run of `all`."""
        return len(self._names())

    def at(self, trials: Sequence[int]) -> "Log":
        """The scenario of one run, from the list with its one trial.

        Raises:
            BadInput: there are several trials, or there is no such trial or run.

        """
        name = one_run.asked(self.data, self.run, self._names(), trials)
        return self.model_copy(update={"run": name})

    def world(self) -> World:
        """What the robot knows of this run: anchors, arena, and assumed models."""
        folder, assumed = self.folder, self._assumed()
        return World(
            robots=1,
            tick=self._run().tick,
            arena=folder.arena,
            motion=assumed.motion,
            sensors=assumed.sensors,
            anchors=folder.anchors,
            t0=self._run().t0,
        )

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Truth and stream of one run, with `world` as what the robot knows; the seed changes nothing."""
        run, assumed = self._run(), self._assumed()
        prior, source = models.prior(run, self._declared(), self.folder.arena, assumed)
        T = len(run.dt)
        senses = _senses(run, assumed.scales)
        radio = np.empty((1, T, 1, 0))
        stream = Stream(
            scenario=label,
            seed=seed,
            trial=np.array(trials, np.int64),
            time=run.t0 + run.time[1:],
            world=world,
            prior=prior,
            senses=senses,
            air=Air(np.zeros((1, T, 1, 1), bool), radio, radio),
            notes=self._notes(run) | {"prior": source, "models": assumed.notes},
        )
        known = 3 if np.isfinite(run.truth[:, 2]).any() else 2
        path = run.truth[None, 1:, None, :known].copy()
        valid: Mask = np.asarray(np.isfinite(path).all(-1))
        return Truth(label, stream.trial, path, valid, self.folder.arena, stream.hashes), stream

    def _names(self) -> list[str]:
        return self.folder.different if self.run == ALL else [self._run().name]

    def _run(self) -> LogRun:
        runs = self.folder.runs
        if self.run == ALL:
            raise BadInput(f"{self.data}: {ALL!r} is {self.count()} runs; choose one with at([0])")
        if self.run not in runs:
            raise BadInput(f"{self.data}: there is no run {self.run!r}; {nearest(self.run, [ALL, *runs])}")
        return runs[self.run]

    def _assumed(self) -> AssumedModels:
        stated = self.folder.description.model.model_dump()
        stated |= self._overrides(Model)
        run = self._run()
        others = self.folder.others(run.name, same_set_up=self.fitted_on == "same set-up")
        return models.assumed_models(self.folder, run, others, stated, self.correlation == "inflate", self.robust)

    def _declared(self) -> Prior:
        """The description's prior with this scenario's overrides."""
        return self.folder.description.prior.model_copy(update=self._overrides(Prior))

    def _overrides(self, table: type[BaseModel]) -> dict[str, Any]:
        """The parameters that replace values of a table of the description."""
        return {name: value for name in table.model_fields if (value := getattr(self, name)) is not None}

    def _notes(self, run: LogRun) -> dict[str, Any]:
        return {
            "world": type(self).__name__,
            "parameters": self.model_dump(mode="json", exclude={"data"}),
            "recording": f"{self.data.resolve().name}/{run.path.name}",
            "source": self.folder.description.about,
            "truth_masked": [int(np.isnan(run.truth[1:, 0]).sum())],
            **run.counts,
        }


def _senses(run: LogRun, scales: Array) -> Senses:
    """Odometry and readings (1, T, 1, ...). The readings of row 0, the time of the prior, are not used."""
    odometry = (run.odometry * scales)[None, :, None]
    nothing = np.empty((1, len(run.dt), 1, 0, 2))
    return Senses(odometry, run.dt[None, :, None], run.rssi[None, 1:, None].copy(), nothing, nothing, {})

"""Any log of a user's own as a scenario: real runs of one robot.

A directory holds one CSV file per run, and `log.toml`, which says what the columns mean. `log/RUN` is one run;
`log/all` has a trial for each, so the run is the unit of every interval. Models of a run are fitted on the *other*
runs, and the source of its prior is declared: so each run has a world of its own, and a stream holds one run. The WiFi
recordings of Latif & Parasuraman, `wifi/RUN` and `wifi/all`, are such a directory with a shipped description.
"""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from cooploc.estimators import nearest
from cooploc.estimators.interface import Array, Mask, Senses, World
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.recordings.logs import models
from cooploc.scenarios.recordings.logs.folder import ALL, Logs, read_logs
from cooploc.scenarios.recordings.logs.models import Told
from cooploc.scenarios.recordings.logs.run import Run
from cooploc.scenarios.recordings.logs.schema import Model, Prior
from cooploc.scenarios.stream import Air, Stream, Truth
from cooploc.scenarios.worlds.radio_arena import Positive


class Log(BaseModel):
    """Parameters of the log. Lengths in m, times in s, angles in rad; None: what the description says, or is fitted."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    data: Path  # the directory of the runs
    described: str = ""  # the name of a shipped description; where empty, log.toml beside the runs
    run: str = ALL
    fitted_on: Literal["same set-up", "all others"] = "same set-up"  # which of the other runs
    correlation: Literal["inflate", "ignore"] = "inflate"  # of RSSI in time: told as a larger sigma, or not at all
    A: float | None = None  # [dBm] at 1 m
    eta: Positive | None = None  # path-loss exponent
    sigma: Positive | None = None  # [dB]
    length_scale: Positive | None = None  # true length by odometry's
    turn_scale: Positive | None = None  # true turn by odometry's
    sigma_v: Positive | None = None  # [m/s] at the median interval
    sigma_omega: Positive | None = None  # [rad/s] at the median interval
    sigma_move: Positive | None = None  # [m] per axis in the median interval
    position: Literal["first truth", "arena"] | None = None  # where the prior's comes from
    position_sd: Positive | None = None
    heading: Literal["first motion", "first truth", "unknown"] | None = None
    heading_sd: Positive | None = None

    @cached_property
    def logs(self) -> Logs:
        """What lies in the directory."""
        return read_logs(self.data, self.described)

    def count(self) -> int:
        """How many trials there are: one, or the different runs of `all`."""
        return len(self._names())

    def at(self, trials: Sequence[int]) -> "Log":
        """The one run that these trials are.

        Raises:
            BadInput: they are several, there is no such trial, or no such run.

        """
        names = self._names()
        if len(trials) != 1 or trials[0] >= len(names):
            there = f"{len(names)} trial{'s' * (len(names) > 1)}"
            raise BadInput(
                f"{self.data}: {self.run!r} has {there}, each a recording with models of its own, so a stream holds "
                f"one, not {list(trials)}; ask for trials=[0]"
            )
        return self.model_copy(update={"run": names[trials[0]]})

    def world(self) -> World:
        """What the robot is told of this run."""
        logs, told = self.logs, self._told()
        return World(
            robots=1,
            tick=self._run().tick,
            arena=logs.arena,
            motion=told.motion,
            sensors=told.sensors,
            anchors=logs.anchors,
            t0=self._run().t0,
        )

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Truth and stream of one run. `world` is what the robot is told; the seed changes nothing."""
        run, told = self._run(), self._told()
        prior, source = models.prior(run, self._declared(), self.logs.arena, told)
        T = len(run.dt)
        senses = _senses(run, told.scales)
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
            notes=self._notes(run) | {"prior": source, "models": told.notes},
        )
        known = 3 if np.isfinite(run.truth[:, 2]).any() else 2
        path = run.truth[None, 1:, None, :known].copy()
        valid: Mask = np.asarray(np.isfinite(path).all(-1))
        return Truth(label, stream.trial, path, valid, self.logs.arena, stream.hashes), stream

    def _names(self) -> list[str]:
        return self.logs.different if self.run == ALL else [self._run().name]

    def _run(self) -> Run:
        runs = self.logs.runs
        if self.run == ALL:
            raise BadInput(f"{self.data}: {ALL!r} is {self.count()} runs; take one of them with at([0])")
        if self.run not in runs:
            raise BadInput(f"{self.data}: there is no run {self.run!r}; {nearest(self.run, [ALL, *runs])}")
        return runs[self.run]

    def _told(self) -> Told:
        stated = self.logs.about.model.model_dump()
        over = {name: getattr(self, name) for name in Model.model_fields}
        stated |= {name: value for name, value in over.items() if value is not None}
        run = self._run()
        others = self.logs.others(run.name, same_set_up=self.fitted_on == "same set-up")
        return models.told(self.logs, run, others, stated, inflate=self.correlation == "inflate")

    def _declared(self) -> Prior:
        """The description's prior with this scenario's overrides."""
        names = ("position", "position_sd", "heading", "heading_sd")
        over = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        return self.logs.about.prior.model_copy(update=over)

    def _notes(self, run: Run) -> dict[str, Any]:
        return {
            "world": type(self).__name__,
            "parameters": self.model_dump(mode="json", exclude={"data"}),
            "recording": f"{self.data.resolve().name}/{run.path.name}",
            "source": self.logs.about.about,
            "truth_masked": [int(np.isnan(run.truth[1:, 0]).sum())],
            **run.counts,
        }


def _senses(run: Run, scales: Array) -> Senses:
    """Odometry and readings (1, T, 1, ...). The readings of row 0, where the prior stands, are not used."""
    odometry = (run.odometry * scales)[None, :, None]
    nothing = np.empty((1, len(run.dt), 1, 0, 2))
    return Senses(odometry, run.dt[None, :, None], run.rssi[None, 1:, None].copy(), nothing, nothing, {})

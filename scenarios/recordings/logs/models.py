"""What a robot knows of a run: models that are stated, or fitted on the other runs, and a prior of stated source."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Belief, Motion, Sensor
from cooploc.estimators.models import Displacement, LogDistance, Unicycle, wrap
from cooploc.scenarios.recordings.logs import fit
from cooploc.scenarios.recordings.logs.folder import LogFolder
from cooploc.scenarios.recordings.logs.run import LogRun
from cooploc.scenarios.recordings.logs.schema import Prior

UNKNOWN = np.pi / np.sqrt(3)  # [rad] standard deviation of a uniform heading
REST, REACH = 0.02, 0.1  # [m] the first motion: from the last position within REST of the start to the first past REACH

Stated = Mapping[str, float | None]


class AssumedModels(NamedTuple):
    """Models of one run, and where they come from."""

    motion: Motion
    sensors: dict[str, Sensor]
    scales: Array  # (2,)  factors of the odometry
    notes: dict[str, Any]


def assumed_models(
    folder: LogFolder, run: LogRun, others: Sequence[LogRun], stated: Stated, inflate: bool, robust: bool = False
) -> AssumedModels:
    """The models of a run.

    Args:
        folder: the directory of runs.
        run: the run that is simulated.
        others: the runs to fit on.
        stated: values by name that are not fitted; None: fitted.
        inflate: whether sigma of RSSI accounts for its correlation in time.
        robust: whether Huber's loss is minimised, so that one bad run counts little.

    Raises:
        BadInput: a value is not stated, and the other runs do not suffice to fit it.

    """
    motion = _displacements if folder.description.odometry.kind == "displacement" else _wheels
    values = motion(run, others, stated, robust)
    if len(folder.anchors):
        values |= _radio(folder, run, others, stated, inflate, robust)
    lacking = [name for name, value in values.items() if not np.isfinite(value)]
    if lacking:
        raise BadInput(
            f"{folder.data}: run {run.name!r} has {len(others)} other runs of its set-up, too few to fit "
            f"{', '.join(lacking)}: give them as parameters, or in [model] of {folder.source}"
        )
    sensors: dict[str, Sensor] = {}
    if len(folder.anchors):
        sensors["anchor_rssi"] = LogDistance(values["A"], values["eta"], values["sigma"])
    scales = np.array([values["length_scale"], values.get("turn_scale", values["length_scale"])])
    moves = (
        Displacement(values["sigma_move"], run.tick)
        if "sigma_move" in values
        else Unicycle(values["sigma_v"], values["sigma_omega"], run.tick)
    )
    return AssumedModels(moves, sensors, scales, {"fitted_on": [other.name for other in others], **values})


def prior(run: LogRun, declared: Prior, arena: Array, assumed: AssumedModels) -> tuple[Belief, str]:
    """The belief before the first tick, x (1, 1, d) and P (1, 1, d, d), and where it comes from.

    Raises:
        BadInput: the source that is declared does not give a position or a heading.

    """
    if declared.position == "arena":
        x, sd, source = arena.mean(0), (arena[1] - arena[0]) / np.sqrt(12), "anywhere in the arena"
    else:
        first = declared.position == "first truth"
        if declared.position_sd is None:
            raise BadInput("the prior's position_sd [m] is not stated; give it with position='first truth'")
        x, sd = run.truth[0, :2] if first else np.array(declared.position), np.full(2, declared.position_sd)
        source = f"{declared.position if first else 'stated position'}, assumed sd {sd[0]:g} m"
    if isinstance(assumed.motion, Unicycle):
        heading, spread = _heading(run, declared, assumed)
        x, sd = np.append(x, heading), np.append(sd, spread)
        source += f"; heading: {declared.heading}, assumed sd {spread:g} rad"
    return Belief(x[None, None].copy(), np.diag(sd**2)[None, None].copy()), source


def _wheels(run: LogRun, others: Sequence[LogRun], stated: Stated, robust: bool) -> dict[str, float]:
    scales = stated["length_scale"], stated["turn_scale"]
    fitted = fit.fit_wheel_odometry(others, run.tick, *scales, robust)._asdict()
    return fitted | {name: value for name in fitted if (value := stated[name]) is not None}


def _displacements(run: LogRun, others: Sequence[LogRun], stated: Stated, robust: bool) -> dict[str, float]:
    scale, sigma = stated["length_scale"] or 1.0, stated["sigma_move"]
    return {"length_scale": scale, "sigma_move": sigma or fit.fit_displacement(others, run.tick, scale, robust)}


def _radio(
    folder: LogFolder, run: LogRun, others: Sequence[LogRun], stated: Stated, inflate: bool, robust: bool
) -> dict[str, float]:
    """Path loss. As filters assume independent readings, sigma is inflated by sqrt((1 + r) / (1 - r)).

    r is the lag-1 correlation of the residuals: the mean of many readings then has the spread that a filter computes.
    """
    fitted = fit.fit_path_loss(others, folder.anchors, stated["A"], stated["eta"], robust)
    if fitted.eta <= 0:
        raise BadInput(
            f"{folder.data}: RSSI does not fall with distance in the runs on which {run.name!r} is fitted "
            f"(eta = {fitted.eta:.3g}); check that [anchors] positions and rssi are in the same order, or state eta"
        )
    r = np.clip(fitted.lag1, 0.0, 0.99) if inflate else 0.0
    sigma = fitted.sigma * np.sqrt((1 + r) / (1 - r)) if stated["sigma"] is None else stated["sigma"]
    known = {"A": fitted.A, "eta": fitted.eta, "sigma": float(sigma)}
    return known | ({"residual_sd": fitted.sigma, "residual_lag1": fitted.lag1} if np.isfinite(fitted.sigma) else {})


def _heading(run: LogRun, declared: Prior, assumed: AssumedModels) -> tuple[float, float]:
    """Mean and standard deviation [rad]."""
    if declared.heading == "unknown":
        return 0.0, UNKNOWN
    if declared.heading == "first motion":
        return _first_motion(run, assumed.scales[1]), declared.heading_sd
    heading = run.truth[0, 2] if declared.heading == "first truth" else declared.heading
    if np.isnan(heading):
        raise BadInput(f"{run.path}: the truth has no heading; choose heading='first motion' or 'unknown'")
    return float(wrap(np.array(heading))), declared.heading_sd


def _first_motion(run: LogRun, turn_scale: float) -> float:
    turns = np.nan_to_num(turn_scale * run.odometry[:, 1]) * run.dt
    return first_course(str(run.path), run.truth[:, :2], turns)


def first_course(where: str, truth: Array, turns: Array) -> float:
    """The true course of the first REACH metres, less the turn until then by odometry [rad].

    Args:
        where: names the recording, for an error.
        truth: (T + 1, 2) [m], nan where unknown but for the first.
        turns: (T,) [rad]

    Raises:
        BadInput: the robot does not get that far.

    """
    away = np.hypot(*(truth - truth[0]).T)
    if not (away > REACH).any():
        raise BadInput(
            f"{where}: the robot never gets {REACH:g} m away from its start, so its first motion gives no heading; "
            'state heading in [prior] as a number, or as "unknown"'
        )
    end = int(np.argmax(away > REACH))
    begin = int(np.flatnonzero(away[:end] <= REST)[-1])
    step = truth[end] - truth[begin]
    turned = np.concatenate([[0.0], np.cumsum(turns)])
    course = np.arctan2(step[1], step[0]) - (turned[begin] + turned[end]) / 2
    return float(wrap(np.array(course)))

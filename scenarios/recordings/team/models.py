"""What a team is told of its sensors: models that are stated, or fitted on what is not judged."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Motion, Sensor
from cooploc.estimators.models import Displacement, LogDistance, Range, Sighting, Unicycle
from cooploc.scenarios.recordings.team import fit
from cooploc.scenarios.recordings.team.residuals import Part, Residuals, residuals
from cooploc.scenarios.recordings.team.sampling import Gaps
from cooploc.scenarios.recordings.team.team_log import Channel, TeamLog

RANGES: tuple[Channel, ...] = ("range", "anchor_range")
SENSED: Mapping[Channel, str] = {"range": "radio_range", "rssi": "radio_rssi"}  # other channels have the same name


class How(NamedTuple):
    """How models are fitted."""

    tick: float  # [s]
    gaps: Gaps
    stated: Mapping[str, float | None]  # by the names of `schema.Model`
    bias: Literal["fitted", "none"]
    robust: bool
    inflate: bool  # sigma of readings, for their correlation in time


class TeamModels(NamedTuple):
    """Models of one run."""

    motion: Motion
    sensors: dict[str, Sensor]
    scales: Array  # (n, 2)  factors of the odometry
    bias: dict[Channel, Array]  # (n, others) of ranges [m], to be subtracted
    notes: dict[str, Any]  # what was fitted, on what


def team_models(log: TeamLog, parts: Sequence[Part], how: How) -> TeamModels:
    """The models of a run, fitted on parts of recordings that are not judged.

    Raises:
        BadInput: a value is not stated, and the parts do not suffice to fit it; or RSSI does not fall with distance.

    """
    motion, scales, notes = _motion(log, parts, how)
    sensors: dict[str, Sensor] = {}
    bias: dict[Channel, Array] = {}
    for channel in log.readings:
        found = residuals(parts, channel, log.robots, how.tick, how.gaps)
        prefix = "anchor_" if channel.startswith("anchor") else ""
        if channel in RANGES:
            fitted = _ranges(channel, found, how, prefix)
            sensors[SENSED.get(channel, channel)] = Range(fitted.sigma)
            bias[channel] = _table(log, channel, fitted)
            notes |= {
                f"{prefix}range_sigma": fitted.sigma,
                f"{prefix}range_bias": _by_name(log, channel, bias[channel]),
            }
            notes |= {f"{prefix}range_lag1": fitted.memory.lag1, f"{prefix}range_fitted_on": len(found.z)}
        elif channel in ("sighting", "landmark"):
            told = _sightings(channel, found, how)
            sensors[channel] = Sighting(told[f"{channel}_sigma_range"], told[f"{channel}_sigma_bearing"])
            notes |= told
        else:
            sensors[SENSED.get(channel, channel)], told = _path_loss(log, found, how, prefix)
            notes |= told
    _demand_all(log, parts, notes)
    return TeamModels(motion, sensors, scales, bias, {"fitted_on": _told(parts, log), **notes})


def _motion(log: TeamLog, parts: Sequence[Part], how: How) -> tuple[Motion, Array, dict[str, Any]]:
    stated = how.stated["length_scale"], how.stated["turn_scale"]
    found = fit.fit_odometry(parts, log.robots, log.odometry_kind, stated, how.tick, how.gaps, how.robust)
    names = ("sigma_move",) if log.odometry_kind == "displacement" else ("sigma_v", "sigma_omega")
    sigmas = [how.stated[name] or sigma for name, sigma in zip(names, found.sigmas, strict=False)]
    moves = log.odometry_kind == "displacement"
    motion = Displacement(sigmas[0], how.tick) if moves else Unicycle(sigmas[0], sigmas[1], how.tick)
    scales = {robot: found.scales[i].tolist() for i, robot in enumerate(log.robots)}
    return motion, found.scales, {"odometry_scales": scales, **dict(zip(names, sigmas, strict=True))}


def _ranges(channel: Channel, found: Residuals, how: How, prefix: str) -> fit.RangeFit:
    """Bias and sigma; of raw ranges sigma is about zero, so that it contains the bias."""
    stated = how.stated[f"{prefix}range_bias"]
    fitted = fit.fit_range(found, 0.0 if how.bias == "none" else stated, how.robust)
    sigma = how.stated[f"{prefix}range_sigma"] or fitted.sigma * (fit.inflation(fitted.memory) if how.inflate else 1.0)
    return fitted._replace(sigma=sigma)


def _table(log: TeamLog, channel: Channel, fitted: fit.RangeFit) -> Array:
    """The bias of each (robot, other) [m]."""
    n = len(log.robots)
    others = n if channel == "range" else len(log.anchors.names)
    size, table = max(n, others), np.full((n, others), fitted.common)
    for link, bias in fitted.bias.items():
        i, j = divmod(link, size)
        table[i, j] = bias
        if channel == "range":
            table[j, i] = bias
    return table


def _by_name(log: TeamLog, channel: Channel, table: Array) -> dict[str, float]:
    """The bias of each pair that has readings [m]."""
    readings, others = log.readings[channel], log.robots if channel == "range" else log.anchors.names
    pairs = sorted({(int(i), int(j)) for i, j in zip(readings.robot, readings.other, strict=True)})
    if channel == "range":
        pairs = sorted({(min(pair), max(pair)) for pair in pairs})
    return {f"{log.robots[i]} - {others[j]}": float(table[i, j]) for i, j in pairs}


def _sightings(channel: Channel, found: Residuals, how: How) -> dict[str, float]:
    told: dict[str, float] = {}
    for what, (sigma, memory) in zip(("range", "bearing"), fit.fit_sighting(found, how.robust), strict=True):
        inflated = sigma * (fit.inflation(memory) if how.inflate else 1.0)
        told |= {f"{channel}_sigma_{what}": how.stated[f"{channel}_sigma_{what}"] or inflated}
        told |= {f"{channel}_{what}_lag1": memory.lag1}
    return told


def _path_loss(log: TeamLog, found: Residuals, how: How, prefix: str) -> tuple[LogDistance, dict[str, float]]:
    A, eta, sigma, memory = fit.fit_path_loss(found, how.stated[f"{prefix}A"], how.stated[f"{prefix}eta"], how.robust)
    if eta <= 0:
        raise BadInput(
            f"run {log.name!r}: {prefix}RSSI does not fall with distance in what it is fitted on (eta = {eta:.3g}); "
            f"check the names and places in log.toml, or state {prefix}eta in [model]"
        )
    sigma = how.stated[f"{prefix}rssi_sigma"] or sigma * (fit.inflation(memory) if how.inflate else 1.0)
    notes = {f"{prefix}A": A, f"{prefix}eta": eta, f"{prefix}rssi_sigma": sigma, f"{prefix}rssi_lag1": memory.lag1}
    return LogDistance(A, eta, sigma), notes


def _demand_all(log: TeamLog, parts: Sequence[Part], notes: Mapping[str, Any]) -> None:
    lacking = [name for name, value in notes.items() if isinstance(value, float) and not np.isfinite(value)]
    lacking += [n for n, v in notes.items() if n.endswith("_bias") and not np.isfinite(list(v.values())).all()]
    if lacking:
        raise BadInput(
            f"run {log.name!r} is fitted on {_told(parts, log)}, too little for {', '.join(lacking)}: state them in "
            '[model] of log.toml, or [fit] on = "first part" with seconds = ...'
        )


def _told(parts: Sequence[Part], log: TeamLog) -> str:
    names = [part.log.name for part in parts]
    if names == [log.name]:
        return f"its first {parts[0].end - parts[0].begin:g} s, which are not judged"
    return f"the other runs {', '.join(names)}" if names else "no other run"

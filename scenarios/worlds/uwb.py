"""The radio arena with ranges as real ultra-wide-band radios give them: biased, with a memory, and with outliers.

A range is d + b + e + o. b, the bias of a pair of radios, is drawn once a trial; e is drawn from the recorded residuals
of one pair, through their quantiles, and keeps its value for about two seconds as theirs do; o, an outlier such as a
signal around a corner gives, is positive and exponential. Both robots of a pair have the same reading (two-way time of
flight). The recordings had no drop-outs; `lost` adds them.

Source: residuals against motion capture in a bag of TIERS/uwb-cooperative-mrs-localization (MIT licence; two robots,
45 s, 76 Hz), in `uwb_residuals.toml`; the biases are those of seven pairs in three of its bags, 0.21 to 0.44 m.
"""

import tomllib
from dataclasses import replace
from functools import cache
from importlib.resources import files
from typing import Literal

import numpy as np
from scipy.special import ndtr

from cooploc.estimators.interface import Array, World
from cooploc.estimators.models import Range
from cooploc.scenarios.seeds import Purpose, generator
from cooploc.scenarios.worlds.radio import Paper, Positive, Robots, Scene, Share, Sigma, Signed, add_memory

REMEMBERED = 0.68  # share of the residual's variance that has a memory; the rest is white
LASTS = 1.5  # [s] the time constant of that memory


class UwbArena(Paper):
    """Parameters of the world, in SI units. What is not named here is as in the radio arena."""

    robots: Robots = 3
    range_bias: Signed = 0.32  # mean over pairs
    range_bias_sd: Sigma = 0.08  # from pair to pair
    bias: Literal["raw", "removed"] = "raw"  # removed: the mean over pairs, as measured with other radios, is taken off
    outliers: Share = 0.0  # share of readings with a late signal
    outlier_mean: Positive = 0.5  # [m] of their excess
    lost: Share = 0.0  # share of readings that are absent

    def world(self) -> World:
        """Return the team's world; where the mean bias is removed, the sigma of ranges is that of the rest."""
        world = super().world()
        left = np.hypot(self.range_bias_sd, residual_sd()) if self.bias == "removed" else self.range_sigma
        return replace(world, sensors={**world.sensors, "radio_range": Range(float(left))})

    def _ranges(self, rng: np.random.Generator, d: Array, scene: Scene, seed: int, trial: int) -> Array:
        rng = generator(seed, trial, Purpose.UWB)
        bias = rng.normal(self.range_bias, self.range_bias_sd, d.shape[1:])
        memory = add_memory(rng.normal(size=d.shape), float(np.exp(-self.tick / LASTS)))
        standard = REMEMBERED**0.5 * memory + (1 - REMEMBERED) ** 0.5 * rng.normal(size=d.shape)
        late = np.where(rng.uniform(size=d.shape) < self.outliers, rng.exponential(self.outlier_mean, d.shape), 0.0)
        absent = rng.uniform(size=d.shape) < self.lost
        known = self.range_bias if self.bias == "removed" else 0.0
        error = np.triu(np.where(absent, np.nan, bias - known + residual(standard) + late), 1)
        return d + error + error.transpose(0, 2, 1) + self.nlos_range_bias * (scene.robot_blockers > 0)


def residual(standard: Array) -> Array:
    """Return residuals [m] with the recorded distribution, from standard normal numbers of any shape."""
    levels, quantiles = residual_quantiles()
    return np.interp(ndtr(standard), levels, quantiles)


def residual_sd() -> float:
    """Return the standard deviation of the recorded residuals [m]."""
    levels, quantiles = residual_quantiles()
    share = np.linspace(0.0005, 0.9995, 1000)
    return float(np.std(np.interp(share, levels, quantiles)))


@cache
def residual_quantiles() -> tuple[Array, Array]:
    """Return levels in [0, 1] and quantiles [m] of the recorded residuals, whose mean is zero."""
    table = tomllib.loads((files(__package__) / "uwb_residuals.toml").read_text(encoding="utf-8"))
    return np.array(table["levels"]), np.array(table["quantiles"])

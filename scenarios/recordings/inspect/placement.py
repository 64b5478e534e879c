"""The shift of one robot's frame that its ranges ask for: least squares with a loss that spares outliers."""

import numpy as np
from scipy.optimize import least_squares

from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.inspect.distances import ranged
from cooploc.scenarios.recordings.inspect.geometry import others, poses
from cooploc.scenarios.recordings.team_log import TeamLog

FEWEST, MOST = 20, 400
NOISE = 0.3  # [m] residuals beyond it count linearly


def shift_that_fits(log: TeamLog, i: int) -> Array | None:
    """The shift (2,) [m] of robot i's true positions that its own ranges fit best; None where it has too few."""
    here, there, measured = (np.concatenate(part) for part in zip(*_ends(log, i), strict=True))
    known = np.isfinite(here).all(axis=1) & np.isfinite(there).all(axis=1) & np.isfinite(measured)
    if known.sum() < FEWEST:
        return None
    every = max(1, int(known.sum()) // MOST)
    here, there, measured = here[known][::every], there[known][::every], measured[known][::every]

    def residuals(guess: Array) -> Array:  # shift and bias, as a bias must not look like a shift
        return np.asarray(np.hypot(*(there - here - guess[:2]).T) + guess[2] - measured)

    middle = (there - here).mean(axis=0)
    reach = float(np.median(measured))
    starts = [middle + reach * np.array([np.cos(a), np.sin(a)]) for a in np.arange(4) * np.pi / 2]
    every_start = [np.append(start, 0.0) for start in [np.zeros(2), middle, *starts]]
    fits = [least_squares(residuals, start, loss="soft_l1", f_scale=NOISE) for start in every_start]
    shift: Array = min(fits, key=lambda fit: float(fit.cost)).x[:2]
    return shift


def _ends(log: TeamLog, i: int) -> list[tuple[Array, Array, Array]]:
    """Where robot i was, where what it measured was, and the range; of every channel with ranges."""
    found = [(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))]
    for channel, readings in ranged(log):
        rows = np.flatnonzero(readings.robot == i)
        if len(rows):
            time = readings.time[rows]
            here = poses(log, readings.robot[rows], time)[:, :2]
            found.append((here, others(log, channel, readings.other[rows], time), readings.values[rows, 0]))
    return found

"""Which exact fusions are solved again by cvxpy, and how far the two weights differ.

A random share of the fusions is recorded as they happen; a fusion is drawn by its row's key, the tick and the sender.
"""

import numpy as np

from cooploc.estimators.compiled import random_numbers
from cooploc.estimators.compiled.jit import kernel, readable
from cooploc.estimators.covariance_intersection.weights import solve_relative
from cooploc.estimators.ctrn.state import Settings, State
from cooploc.estimators.interface import Array, Mask


def drawn(p: Settings, s: State, readings: Array) -> Mask:
    """Which fusions (r, n) of this tick are recorded, among the readings (r, n) that are not nan."""
    chosen, counter = np.zeros(readings.shape, bool), s.own.tick * random_numbers.PURPOSES + random_numbers.AUDIT
    _draw(readable(s.own.key), counter, p.audit, readable(readings), chosen)
    return chosen


@kernel
def _draw(key, counter, share, readings, chosen):
    for r in range(chosen.shape[0]):
        for j in range(chosen.shape[1]):
            if not np.isnan(readings[r, j]):
                u, _ = random_numbers.uniform_pair(np.int64(key[r, 0]), np.int64(key[r, 1]), counter, j)
                chosen[r, j] = u < share


def notes(p: Settings, s: State) -> dict[str, Array]:
    """How many fusions of each row cvxpy solved again, those of a trial together, and the largest difference."""
    row, w, P, P_j, H, H_j, R = s.sample
    trial = s.solver_group[row] // s.own.world.robots
    again = solve_relative(P, P_j, H, H_j, R, p.criterion, "cvxpy", groups=trial).w
    largest = np.zeros(len(s.solver_group))
    np.maximum.at(largest, row, np.abs(again - w))
    solved = np.bincount(row, minlength=len(largest)).astype(float)
    return {"solved again by cvxpy": solved, "largest difference of a weight": largest}

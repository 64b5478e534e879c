"""Factors of readings between two robots, and the four messages that pass between such a factor and its two poses.

z = h(x_i, x_j) + noise is linear about (x_i^0, x_j^0):  y = H dx_i + H_j dx_j + noise of covariance R.
"""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Mask, Sensor
from cooploc.estimators.kalman.team_readings import linearise
from cooploc.estimators.kalman.update import symmetric


class Gaussian(NamedTuple):
    """Mean and covariance; nan where there is none."""

    x: Array  # (..., d)
    P: Array  # (..., d, d)


class Information(NamedTuple):
    """eta = H'R^-1 z and Lambda = H'R^-1 H, which add up; nan where there is none."""

    eta: Array  # (..., d)
    Lambda: Array  # (..., d, d)

    def about(self, at: Array) -> "Information":
        """Of a position (r, l, n, 2), as that of deviations from poses `at` (r, l, d); 0 where there is none."""
        eta, Lambda = (np.nan_to_num(a) for a in self)
        d = at.shape[-1]
        eta = eta - times(Lambda, at[:, :, None, :2])
        return Information(_padded(eta, d, 1), _padded(Lambda, d, 2))

    def taken_from(self, belief: Gaussian) -> Gaussian:
        """The belief without this information: (I - P Lambda)^-1 (x - P eta), (I - P Lambda)^-1 P."""
        x, P = belief
        keep = np.asarray(np.linalg.inv(np.eye(P.shape[-1]) - P @ self.Lambda), float)
        return Gaussian(times(keep, x - times(P, self.eta)), symmetric(keep @ P))


class PairFactors(NamedTuple):
    """A robot's readings of teammates, linearised; H = 0 where there is none."""

    y: Array  # (r, l, n, k)
    H: Array  # (r, l, n, k, d)
    H_j: Array  # (r, l, n, k, 2)
    R: Array  # (r, l, n, k, k)
    seen_at: Array  # (r, l, n, 2)  x_j^0

    def onto_self(self, theirs: Gaussian) -> Information:
        """To x_i, about x_i^0: H' S^-1 v, H' S^-1 H with v = y - H_j (m - x_j^0), S = R + H_j C H_j'."""
        v, S = self._without_teammate(theirs)
        W = self.H.mT @ np.linalg.inv(S)
        return Information(times(W, v), W @ self.H)

    def onto_teammate(self, own: Gaussian) -> Information:
        """To x_j, from x_i^0 + own.x: H_j' S^-1 v, H_j' S^-1 H_j with v = y - H own.x + H_j x_j^0, S = R + H P H'."""
        v = self.y - times(self.H, own.x) + times(self.H_j, self.seen_at)
        W = self.H_j.mT @ np.linalg.inv(self.R + self.H @ own.P @ self.H.mT)
        return Information(times(W, v), symmetric(W @ self.H_j))

    def follow(self, theirs: Gaussian, dx: Array) -> Array:
        """x_j (r, l, n, 2) given x_i = x_i^0 + dx: m + C H_j' S^-1 (v - H dx)."""
        v, S = self._without_teammate(theirs)
        off = v - times(self.H, dx[:, :, None])
        return theirs.x + times(theirs.P @ self.H_j.mT @ np.linalg.inv(S), off)

    def _without_teammate(self, theirs: Gaussian) -> tuple[Array, Array]:
        m, C = np.where(np.isnan(theirs.x), self.seen_at, theirs.x), np.nan_to_num(theirs.P)
        return self.y - times(self.H_j, m - self.seen_at), self.R + self.H_j @ C @ self.H_j.mT


def linearised(sensor: Sensor, x: Array, seen: Array, reading: Array, huber: float) -> PairFactors:
    """Factors about own poses x (r, l, d) and teammates' positions `seen` (r, l, n, 2)."""
    seen_at = np.nan_to_num(seen)
    y, H, H_j = linearise(sensor, x[:, :, None], seen_at, reading)
    y, R, (H, H_j) = weighed(np.where(np.isnan(seen[..., :1]), np.nan, y), sensor.R, huber, H, H_j[..., :2])
    return PairFactors(y, H, H_j, R, seen_at)


def weighed(y: Array, R: Array, huber: float, *Hs: Array) -> tuple[Array, Array, list[Array]]:
    """y, R / w and H with 0 where there is no reading; w = 2 h/M - h^2/M^2 where M = |y|_R exceeds h = `huber`.

    So half of y' (R/w)^-1 y is Huber's loss (Davison & Ortiz 2019, sec. 3.6).
    """
    there: Mask = np.asarray(~np.isnan(y).any(-1))
    y, R = np.where(there[..., None], y, 0.0), np.broadcast_to(R, (*y.shape, y.shape[-1]))
    M = np.sqrt((y * np.linalg.solve(R, y[..., None])[..., 0]).sum(-1))
    share = huber / np.maximum(M, huber) if np.isfinite(huber) else np.ones_like(M)
    return y, R / (2 * share - share**2)[..., None, None], [np.where(there[..., None, None], H, 0.0) for H in Hs]


def times(A: Array, x: Array) -> Array:
    """A x of matrices (..., m, k) and vectors (..., k)."""
    product: Array = (A @ x[..., None])[..., 0]
    return product


def _padded(a: Array, d: int, axes: int) -> Array:
    """With zeros for the numbers of a pose (d) beyond its position, in the last `axes`."""
    return np.pad(a, [(0, 0)] * (a.ndim - axes) + [(0, d - 2)] * axes)

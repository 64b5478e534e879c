"""The Kalman predict and update of many rows at once, in two engines that compute the same.

`batched` is a compiled loop over rows (`row_kernels.py`); `predict` and `kalman` state in numpy what it computes.
`filterpy` runs filterpy's ExtendedKalmanFilter row by row: what a filterpy user would compute.
"""

from typing import Literal, NamedTuple, Protocol

import numpy as np

from cooploc.estimators.compiled.jit import readable, spread_out
from cooploc.estimators.interface import Array, Belief, Mask
from cooploc.estimators.kalman import row_kernels

EngineName = Literal["batched", "filterpy"]

# Squared Mahalanobis distance beyond which a reading is refused: chi-square, two degrees of freedom, 0.999.
GATE = 13.8


class Predict(Protocol):
    """x', F P F' + Q for a motion that its caller has linearised; x is moved already and comes back as it is."""

    def __call__(self, x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]: ...


class Update(Protocol):
    """x + K y, (I - K H) P (I - K H)' + K R K'; rows whose reading is absent (nan) or gated come back bit-identical."""

    def __call__(self, x: Array, P: Array, y: Array, H: Array, R: Array, gate: float) -> tuple[Array, Array]: ...


class Engine(NamedTuple):
    """One way to compute a Kalman filter."""

    predict: Predict
    update: Update


def symmetric(P: Array) -> Array:
    """(P + P') / 2."""
    return (P + P.mT) / 2


def root(P: Array) -> Array:
    """A with A A' = P, of covariances P (..., d, d) that may be singular."""
    values, vectors = np.linalg.eigh(P)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :], float)


def present(y: Array, H: Array, R: Array) -> Mask:
    """Rows (...) whose reading, Jacobian and noise have no nan."""
    finite: Mask = np.asarray(~(np.isnan(y).any(-1) | np.isnan(H).any((-2, -1)) | np.isnan(R).any((-2, -1))))
    return finite


def kalman(x: Array, P: Array, y: Array, H: Array, R: Array, gate: float = np.inf) -> tuple[Array, Array]:
    """Kalman update of rows x (..., d), P (..., d, d) by innovation y (..., k), H (..., k, d), R (..., k, k)."""
    R = np.broadcast_to(R, (*y.shape, y.shape[-1]))
    use = present(y, H, R)
    y = np.where(use[..., None], y, 0.0)
    H = np.where(use[..., None, None], H, 0.0)
    R = np.where(use[..., None, None], R, np.eye(y.shape[-1]))
    S = H @ P @ H.mT + R
    use &= distance(y, S) <= gate
    K = np.linalg.solve(S, H @ P).mT
    I_KH = np.eye(x.shape[-1]) - K @ H
    x1 = x + (K @ y[..., None])[..., 0]
    P1 = symmetric(I_KH @ P @ I_KH.mT + K @ R @ K.mT)
    return np.where(use[..., None], x1, x), np.where(use[..., None, None], P1, P)


def inflated_update(
    belief: Belief, y: Array, H: Array, H_j: Array, P_j: Array, R: Array, w: Array, update: Update = kalman
) -> Belief:
    """Kalman update by a reading of a sender, with P/w and P_j/(1-w); rows with w = 1 come back bit-identical."""
    use = w < 1
    v = np.where(use, w, 0.5)[:, None, None]
    N = H_j @ P_j @ H_j.mT / (1 - v) + R
    y = np.where(use[:, None], y, np.nan)
    x, P = update(belief.x, belief.P / v, y, H, N, np.inf)
    return Belief(x, np.where(use[:, None, None], P, belief.P))


def conditioned(x: Array, P: Array, H: Array, y: Array, C: Array) -> tuple[Array, Array]:
    """x', P' when H x becomes N(H x + y, C), y (..., k), C (..., k, k): the rest follows by its covariance with H x.

    L = P H' (H P H')^-1,  x' = x + L y,  P' = (I - L H) P (I - L H)' + L C L'.
    """
    L = np.linalg.solve(H @ P @ H.mT, H @ P).mT
    rest = np.eye(x.shape[-1]) - L @ H
    return x + (L @ y[..., None])[..., 0], symmetric(rest @ P @ rest.mT + L @ C @ L.mT)


def distance(y: Array, S: Array) -> Array:
    """Squared Mahalanobis distance y' S^-1 y (...)."""
    d2: Array = np.einsum("...i,...i->...", y, np.linalg.solve(S, y[..., None])[..., 0])
    return d2


def predict(x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]:
    """F P F' + Q of rows P (..., d, d), F and Q."""
    return x, symmetric(F @ P @ F.mT + Q)


def _row_predict(x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]:
    """`predict`, compiled, equal to 1e-12."""
    d, P1 = P.shape[-1], np.empty(P.shape)
    row_kernels.widen(_rows(P, P.shape), *(_rows(part, P.shape)[:, None] for part in (F, Q)), P1.reshape(-1, d, d))
    return x, P1


def _row_update(x: Array, P: Array, y: Array, H: Array, R: Array, gate: float) -> tuple[Array, Array]:
    """`kalman`, compiled, equal to 1e-12."""
    d, k = H.shape[-1], H.shape[-2]
    x, P = x.copy(), P.copy()
    rows = readable(y).reshape(-1, k), _rows(H, H.shape), _rows(R, (*y.shape, k))
    row_kernels.update(x.reshape(-1, d), P.reshape(-1, d, d), *rows, gate)
    return x, P


def _rows(part: Array, shape: tuple[int, ...]) -> Array:
    """An array that broadcasts to (..., a, b) as rows (r, a, b)."""
    return spread_out(part, shape).reshape(-1, *shape[-2:])


def _filterpy_predict(x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]:
    from filterpy.kalman import ExtendedKalmanFilter

    P = P.copy()
    for i in np.ndindex(x.shape[:-1]):
        ekf = ExtendedKalmanFilter(x.shape[-1], 1)
        ekf.x, ekf.P, ekf.F, ekf.Q = np.zeros(x.shape[-1]), P[i], F[i], Q[i]
        ekf.predict()
        P[i] = ekf.P
    return x, P


def _filterpy_update(x: Array, P: Array, y: Array, H: Array, R: Array, gate: float) -> tuple[Array, Array]:
    from filterpy.kalman import ExtendedKalmanFilter

    x, P = x.copy(), P.copy()
    R = np.broadcast_to(R, (*y.shape, y.shape[-1]))
    for i in zip(*np.nonzero(present(y, H, R)), strict=True):
        ekf = ExtendedKalmanFilter(x.shape[-1], y.shape[-1])
        ekf.x, ekf.P = x[i], P[i]
        ekf.update(y[i], HJacobian=lambda _, i=i: H[i], Hx=lambda _, i=i: np.zeros_like(y[i]), R=R[i])
        if float(ekf.y @ ekf.SI @ ekf.y) <= gate:
            x[i], P[i] = ekf.x, ekf.P
    return x, P


ENGINES: dict[EngineName, Engine] = {
    "batched": Engine(_row_predict, _row_update),
    "filterpy": Engine(_filterpy_predict, _filterpy_update),
}

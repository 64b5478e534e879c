"""Losses that let a reading far from what is expected count less: Huber's, or that of Student's t.

A Kalman filter multiplies the innovation's covariance S by 1/w, w(y' S^-1 y) <= 1, as if the reading had the noise
R' = R + (1/w - 1) S; a particle filter takes the loss rho for half the squared distance. The loss is the sensor's: a
world states it, or an estimator's `loss` does. A gate then refuses what is too far in terms of S/w.

Sources: P. J. Huber, "Robust estimation of a location parameter", Annals of Mathematical Statistics 35, 1964; C. J.
Masreliez, R. D. Martin, "Robust Bayesian estimation for the linear model and robustifying the Kalman filter", IEEE
T-AC 22, 1977 (weights by the innovation); G. Agamennoni, J. Nieto, E. Nebot, "Approximate inference in state-space
models with heavy-tailed noise", IEEE T-SP 60, 2012, and R. Piche, S. Sarkka, J. Hartikainen, "Recursive outlier-robust
filtering and smoothing for nonlinear systems using the multivariate Student-t distribution", MLSP 2012 (Student's
weights); K. Lange, R. Little, J. Taylor, "Robust statistical modeling using the t distribution", JASA 84, 1989 (four
degrees of freedom).
"""

from typing import Literal

import numpy as np

from cooploc.estimators.interface import Array, Sensor

Loss = Literal["none", "huber", "student"]
AssumedLoss = Literal["world", "none", "huber", "student"]  # "world": as the world's sensors state

# Huber's threshold for readings of one and of two numbers: 1.345 standard deviations are 95 % efficient for Gaussian
# noise, and the length of two numbers exceeds 1.855 as often.
THRESHOLD = {1: 1.345, 2: 1.855}
DEGREES = 4.0  # of freedom of Student's t


def loss_of(sensor: Sensor) -> Loss:
    """Return a sensor's loss; one that states none has none."""
    loss: Loss = getattr(sensor, "loss", "none")
    return loss


def weights(loss: Loss, d2: Array, k: int) -> Array:
    """Return w of squared distances d2 (...) of k numbers: c/d beyond Huber's c, (nu + k)/(nu + d^2) of Student's t."""
    if loss == "huber":
        return np.asarray(THRESHOLD[k] / np.sqrt(np.maximum(d2, THRESHOLD[k] ** 2)))
    return np.minimum(1.0, (DEGREES + k) / (DEGREES + d2)) if loss == "student" else np.ones_like(d2)


def penalty(loss: Loss, d2: Array, k: int) -> Array:
    """Return 2 rho of squared distances d2 (...) of k numbers: d^2 without a loss.

    rho = d^2/2 within c, c d - c^2/2 beyond (Huber); (nu + k)/2 log(1 + d^2/nu) (Student).
    """
    if loss == "huber":
        c, d = THRESHOLD[k], np.sqrt(d2)
        return np.where(d > c, 2 * c * d - c**2, d2)
    return (DEGREES + k) * np.log1p(d2 / DEGREES) if loss == "student" else d2


def rescale(loss: Loss, R: Array, S: Array, y: Array, *Hs: Array) -> tuple[Array, ...]:
    """Return T y, T H with T R' T' = R: the reading with noise R' = R + (1/w - 1) S, in units in which its noise is R.

    Of innovations y (..., k), nan where absent, with covariance S (..., k, k), and Jacobians (..., k, d).
    """
    k = y.shape[-1]
    absent = np.asarray(np.isnan(y).any(-1) | np.isnan(S).any((-2, -1)))
    S = np.where(absent[..., None, None], np.eye(k), S)
    y = np.where(absent[..., None], 0.0, y)
    d2 = (y * np.linalg.solve(S, y[..., None])[..., 0]).sum(-1)
    wider = R + (1 / weights(loss, d2, k) - 1)[..., None, None] * S
    T = np.asarray(np.linalg.cholesky(np.broadcast_to(R, S.shape)) @ np.linalg.inv(np.linalg.cholesky(wider)), float)
    return np.where(absent[..., None], np.nan, (T @ y[..., None])[..., 0]), *(T @ H for H in Hs)

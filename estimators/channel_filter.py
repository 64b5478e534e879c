"""The channel filter of one link: what two robots have told each other, which is counted once.

Two robots with positions x = (x_i, x_j) keep for their link the Gaussian C of x: the information that both have. When
they exchange their beliefs, only what each knows beyond C is new. With C_i the marginal of C and z a reading between
them,

    C+ = C  (Bel_i / C_i)  (Bel_j / C_j)  p(z | x_i, x_j),    Bel_i+ = Bel_i  C+_i / (C Bel_i / C_i)_i.

For two robots that lose no message and agree on z, in a linear-Gaussian world, C+ is the centralised posterior.

Source: S. Grime, H. Durrant-Whyte, "Data fusion in decentralized sensor networks", Control Engineering Practice 2(5),
1994; here the common state is the pair of positions, because each robot estimates only its own.
"""

from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Mask
from cooploc.estimators.kalman import kalman, symmetric


class Gaussian(NamedTuple):
    """A Gaussian per row."""

    x: Array  # (k, d) [m]
    P: Array  # (k, d, d) [m^2]


class Information(NamedTuple):
    """log of a Gaussian factor: eta' e - e' Y e / 2, with e the offset from a stated point."""

    eta: Array  # (k, 2) [1/m]
    Y: Array  # (k, 2, 2) [1/m^2], not negative


class Reading(NamedTuple):
    """A reading between the robots, linearised."""

    y: Array  # (k, m)
    H: Array  # (k, m, 4)
    R: Array  # (k, m, m)


def definite(P: Array) -> Mask:
    """Covariances (..., 2, 2) that can be inverted; nan ones cannot."""
    a, b, c = P[..., 0, 0], P[..., 0, 1], P[..., 1, 1]
    regular: Mask = (a > 0) & (c > 0) & (a * c - b * b > 1e-12 * a * c)
    return regular


def news(belief: Gaussian, common: Gaussian) -> Information:
    """Bel / C_i, about the mean of C_i, in the directions in which the belief knows more; nothing in the others.

    The belief knows less than the link where a message was lost, or where particles represent it badly.
    """
    L = _root(common.P)
    whitened = np.asarray(L.mT @ np.linalg.solve(belief.P, L), float)
    gain, V = np.linalg.eigh(symmetric(whitened))  # 1 where nothing is new
    T = np.linalg.solve(L.mT, V)
    eta = (L @ V).mT @ np.linalg.solve(belief.P, (belief.x - common.x)[..., None])
    more = gain > 1
    eta, Y = np.where(more, eta[..., 0], 0.0), np.where(more, gain - 1, 0.0)
    return Information((T @ eta[..., None])[..., 0], symmetric((T * Y[:, None]) @ T.mT))


def _root(P: Array) -> Array:
    """Lower triangular L with L L' = P (k, 2, 2); regular also where rounding has made P singular."""
    a = np.sqrt(P[:, 0, 0])
    b = P[:, 1, 0] / a
    c = np.sqrt(np.maximum(P[:, 1, 1] - b * b, 1e-12 * P[:, 1, 1]))
    return np.stack([np.stack([a, 0 * a], -1), np.stack([b, c], -1)], -2)


def join(common: Gaussian, mine: Information, theirs: Information) -> Gaussian:
    """C (Bel_i / C_i) (Bel_j / C_j)."""
    Y = np.asarray(np.linalg.inv(common.P), float)
    Y[:, :2, :2] += mine.Y
    Y[:, 2:, 2:] += theirs.Y
    P = symmetric(np.asarray(np.linalg.inv(symmetric(Y)), float))
    eta = np.concatenate([mine.eta, theirs.eta], -1)
    return Gaussian(common.x + (P @ eta[..., None])[..., 0], P)


def read(common: Gaussian, reading: Reading) -> Gaussian:
    """Times p(z | x_i, x_j)."""
    return Gaussian(*kalman(*common, reading.y, reading.H, reading.R))


def information_gain(after: Gaussian, before: Gaussian, about: Array) -> Information:
    """The quotient of the first robot's marginals, about the points (k, 2)."""
    x1, Y1 = after.x[:, :2], np.linalg.inv(after.P[:, :2, :2])
    x0, Y0 = before.x[:, :2], np.linalg.inv(before.P[:, :2, :2])
    eta = Y1 @ (x1 - about)[..., None] - Y0 @ (x0 - about)[..., None]
    return Information(eta[..., 0], symmetric(Y1 - Y0))

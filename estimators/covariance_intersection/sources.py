"""Covariances as they are given: what is wrong with one is named, then a call's fusions are whitened."""

from typing import Literal, NamedTuple, get_args

import numpy as np

from cooploc.estimators.compiled.jit import readable
from cooploc.estimators.covariance_intersection import whitening
from cooploc.estimators.covariance_intersection.whitening import Whitened
from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.estimators.kalman.update import symmetric
from cooploc.estimators.plugins.errors import BadInput

Criterion = Literal["det", "trace"]
CRITERIA = get_args(Criterion)

FAULTS = {
    whitening.INFINITE: "has some infinite entries; give a large finite variance, or only infinite ones if unknown",
    whitening.ASYMMETRIC: "is not symmetric; pass (P + P') / 2",
    whitening.INDEFINITE: "is not positive definite; its eigenvalues must be above zero by more than rounding",
    whitening.SINGULAR: "are too close to singular, or too different, to compute with; limit the variances' ratio",
}


class Terms(NamedTuple):
    """The information of K fusions as roots: term k of a fusion is V_k' V_k."""

    V: Array  # (K, m, d, d)  zero where a source is absent
    mix: Array  # (K, m)  shares of the terms in what is whitened
    present: Mask  # (K, m)
    sigma: Array  # (K, k)  of a relative reading, see `relative_terms`; else (K, 0)


def whitened(terms: Terms, block: int, criterion: str, fusion: Indices, groups: Indices | None) -> Whitened:
    """The terms in the coordinates of whitening.py; `fusion` (K,) numbers them in messages, `groups` (K,) in stacks.

    Raises:
        BadInput: the criterion does not exist, or double precision cannot compare the covariances.

    """
    if criterion not in CRITERIA:
        raise BadInput(f"there is no criterion {criterion!r} of covariance intersection; known are det, trace")
    V, mix, present, sigma = terms
    B, C, fault = np.empty_like(V), np.empty((len(V), *V.shape[2:])), np.zeros((len(V), 2), np.int64)
    whitening.whiten(V, mix, block, B, C, fault, (0,) * V.shape[-1])
    _refuse(fault, "the covariances of fusion {f}", fusion)
    group = np.zeros(len(V), np.int64) if groups is None else np.asarray(groups)
    return Whitened(B, C, present, sigma, fusion, group, block, criterion == "trace")


def roots(P: Array, name: str, fusion: Indices) -> tuple[Array, Mask]:
    """V with V'V proportional to P^-1 for P (K, m, d, d), zero where a source is absent, and which are present (K, m).

    Raises:
        BadInput: some P is not a covariance; `name` says which, with {f} for the fusion and {k} for the source.

    """
    V, present, fault = np.empty_like(P), np.empty(P.shape[:2], bool), np.zeros((len(P), 2), np.int64)
    whitening.roots(P, V, present, fault, (0,) * P.shape[-1])
    _refuse(fault, name, fusion)
    return V, present


def relative_terms(P_i: Array, H_i: Array, U: Array, R: Array, fusion: Indices) -> Terms:
    """The information after a relative reading, (2) of weights.py, as w A + sum n_l h_l h_l': the terms are A, h_1, ...

    U = H_j P_j H_j' and R are diagonal in common coordinates, sigma and 1 - sigma, in which U / v + R is inverted entry
    by entry: n = v / (sigma + (1 - sigma) v).
    """
    if not whitening.diagonal(readable(R)):
        least = np.linalg.eigvalsh(R)
        wrong = np.flatnonzero(least[:, 0] < -1e-12 * np.abs(least[:, -1]))
        if wrong.size:
            raise BadInput(
                f"the noise R of fusion {fusion[wrong[0]]} has a negative eigenvalue; it must be a covariance"
            )
    V = roots(P_i[:, None], "P_i of fusion {f}", fusion)[0]
    L = roots((U + R)[:, None], "H_j P_j H_j' + R of fusion {f}", fusion)[0][:, 0]
    L = L / np.sqrt((L @ (U + R) @ L.mT)[:, :1, :1])
    sigma, axes = np.linalg.eigh(symmetric(L @ U @ L.mT))
    scale = np.sqrt(P_i.diagonal(axis1=1, axis2=2).max(-1, initial=0.0))
    h = np.zeros((*H_i.shape[:2], *P_i.shape[1:]))
    h[:, :, 0] = scale[:, None, None] * (axes.mT @ L @ H_i)
    sigma = np.minimum(np.maximum(sigma, 1e-15), 1.0)
    mix = np.concatenate([np.full((len(P_i), 1), 0.5), 1 / (1 + sigma)], 1)  # the information at w = 1/2
    return Terms(np.concatenate([V, h], 1), mix, np.ones(mix.shape, bool), sigma)


def _refuse(fault: Indices, name: str, fusion: Indices) -> None:
    if fault.any():
        f = fault[:, 0].nonzero()[0][0]
        what, k = fault[f]
        raise BadInput(f"{name.format(f=fusion[f], k=k)} {FAULTS[int(what)]}")

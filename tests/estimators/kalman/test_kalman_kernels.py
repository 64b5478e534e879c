"""Kernels with a rule of their own: the weight of split intersection, the cut of Luft's cross terms."""

import numpy as np
import pytest
from oracles import covariances

from cooploc.estimators.ekf_split_ci import EkfSplitCi
from cooploc.estimators.ekf_split_ci import State as SplitState
from cooploc.estimators.joint_kernels import limit_correlation
from cooploc.estimators.kalman import kalman
from cooploc.estimators.split_kernels import least_trace


@pytest.mark.slow
@pytest.mark.parametrize("form", ["literal", "received"])
@pytest.mark.parametrize(("d", "k"), [(2, 1), (3, 2)])
def test_a_compiled_weight_is_the_best_of_a_scan_and_the_parts_add_up(d, k, form):
    rng = np.random.default_rng(43)
    Pd, Pi, Rd, Ri = (covariances(rng, 30, d=size) for size in (d, d, k, k))
    H, y = rng.normal(size=(30, k, d)), 0.1 * rng.normal(size=(30, k))
    y[0] = np.nan
    w, helps = (np.array(part) for part in zip(*map(least_trace, Pd, Pi, H, Rd, Ri), strict=True))
    helps &= np.arange(30) > 0  # the first reading is absent
    assert 5 < helps.sum() < 30
    for r in np.flatnonzero(helps):
        scan = [_position_trace(Pd[r], Pi[r], H[r], Rd[r], Ri[r], v) for v in np.linspace(0.001, 0.999, 999)]
        assert _position_trace(Pd[r], Pi[r], H[r], Rd[r], Ri[r], w[r]) <= min(scan) * (1 + 1e-4)
    state = SplitState(rng.normal(size=(30, d)), Pd, Pi, np.arange(30), None)
    s, used = EkfSplitCi(form=form, gate=np.inf)._update(state, y, H, Rd, Ri)
    np.testing.assert_array_equal(used, helps)
    y, H, Rd, Ri, Pd, Pi, w = (part[used] for part in (y, H, Rd, Ri, Pd, Pi, w))
    s, state = (SplitState(*(part[used] for part in one[:4]), None) for one in (s, state))
    P1, R = Pd / w[:, None, None] + Pi, Rd / (1 - w[:, None, None]) + Ri
    x, P = kalman(state.x, P1, y, H, R)
    np.testing.assert_allclose(s.x, x, atol=1e-12)
    np.testing.assert_allclose(s.Pd + s.Pi, P, atol=1e-11)
    K = np.linalg.solve(R, H @ P).mT
    rest = np.eye(d) - K @ H
    kept = rest @ Pi @ rest.mT + (K @ Ri @ K.mT if form == "literal" else 0.0)
    np.testing.assert_allclose(s.Pi, kept, atol=1e-11)


def _position_trace(Pd, Pi, H, Rd, Ri, w):
    P, R = Pd / w + Pi, Rd / (1 - w) + Ri
    return np.trace((P - P @ H.T @ np.linalg.solve(H @ P @ H.T + R, H @ P))[:2, :2])


def test_luft_cuts_an_impossible_cross_term_and_leaves_a_possible_one():
    P = covariances(np.random.default_rng(32), 50, d=6)
    A, B, C = (np.ascontiguousarray(part) for part in (P[:, :3, :3], P[:, 3:, 3:], P[:, :3, 3:]))
    same, cut = (np.stack([limit_correlation(*one) for one in zip(A, B, k * C, strict=True)]) for k in (1.0, 30.0))
    np.testing.assert_array_equal(same, C)
    assert np.abs(cut - 30 * C).max(axis=(1, 2)).min() > 0
    assert np.linalg.eigvalsh(np.block([[A, cut], [cut.mT, B]])).min() > -1e-9 * P.max()

"""The compiled and the sparse updates of a team's joint Gaussian: against plain numpy, dense forms and each other."""

import ast
from pathlib import Path

import numpy as np
import pytest
from oracles import covariances, exchanges

from cooploc.estimators import compiled, ekf_joint, kalman_kernels
from cooploc.estimators.ekf_interim import EkfInterim
from cooploc.estimators.ekf_interim import State as InterimState
from cooploc.estimators.ekf_joint import EkfJoint
from cooploc.estimators.ekf_luft import State as LuftState
from cooploc.estimators.ekf_luft import _possible, update_pair
from cooploc.estimators.ekf_split_ci import EkfSplitCi
from cooploc.estimators.ekf_split_ci import State as SplitState
from cooploc.estimators.joint_gaussian import (
    information,
    information_update,
    readings_of,
    sparse_update,
)
from cooploc.estimators.joint_kernels import LIMIT, Factored, PairUpdate, least_trace, meet
from cooploc.estimators.kalman import kalman, linearise
from cooploc.estimators.kalman_kernels import add_directions, add_ranges, add_scalars
from cooploc.estimators.models import GradientDoa, LogDistance, Range
from cooploc.scenarios import simulate


def team(seed, d, robots=4, trials=5):
    """Means and a joint covariance with every cross term, robots near enough for some readings to be gated."""
    rng = np.random.default_rng(seed)
    return rng, rng.uniform(0, 6, (trials, robots, d)), 0.3 * covariances(rng, trials, d=robots * d)


@pytest.mark.parametrize("gate", [np.inf, 1.0])
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("what", ["ranges", "directions"])
def test_compiled_readings_are_sparse_updates_one_by_one(what, d, gate):
    rng, x, P = team(37, d)
    doa = GradientDoa(LogDistance(), (0.0, 0.0), (6.0, 5.0))
    x[1, 0, :2] = 0.02, 0.05  # inside the clamp of a node
    z = rng.uniform(0, 6, (5, 4, 4)) if what == "ranges" else rng.uniform(-np.pi, np.pi, (5, 4))
    z[rng.uniform(size=z.shape) < 0.3] = np.nan
    z[0] = np.nan
    want_x, want_P, got_x, got_P, used = x, P, x.copy(), P.copy(), 0
    for j, i in np.ndindex(4, 4) if what == "ranges" else ((None, i) for i in range(4)):
        if what == "directions":
            y, H, _ = doa.innovation(want_x[:, i], np.zeros(2), z[:, i, None])
            at, R = {i: H}, doa.R
        elif i != j:
            y, H_i, H_j = linearise(Range(), want_x[:, i], want_x[:, j], z[:, i, j, None])
            at, R = {i: H_i, j: H_j}, Range().R
        else:
            continue
        want_x, want_P, use = sparse_update(want_x, want_P, y, at, R, gate)
        used += use.sum()
    if what == "ranges":
        add_ranges(got_x, got_P, z, Range().R.item(), gate)
    else:
        add_directions(got_x, got_P, z, ekf_joint._nodes_of(doa), gate)
    assert 2 < used < 48
    np.testing.assert_allclose(got_x, want_x, atol=1e-12)
    np.testing.assert_allclose(got_P, want_P, atol=1e-12)
    np.testing.assert_array_equal(got_P[0], P[0])


@pytest.mark.parametrize("gate", [np.inf, 1.0])
@pytest.mark.parametrize("second_order", [False, True])
@pytest.mark.parametrize("iterations", [1, 3])
def test_compiled_ranges_together_are_the_numpy_ones(iterations, second_order, gate, monkeypatch):
    _, stream = simulate("scalability/n=4", trials=5, seed=40, ticks=1, drop=0.3, prior_sigma=1.0)
    joint = EkfJoint(iterations=iterations, second_order=second_order, gate=gate)
    (before, senses, air), _ = exchanges(joint, stream)[0]
    compiled, _ = joint.exchange(before, senses, air)
    monkeypatch.setattr(ekf_joint, "Range", ())  # what no sensor is an instance of
    plain, _ = joint.exchange(before, senses, air)
    assert np.abs(plain.x - before.x).max() > 0.1
    np.testing.assert_allclose(compiled.x, plain.x, atol=1e-12)
    np.testing.assert_allclose(compiled.P, plain.P, atol=1e-12)
    np.testing.assert_allclose(compiled.refused, plain.refused, atol=1e-15)
    assert (plain.refused > 0).any() == (gate == 1.0)


@pytest.mark.parametrize("k", [1, 2])
def test_own_scalars_one_by_one_are_the_information_form(k):
    rng, x, P = team(41, 3)
    y, H, use = rng.normal(size=(5, 4, k)), rng.normal(size=(5, 4, k, 3)), rng.uniform(size=(5, 4)) < 0.7
    use[0], R = False, np.diag([0.3, 0.1][:k])
    one = readings_of(y[:, :, None], H[:, :, None], np.zeros((5, 4, 1, k, 3)), R)
    eta, Lambda = information(use[..., None], one)
    want_P = information_update(P, Lambda)
    want = x.reshape(5, 12) + (want_P @ eta[..., None])[..., 0]
    got_x, got_P = x.copy(), P.copy()
    add_scalars(got_x, got_P, use, y, H, R.diagonal().copy())
    np.testing.assert_allclose(got_x.reshape(5, 12), want, atol=1e-12)
    np.testing.assert_allclose(got_P, want_P, atol=1e-12)
    np.testing.assert_array_equal(got_P[0], P[0])


@pytest.mark.parametrize("robots", [[2], [0, 3]])
@pytest.mark.parametrize("d", [2, 3])
def test_compiled_masters_are_filterpys(d, robots):
    """Also where some did not hear; and those of one trial do not depend on how many there are."""
    rng = np.random.default_rng(42)
    dense = covariances(rng, 5 * 4, d=4 * d).reshape(5, 4, 4, d, 4, d)
    P = np.stack([dense[:, i, i, :, i] for i in range(4)], 1)
    kept = InterimState(
        rng.normal(size=(5, 4, d)), P, rng.normal(size=(5, 4, d, d)) + 2 * np.eye(d), 0.01 * dense, None
    )
    y, H, heard = rng.normal(size=(5, 2)), rng.normal(size=(5, len(robots), 2, d)), rng.uniform(size=(5, 4)) < 0.7
    y[1], R = np.nan, np.array([[0.3, 0.1], [0.1, 0.2]])
    after, used = {}, {}
    for engine, rows in (("batched", slice(None)), ("filterpy", slice(None)), ("alone", [3])):
        s = InterimState(*(part[rows].copy() for part in kept[:-1]), None)
        at = {robot: H[rows, m] for m, robot in enumerate(robots)}
        filter_ = EkfInterim(engine="filterpy" if engine == "filterpy" else "batched", gate=50.0)
        used[engine], after[engine] = filter_._master(s, robots[0], y[rows], at, R, heard[rows]), s
    assert 0 < used["batched"].sum() < 5
    np.testing.assert_array_equal(used["batched"], used["filterpy"])
    for name in ("x", "P", "Pi"):
        mine, theirs, alone = (getattr(after[engine], name) for engine in after)
        if name == "Pi":  # the diagonal is not used
            for part in (mine, theirs, alone):
                part[:, :, np.arange(4), :, np.arange(4)] = 0.0
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(alone[0], mine[3])


@pytest.mark.parametrize("form", ["literal", "received"])
@pytest.mark.parametrize(("d", "k"), [(2, 1), (3, 2)])
def test_a_compiled_weight_is_the_best_of_a_scan_and_the_parts_add_up(d, k, form):
    rng = np.random.default_rng(43)
    Pd, Pi, Rd, Ri = (covariances(rng, 30, d=size) for size in (d, d, k, k))
    H, y, w = rng.normal(size=(30, k, d)), 0.1 * rng.normal(size=(30, k)), np.empty(30)
    y[0] = np.nan
    least_trace(Pd, Pi, (y, H, Rd, Ri), w)
    helps = ~np.isnan(w)
    assert not helps[0]
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


@pytest.mark.parametrize("gate", [np.inf, 1.0])
@pytest.mark.parametrize("d", [2, 3])
def test_compiled_meetings_are_the_numpy_ones(d, gate):
    """Some of them with an impossible cross term, and those of one trial whatever the others are."""
    rng, trials = np.random.default_rng(44), 30
    sigma = rng.normal(size=(trials, 4, 4, d, d)) * rng.choice([0.3, 3.0], (trials, 1, 1, 1, 1))
    P = covariances(rng, trials * 4, d=d).reshape(trials, 4, d, d)
    plain = LuftState(rng.normal(size=(trials, 4, d)), P, sigma, None)
    compiled, alone = (LuftState(*(part[rows].copy() for part in plain[:3]), None) for rows in (slice(None), [7]))
    y, H_1, H_3, R = rng.normal(size=(trials, 2)), *rng.normal(size=(2, trials, 2, d)), np.diag([0.3, 0.2])
    y[0], H = np.nan, np.concatenate([H_1, H_3], -1)
    cut = (_possible(P[:, 1], P[:, 3], sigma[:, 1, 3] @ sigma[:, 3, 1].mT) != sigma[:, 1, 3] @ sigma[:, 3, 1].mT).any()
    assert cut
    want = update_pair(plain, 1, 3, y, H_1, H_3, R, gate, kalman)
    used = meet(Factored(*compiled[:3]), (1, 3), PairUpdate(y, H, R), gate)
    meet(Factored(*alone[:3]), (1, 3), PairUpdate(y[[7]], H[[7]], R), gate)
    np.testing.assert_array_equal(used, want)
    assert 0 < used.sum() < trials
    for got, expected, single in zip(compiled[:3], plain[:3], alone[:3], strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(got[7], single[0])


def test_information_form_is_the_dense_form_at_fifty_robots():
    _, stream = simulate("scalability/n=50", trials=1, seed=27, ticks=2)
    joint = EkfJoint(iterations=1, second_order=False, gate=np.inf)
    for (before, _, air), after in exchanges(joint, stream):
        x, P, z = before.x[0], before.P[0].reshape(100, 100), air.range[0]
        pairs = np.argwhere(np.isfinite(z) & (z >= 0.2))
        H, y = np.zeros((len(pairs), 50, 2)), np.zeros(len(pairs))
        for row, (i, j) in enumerate(pairs):
            d = np.hypot(*(x[i] - x[j]))
            H[row, i], H[row, j], y[row] = (x[i] - x[j]) / d, (x[j] - x[i]) / d, z[i, j] - d
        H = H.reshape(len(pairs), 100)
        gain = np.linalg.solve(H @ P @ H.T + 0.01 * np.eye(len(pairs)), H @ P).T
        np.testing.assert_allclose(after.x[0].ravel(), x.ravel() + gain @ y, atol=1e-8)
        np.testing.assert_allclose(after.P[0].reshape(100, 100), P - gain @ H @ P, atol=1e-8)


def test_luft_cuts_an_impossible_cross_term_and_leaves_a_possible_one():
    rng = np.random.default_rng(32)
    P = covariances(rng, 50, d=6)
    A, B, C = P[:, :3, :3], P[:, 3:, 3:], P[:, :3, 3:]
    np.testing.assert_array_equal(_possible(A, B, C), C)
    cut = _possible(A, B, 30 * C)
    assert np.abs(cut - 30 * C).max(axis=(1, 2)).min() > 0
    assert np.linalg.eigvalsh(np.block([[A, cut], [cut.mT, B]])).min() > -1e-9 * P.max()
    assert LIMIT < 1


def test_every_file_that_kernels_are_made_of_makes_them_compile_again():
    """A kernel's own file does; so must those from which it takes functions and constants."""
    for path in Path(kalman_kernels.__file__).parent.glob("*_kernels.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and "cooploc" in node.module and "interface" not in node.module:
                taken = {node.module.split(".")[-1], *(alias.name for alias in node.names)}
                assert taken & set(compiled.SHARED), path.name

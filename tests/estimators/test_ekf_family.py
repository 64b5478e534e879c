"""Cooperative Kalman filters: against dense Gaussians, filterpy's loops and each other, and what loss does to them."""

from dataclasses import replace

import numpy as np
import pytest
from oracles import PLACES, Offset, covariances, dense_posterior, is_covariance, linear_team

from cooploc.estimators import ekf_joint
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.estimators.ekf_ci import EkfCi
from cooploc.estimators.ekf_interim import EkfInterim
from cooploc.estimators.ekf_joint import EkfJoint
from cooploc.estimators.ekf_local import EkfLocal
from cooploc.estimators.ekf_luft import EkfLuft, _possible, met
from cooploc.estimators.ekf_luft import State as LuftState
from cooploc.estimators.ekf_naive import EkfNaive
from cooploc.estimators.ekf_split_ci import EkfSplitCi
from cooploc.estimators.kalman.factor_kernels import LIMIT, Factored, PairUpdate, meet
from cooploc.estimators.kalman.joint_update import (
    add_rows,
    definite,
    direction_by_direction,
    information,
    information_mean,
    information_update,
    range_by_range,
    readings_of,
    scalar_by_scalar,
    sparse_update,
    subtract_products,
    widened,
)
from cooploc.estimators.kalman.team_readings import linearise
from cooploc.estimators.kalman.update import kalman
from cooploc.estimators.models.gradient_doa import GradientDoa
from cooploc.estimators.models.sensors import LogDistance, Range
from cooploc.estimators.ukf_joint import UkfJoint
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.run import run, trace

PLAIN = {"iterations": 1, "second_order": False, "update": "sequential"}
TEAM = {
    "naive": EkfNaive(gate=np.inf),
    "split-ci": EkfSplitCi(gate=np.inf),
    "luft": EkfLuft(gate=np.inf),
    "interim": EkfInterim(gate=np.inf),
    "ukf": UkfJoint(gate=np.inf),
}


def nees(x, got):
    """Normalised squared error (t, T, n) / d."""
    e = got.x - x
    return np.einsum("tkna,tkna->tkn", e, np.linalg.solve(got.P, e[..., None])[..., 0]) / x.shape[-1]


def states(estimator, stream, method="exchange", after=True, every=1):
    """The state after, or before, a method at every so many ticks."""
    seen = []

    def watch(name, tick, arguments, call):
        result = call(*arguments)
        if name == method and tick % every == 0:
            seen.append((result[0] if method == "exchange" else result) if after else arguments)
        return result

    trace("watched", estimator, stream, watch)
    return seen


def without(stream, **channels):
    """The stream with some readings gone."""
    return stream.with_arrays(
        {f"senses.{name}": np.full_like(getattr(stream.senses, name), np.nan) for name in channels if channels[name]}
    )


# ---------------------------------------------------------------- linear-Gaussian oracles


@pytest.mark.parametrize("share", [0.3, 1.0])
@pytest.mark.parametrize("estimator", [EkfJoint(**PLAIN, gate=np.inf), EkfInterim(gate=np.inf), UkfJoint(gate=np.inf)])
def test_exact_filters_are_the_dense_posterior_of_everything(estimator, share):
    _, stream = linear_team(seed=21, trials=2, robots=3, ticks=5, share=share)
    got = trace("exact", estimator, stream)
    for trial in range(2):
        for k in range(5):
            x, P = dense_posterior(stream, trial, k, relative=True)
            np.testing.assert_allclose(got.x[trial, k], x, atol=1e-8)
            np.testing.assert_allclose(got.P[trial, k], np.einsum("iaib->iab", P), atol=1e-8)


def test_luft_is_exact_for_two_robots_without_private_readings():
    _, stream = linear_team(seed=22, trials=2, robots=2, ticks=6)
    stream = without(stream, landmark=True)
    got = trace("luft", EkfLuft(gate=np.inf), stream)
    for trial in range(2):
        for k in range(6):
            x, P = dense_posterior(stream, trial, k, relative=True)
            np.testing.assert_allclose(got.x[trial, k], x, atol=1e-8)
            np.testing.assert_allclose(got.P[trial, k], np.einsum("iaib->iab", P), atol=1e-8)


def naive_truth(stream, trial):
    """What the naive filter states, and the covariance its errors really have: (T, n, 2, 2) each.

    Errors of the team, and of the beliefs it broadcast, as one linear map of independent noises after the other.
    """
    n, z, R = stream.robots, stream.senses, Offset().R
    P = stream.prior.P[trial].copy()
    C = np.zeros((4 * n, 4 * n))  # of the errors now, and of those sent
    for i in range(n):
        C[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = P[i]
    stated, real = [], []

    def update(i, H_sent, R_stated):
        nonlocal C
        me = slice(2 * i, 2 * i + 2)
        K = P[i] @ np.linalg.inv(P[i] + R_stated)
        A = np.eye(4 * n)
        A[me, me] -= K
        if H_sent is not None:
            A[me, 2 * n + 2 * H_sent : 2 * n + 2 * H_sent + 2] += K
        C = A @ C @ A.T
        C[me, me] += K @ R @ K.T
        P[i] = (np.eye(2) - K) @ P[i]

    for k in range(z.dt.shape[1]):
        for i in range(n):
            Q = 0.3**2 * z.dt[trial, k, i] / 0.5 * np.eye(2)
            P[i] += Q
            C[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] += Q
            for reading in z.landmark[trial, k, i]:
                if np.isfinite(reading).all():
                    update(i, None, R)
        copy = np.kron([[1, 0], [1, 0]], np.eye(2 * n))
        C, sent = copy @ C @ copy.T, P.copy()
        for i in range(n):
            for j in range(n):
                if np.isfinite(z.sighting[trial, k, i, j]).all():
                    update(i, j, R + sent[j])
        stated.append(P.copy())
        real.append(np.stack([C[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] for i in range(n)]))
    return np.array(stated), np.array(real)


def test_naive_is_over_confident_by_the_predicted_factor():
    trials = 400
    x, stream = linear_team(seed=23, trials=trials, robots=3, ticks=6)
    stream = without(stream, landmark=True)
    got = trace("naive", EkfNaive(both=False, gate=np.inf), stream)
    stated, real = (np.stack(a) for a in zip(*(naive_truth(stream, i) for i in range(trials)), strict=True))
    np.testing.assert_allclose(got.P, stated, atol=1e-9)
    predicted = np.einsum("tkiaa->tki", np.linalg.solve(stated, real)) / 2
    found = nees(x, got)
    assert predicted[:, -1].mean() > 2
    # Standard error of a mean of 400 values of NEES / 2: about 5 % of it.
    np.testing.assert_allclose(found.mean(0), predicted.mean(0), rtol=0.2)
    np.testing.assert_allclose(found.mean(), predicted.mean(), rtol=0.08)


@pytest.mark.parametrize("both", [False, True])
def test_split_ci_is_conservative_where_naive_is_not(both):
    x, stream = linear_team(seed=24, trials=300, robots=3, ticks=10)
    stream = without(stream, landmark=True)
    traces = run(
        {"split": EkfSplitCi(form="conservative", both=both, gate=np.inf), "naive": EkfNaive(gate=np.inf)}, stream
    ).traces
    split = traces["split"]
    assert nees(x, traces["naive"])[:, -1].mean() > 2
    assert nees(x, split).mean((0, 2)).max() < 1.1
    e = (split.x - x)[:, -1]
    real = np.einsum("tna,tnb->nab", e, e) / len(e)
    assert np.linalg.eigvalsh(split.P[:, -1].mean(0) - real).min() > -0.1 * np.abs(real).max()


def test_split_ci_that_trusts_what_it_sent_lies_between():
    x, stream = linear_team(seed=24, trials=300, robots=3, ticks=10)
    stream = without(stream, landmark=True)
    forms = {form: EkfSplitCi(form=form, gate=np.inf) for form in ("literal", "received", "conservative")}
    literal, received, conservative = (nees(x, got)[:, 1:].mean() for got in run(forms, stream).traces.values())
    assert literal > 2 * received > 2 * conservative


def test_literal_split_ci_of_independent_priors_is_the_naive_filter():
    _, stream = simulate("camera", trials=2, seed=25, ticks=40)
    traces = run({"split": EkfSplitCi(form="literal"), "naive": EkfNaive()}, stream).traces
    held = np.isclose(traces["split"].x, traces["naive"].x, atol=1e-6).all(-1)
    assert held.mean() > 0.9  # it also leaves alone what is no gain


# ---------------------------------------------------------------- one filter, computed twice


@pytest.mark.parametrize("robots", [1, 3, 10])
@pytest.mark.parametrize(
    ("cls", "parameters"),
    [
        (EkfJoint, PLAIN),
        (EkfJoint, {"update": "batch"}),
        (EkfNaive, {}),
        (EkfCi, {}),
        (EkfCi, {"criterion": "det", "over": "position"}),
        (EkfSplitCi, {}),
        (EkfLuft, {}),
        (EkfInterim, {}),
        (UkfJoint, {}),
    ],
    ids=["joint-plain", "joint-batch", "naive", "ci", "ci-position", "split-ci", "luft", "interim", "ukf"],
)
def test_batched_is_filterpy(cls, parameters, robots):
    ticks = 4 if robots == 10 else 20
    for label in (f"scalability/n={robots}", f"camera/n={robots}"):
        _, stream = simulate(label, trials=1 if robots == 10 else 2, seed=26, ticks=ticks)
        batched, loop = (cls(**parameters, engine=engine) for engine in ("batched", "filterpy"))
        traces = run({"batched": batched, "filterpy": loop}, stream).traces
        np.testing.assert_allclose(traces["batched"].x, traces["filterpy"].x, atol=1e-9)
        np.testing.assert_allclose(traces["batched"].P, traces["filterpy"].P, atol=1e-9)


def test_ci_by_stated_positions_is_filterpys():
    _, stream = simulate("camera/n=3", trials=2, seed=26, ticks=40)
    batched, loop = (trace(engine, EkfCi(form="ls", engine=engine), stream) for engine in ("batched", "filterpy"))
    np.testing.assert_allclose(batched.x, loop.x, atol=1e-9)
    np.testing.assert_allclose(batched.P, loop.P, atol=1e-9)


def test_interim_master_is_filterpys_under_losses_too():
    _, stream = simulate("packet-drop/drop=0.7", trials=3, seed=26, ticks=60)
    batched, loop = (trace(engine, EkfInterim(engine=engine), stream) for engine in ("batched", "filterpy"))
    np.testing.assert_allclose(batched.x, loop.x, atol=1e-9)
    np.testing.assert_allclose(batched.P, loop.P, atol=1e-9)


def team(seed, d, robots=4, trials=5):
    """Means and a joint covariance with every cross term, robots near enough for some readings to be gated."""
    rng = np.random.default_rng(seed)
    return rng, rng.uniform(0, 6, (trials, robots, d)), 0.3 * covariances(rng, trials, d=robots * d)


@pytest.mark.parametrize("gate", [np.inf, 1.0])
@pytest.mark.parametrize("d", [2, 3])
def test_compiled_ranges_are_sparse_updates_one_by_one(d, gate):
    rng, x, P = team(37, d)
    z = np.where(rng.uniform(size=(5, 4, 4)) < 0.7, rng.uniform(0, 6, (5, 4, 4)), np.nan)
    z[0] = np.nan
    want_x, want_P, used = x, P, 0
    for j in range(4):
        for i in set(range(4)) - {j}:
            y, H_i, H_j = linearise(Range(), want_x[:, i], want_x[:, j], z[:, i, j, None])
            want_x, want_P, use = sparse_update(want_x, want_P, y, {i: H_i, j: H_j}, Range().R, gate)
            used += use.sum()
    got_x, got_P = range_by_range(x, P, z, Range().R, gate)
    assert 5 < used < 48
    np.testing.assert_allclose(got_x, want_x, atol=1e-12)
    np.testing.assert_allclose(got_P, want_P, atol=1e-12)
    np.testing.assert_array_equal(got_P[0], P[0])


@pytest.mark.parametrize("gate", [np.inf, 1.0])
@pytest.mark.parametrize("d", [2, 3])
def test_compiled_directions_are_sparse_updates_one_by_one(d, gate):
    rng, x, P = team(38, d)
    doa = GradientDoa(LogDistance(), (0.0, 0.0), (6.0, 5.0))
    x[1, 0, :2] = 0.02, 0.05  # inside the clamp
    z = np.where(rng.uniform(size=(5, 4)) < 0.8, rng.uniform(-np.pi, np.pi, (5, 4)), np.nan)
    z[0], z[1, 0] = np.nan, 3.0
    want_x, want_P, used = x, P, 0
    for i in range(4):
        y, H, _ = doa.innovation(want_x[:, i], np.zeros(2), z[:, i, None])
        want_x, want_P, use = sparse_update(want_x, want_P, y, {i: H}, doa.R, gate)
        used += use.sum()
    got_x, got_P = direction_by_direction(x, P, z, doa, gate)
    assert 2 < used < 20
    np.testing.assert_allclose(got_x, want_x, atol=1e-12)
    np.testing.assert_allclose(got_P, want_P, atol=1e-12)
    np.testing.assert_array_equal(got_P[0], P[0])


@pytest.mark.parametrize("gate", [np.inf, 1.0])
@pytest.mark.parametrize("second_order", [False, True])
@pytest.mark.parametrize("iterations", [1, 3])
def test_compiled_ranges_together_are_the_numpy_ones(iterations, second_order, gate, monkeypatch):
    _, stream = simulate("scalability/n=4", trials=5, seed=40, ticks=1, drop=0.3, prior_sigma=1.0)
    joint = EkfJoint(iterations=iterations, second_order=second_order, gate=gate)
    before, senses, air = states(joint, stream, after=False)[0]
    compiled, _ = joint.exchange(before, senses, air)
    monkeypatch.setattr(ekf_joint, "Range", ())  # what no sensor is an instance of
    plain, _ = joint.exchange(before, senses, air)
    assert np.abs(plain.x - before.x).max() > 0.1
    np.testing.assert_allclose(compiled.x, plain.x, atol=1e-12)
    np.testing.assert_allclose(compiled.P, plain.P, atol=1e-12)
    np.testing.assert_allclose(compiled.refused, plain.refused, atol=1e-15)
    assert (plain.refused > 0).any() == (gate == 1.0)


def test_a_move_without_rotation_widens_as_the_matrix_product_does():
    rng, _, P = team(40, 2)
    Q = 0.1 * covariances(rng, 20, d=2).reshape(5, 4, 2, 2)
    noise = np.zeros_like(P)
    for i in range(4):
        noise[:, 2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = Q[:, i]
    P[1, 0, 7] += 0.3  # what is not symmetric becomes so
    np.testing.assert_array_equal(widened(P, Q), ((P + noise) + (P + noise).mT) / 2)


def test_own_scalars_one_by_one_are_the_information_form():
    rng, x, P = team(41, 3)
    y, H, use = rng.normal(size=(5, 4)), rng.normal(size=(5, 4, 3)), rng.uniform(size=(5, 4)) < 0.7
    use[0] = False
    one = readings_of(y[..., None, None], H[:, :, None, None], np.zeros((5, 4, 1, 1, 3)), np.array([[0.3]]))
    eta, Lambda = information(use[..., None], one)
    want_P = information_update(P, Lambda)
    want = x.reshape(5, 12) + (want_P @ eta[..., None])[..., 0]
    got_x, got_P = scalar_by_scalar(x, P, use, y, H, np.array([[0.3]]))
    np.testing.assert_allclose(got_x.reshape(5, 12), want, atol=1e-12)
    np.testing.assert_allclose(got_P, want_P, atol=1e-12)
    np.testing.assert_array_equal(got_P[0], P[0])


@pytest.mark.parametrize("k", [1, 2])
@pytest.mark.parametrize("d", [2, 3])
def test_compiled_factors_are_the_numpy_ones(d, k):
    """And those of one trial do not depend on how many there are."""
    rng = np.random.default_rng(42)
    Pi = covariances(rng, 5 * 4, d=4 * d).reshape(5, 4, 4, d, 4, d)
    W, takes = rng.normal(size=(5, k, d)), rng.uniform(size=(5, 4)) < 0.5
    Gamma, left = np.ones((5, 4, k, 4, d)), Pi.copy()
    add_rows(Gamma, Pi, 2, W)
    np.testing.assert_allclose(Gamma, 1 + np.einsum("tojac,tkc->tokja", Pi[..., 2, :], W), atol=1e-12)
    subtract_products(left, Gamma, takes)
    products = np.einsum("tokja,toklb->tojalb", Gamma, Gamma)
    np.testing.assert_allclose(left, Pi - takes[..., None, None, None, None] * products, atol=1e-12)
    np.testing.assert_array_equal(left[~takes], Pi[~takes])
    np.testing.assert_array_equal(left, left.transpose(0, 1, 4, 5, 2, 3))  # rows stand for columns to the last bit
    alone, one = np.ones((1, 4, k, 4, d)), Pi[3:4].copy()
    add_rows(alone, one, 2, W[3:4])
    subtract_products(one, alone, takes[3:4])
    np.testing.assert_array_equal(alone[0], Gamma[3])
    np.testing.assert_array_equal(one[0], left[3])


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
    want = met(plain, 1, 3, y, H_1, H_3, R, gate, kalman)
    used = meet(Factored(*compiled[:3]), (1, 3), PairUpdate(y, H, R), gate)
    meet(Factored(*alone[:3]), (1, 3), PairUpdate(y[[7]], H[[7]], R), gate)
    np.testing.assert_array_equal(used, want)
    assert 0 < used.sum() < trials
    for got, expected, single in zip(compiled[:3], plain[:3], alone[:3], strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(got[7], single[0])


@pytest.mark.parametrize("d", [1, 2, 3])
def test_definite_is_a_smallest_eigenvalue_above_zero(d):
    P = np.random.default_rng(43).normal(size=(40, 5, d, d)) + np.eye(d)
    P = P + P.mT
    want = np.linalg.eigvalsh(P)[..., 0] > 0
    assert 20 < want.sum() < 180
    np.testing.assert_array_equal(definite(P), want)
    assert not definite(np.zeros((d, d)))
    assert not definite(np.full((d, d), np.nan))


def test_the_mean_in_information_form_is_that_of_the_whole_update():
    rng, x, P = team(39, 2)
    H = rng.normal(size=(5, 6, 8))
    eta, Lambda = rng.normal(size=(5, 8)), H.mT @ H
    want = x.reshape(5, 8) + (information_update(P, Lambda) @ eta[..., None])[..., 0]
    np.testing.assert_allclose(information_mean(x.reshape(5, 8), P, eta, Lambda), want, atol=1e-12)


def test_information_form_is_the_dense_form_at_fifty_robots():
    _, stream = simulate("scalability/n=50", trials=1, seed=27, ticks=2)
    joint = EkfJoint(iterations=1, second_order=False, gate=np.inf)
    for before, _, air in states(joint, stream, after=False):
        after, _ = joint.exchange(before, stream.senses, air)
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


# ---------------------------------------------------------------- loss


@pytest.mark.parametrize("label", ["camera", "trajectory", "scalability/n=10[ticks=15]"])
def test_interim_master_is_the_joint_filter_while_nothing_is_lost(label):
    overrides = {} if "ticks" in label else {"ticks": 120}
    _, stream = simulate(label, trials=2, seed=28, **overrides)
    traces = run({"interim": EkfInterim(), "joint": EkfJoint(**PLAIN)}, stream).traces
    np.testing.assert_allclose(traces["interim"].x, traces["joint"].x, atol=1e-9)
    np.testing.assert_allclose(traces["interim"].P, traces["joint"].P, atol=1e-9)


def test_interim_master_breaks_at_the_first_lost_message():
    """A third robot misses what two others make of a sighting, in a tick in which it has no reading of its own."""
    _, stream = simulate("camera", trials=1, seed=29, ticks=150)
    stream = without(stream, landmark=True)
    seen = np.isfinite(stream.senses.sighting).all(-1)[0]  # (T, n, n)
    idle = ~(seen.any(1) | seen.any(2))
    lost, a, b = next((k, a, b) for k, a, b in np.argwhere(seen) if k >= 40 and idle[k, 3 - a - b])
    link = stream.air.link.copy()
    link[0, lost, 3 - a - b, a] = False
    traces = run({"joint": EkfJoint(**PLAIN), "whole": EkfInterim()}, stream).traces
    broken = trace("broken", EkfInterim(), stream.with_arrays({"air.link": link}))
    off = np.abs(broken.x - traces["joint"].x)[0].max(-1)
    assert off[:lost].max() < 1e-9
    assert off[lost, [a, b]].max() < 1e-9
    assert off[lost, 3 - a - b] > 1e-9
    assert off[lost:].max() > 1e-3
    np.testing.assert_allclose(traces["whole"].x, traces["joint"].x, atol=1e-9)


def test_interim_master_stays_finite_and_definite_however_much_is_lost():
    _, stream = simulate("packet-drop/drop=0.7", trials=8, seed=2)
    assert is_covariance(trace("interim", EkfInterim(), stream).P)


@pytest.mark.parametrize("name", ["luft", "interim"])
def test_pairwise_protocols_need_both_directions(name):
    """Nobody hears robot 0: nobody but robot 0 may notice what it sees, and it sees nobody answer."""
    _, stream = simulate("camera", trials=2, seed=30, ticks=60)
    link = stream.air.link.copy()
    link[..., 0] = False  # axis 2 is the receiver, axis 3 the sender
    stream = stream.with_arrays({"air.link": link})
    sighting = stream.senses.sighting.copy()
    sighting[:, :, 0] = np.nan
    sighting[:, :, :, 0] = np.nan
    blind = stream.with_arrays({"senses.sighting": sighting})
    a, b = trace("a", TEAM[name], stream), trace("b", TEAM[name], blind)
    np.testing.assert_array_equal(a.x[:, :, 1:], b.x[:, :, 1:])
    np.testing.assert_array_equal(a.P[:, :, 1:], b.P[:, :, 1:])


# ---------------------------------------------------------------- soundness


@pytest.mark.parametrize(
    "estimator",
    [EkfJoint(), EkfJoint(**PLAIN), EkfNaive(), EkfLuft(), EkfSplitCi(), EkfInterim()],
    ids=["joint-batch", "joint-plain", "naive", "luft", "split-ci", "interim"],
)
def test_covariances_stay_definite_over_ten_thousand_ticks(estimator):
    """Without landmarks, so that what is shared grows while what is relative stays small."""
    _, stream = simulate("camera/n=2", seed=31, ticks=10_000)
    stream = without(stream, landmark=True)
    if isinstance(estimator, EkfJoint):
        for s in states(estimator, stream, every=50):
            P = s.P.reshape(6, 6)
            np.testing.assert_allclose(P, P.T, rtol=1e-12, atol=1e-12 * P.max())
            assert np.linalg.eigvalsh(P).min() > 0
    else:
        P = trace("long", estimator, stream).P
        np.testing.assert_allclose(P, P.mT, rtol=1e-12, atol=1e-12 * P.max())
        assert np.linalg.eigvalsh(P).min() > 0


def test_luft_cuts_an_impossible_cross_term_and_leaves_a_possible_one():
    rng = np.random.default_rng(32)
    P = covariances(rng, 50, d=6)
    A, B, C = P[:, :3, :3], P[:, 3:, 3:], P[:, :3, 3:]
    np.testing.assert_array_equal(_possible(A, B, C), C)
    cut = _possible(A, B, 30 * C)
    assert np.abs(cut - 30 * C).max(axis=(1, 2)).min() > 0
    assert np.linalg.eigvalsh(np.block([[A, cut], [cut.mT, B]])).min() > -1e-9 * P.max()
    assert LIMIT < 1


@pytest.mark.parametrize("name", TEAM)
def test_gate_refuses_outliers(name):
    _, stream = linear_team(seed=33, trials=1, robots=2, ticks=1, share=1.0)
    stream = stream.with_arrays({f"senses.{c}": getattr(stream.senses, c) + 300.0 for c in ("landmark", "sighting")})
    cls = type(TEAM[name])
    traces = run({"dead": DeadReckoning(), "gated": cls(), "open": cls(gate=np.inf)}, stream).traces
    np.testing.assert_allclose(traces["gated"].x, traces["dead"].x, atol=1e-9)
    np.testing.assert_allclose(traces["gated"].P, traces["dead"].P, atol=1e-9)
    assert np.abs(traces["open"].x - traces["dead"].x).max() > 10


@pytest.mark.parametrize("name", TEAM)
def test_what_is_heard_helps(name):
    truth, stream = simulate("robots-1-3/n=3", trials=20, seed=34, ticks=60)
    alone = stream.with_arrays({"air.link": np.zeros_like(stream.air.link)})
    together, apart = trace(name, TEAM[name], stream), trace(name, TEAM[name], alone)
    error = [np.sqrt(((got.x - truth.x) ** 2).sum(-1).mean()) for got in (together, apart)]
    assert error[0] < error[1]


def with_radio(truth, stream, channel):
    """A camera world whose robots measure each other by radio instead: unicycles with ranges or RSSI."""
    rng, x = np.random.default_rng(36), truth.x[..., :2]
    d = np.linalg.norm(x[:, :, :, None] - x[:, :, None], axis=-1)
    d = np.where(np.eye(stream.robots, dtype=bool), np.nan, d)
    sensor, z = {
        "range": (Range(0.1), d + rng.normal(0, 0.1, d.shape)),
        "rssi": (LogDistance(), -40 - 30 * np.log10(d) + rng.normal(0, 5**0.5, d.shape)),
    }[channel]
    nothing = {"range": np.empty((*d.shape[:3], 0)), "rssi": np.empty((*d.shape[:3], 0))}
    sensors = {"landmark": stream.world.sensors["landmark"], f"radio_{channel}": sensor}
    return replace(
        stream,
        world=replace(stream.world, sensors=sensors),
        senses=stream.senses._replace(sighting=np.empty((*d.shape[:3], 0, 2))),
        air=stream.air._replace(**{**nothing, channel: z}),
    )


@pytest.mark.parametrize("channel", ["range", "rssi"])
def test_unicycles_with_radios_gain_by_every_filter(channel):
    truth, stream = simulate("camera", trials=6, seed=36, ticks=100)
    stream = with_radio(truth, stream, channel)
    filters = {name: type(TEAM[name])(reading=channel) for name in TEAM} | {"joint": EkfJoint(reading=channel)}
    error = {
        name: np.sqrt(((got.x - truth.x)[..., :2] ** 2).sum(-1).mean())
        for name, got in run({"local": EkfLocal(), **filters}, stream).traces.items()
    }
    assert all(error[name] < error["local"] for name in filters)


def test_unscented_filter_refuses_what_would_make_it_indefinite():
    _, stream = simulate("nlos/n=3", trials=10, seed=5, ticks=100)
    for s in states(UkfJoint(), stream, every=5):
        assert np.linalg.eigvalsh(s.P).min() > 0


def test_traffic_is_what_the_protocols_say():
    _, stream = simulate("camera", trials=2, seed=35, ticks=80)
    made = np.isfinite(stream.senses.sighting).all(-1)  # (t, T, i, j)
    fixed = (stream.senses.landmark[..., 0] >= 0.2).sum((1, 3))  # nearer ones are refused
    sees, seen = made.sum((1, 3)), made.sum((1, 2))
    assert (sees > 0).any()
    luft, interim, naive, split = (trace(name, TEAM[name], stream) for name in ("luft", "interim", "naive", "split-ci"))
    np.testing.assert_array_equal(luft.messages, 2 * sees + seen)
    np.testing.assert_array_equal(luft.bytes, sees * (8 + 8 + 9 * 8) + seen * (8 + 18 * 8))
    np.testing.assert_array_equal(interim.messages, fixed + 2 * sees + seen)
    update, private = 8 + 8 * (2 + 2 * 13), 8 + 8 * (1 + 2 * 7)
    np.testing.assert_array_equal(interim.bytes, fixed * private + sees * (8 + update) + seen * (8 + 18 * 8))
    np.testing.assert_array_equal(naive.bytes, 80 * (8 + 9 * 8) + 16 * sees)
    np.testing.assert_array_equal(split.bytes, 80 * (8 + 15 * 8) + 16 * sees)


def test_places_are_the_oracles():
    """`naive_truth` reads a landmark as a reading of the position itself."""
    y, H, _ = Offset().innovation(np.zeros(2), PLACES[0], -PLACES[0])
    np.testing.assert_allclose(y, 0)
    np.testing.assert_allclose(H, np.eye(2))

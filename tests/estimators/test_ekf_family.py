"""Cooperative Kalman filters: against dense Gaussians, filterpy's loops and each other, and what loss does to them."""

import numpy as np
import pytest
from oracles import Offset, dense_posterior, exchanges, linear_team, nees

from cooploc.estimators import make
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.estimators.ekf_interim import EkfInterim
from cooploc.estimators.ekf_joint import EkfJoint
from cooploc.estimators.ekf_local import EkfLocal
from cooploc.estimators.ekf_luft import EkfLuft
from cooploc.estimators.ekf_naive import EkfNaive
from cooploc.estimators.ekf_split_ci import EkfSplitCi
from cooploc.estimators.ukf_joint import UkfJoint
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.run import run
from cooploc.scenarios.runner.trace import trace

PLAIN = {"iterations": 1, "second_order": False, "update": "sequential"}
TEAM = {
    "naive": EkfNaive(gate=np.inf),
    "split-ci": EkfSplitCi(gate=np.inf),
    "luft": EkfLuft(gate=np.inf),
    "interim": EkfInterim(gate=np.inf),
    "ukf": UkfJoint(gate=np.inf),
    "joint": EkfJoint(gate=np.inf),
    "local": EkfLocal(gate=np.inf),
}


def without(stream, **channels):
    """The stream with some readings gone."""
    return stream.replace_arrays(
        {f"senses.{name}": np.full_like(getattr(stream.senses, name), np.nan) for name in channels if channels[name]}
    )


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


def test_literal_split_ci_of_independent_priors_is_the_naive_filter():
    _, stream = simulate("camera", trials=2, seed=25, ticks=40)
    traces = run({"split": EkfSplitCi(form="literal"), "naive": EkfNaive()}, stream).traces
    held = np.isclose(traces["split"].x, traces["naive"].x, atol=1e-6).all(-1)
    assert held.mean() > 0.9  # it also leaves alone what is no gain


@pytest.mark.parametrize("robots", [1, 3, 10])
@pytest.mark.parametrize(
    "label",
    [
        "ekf-joint[iterations=1,second_order=false,update=sequential]",
        "ekf-joint",
        "ekf-naive",
        "ekf-ci",
        "ekf-ci[criterion=det,over=position]",
        "ekf-split-ci",
        "ekf-ici",
        "ekf-ici[form=fixed]",
        "ekf-hmd",
        "ekf-event-ci",
        "ekf-gs-ci",
        "ekf-luft",
        "ekf-interim",
        "ukf-joint",
    ],
)
def test_batched_is_filterpy(label, robots):
    ticks = 4 if robots == 10 else 20
    for world in (f"scalability/n={robots}", f"camera/n={robots}"):
        _, stream = simulate(world, trials=1 if robots == 10 else 2, seed=26, ticks=ticks)
        batched, loop = (make(label, engine=engine) for engine in ("batched", "filterpy"))
        traces = run({"batched": batched, "filterpy": loop}, stream).traces
        np.testing.assert_allclose(traces["batched"].x, traces["filterpy"].x, atol=1e-9)
        np.testing.assert_allclose(traces["batched"].P, traces["filterpy"].P, atol=1e-9)


@pytest.mark.slow
def test_interim_master_is_filterpys_under_losses_too():
    _, stream = simulate("packet-drop/drop=0.7", trials=3, seed=26, ticks=60)
    batched, loop = (trace(engine, EkfInterim(engine=engine), stream) for engine in ("batched", "filterpy"))
    np.testing.assert_allclose(batched.x, loop.x, atol=1e-9)
    np.testing.assert_allclose(batched.P, loop.P, atol=1e-9)


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
    broken = trace("broken", EkfInterim(), stream.replace_arrays({"air.link": link}))
    off = np.abs(broken.x - traces["joint"].x)[0].max(-1)
    assert off[:lost].max() < 1e-9
    assert off[lost, [a, b]].max() < 1e-9
    assert off[lost, 3 - a - b] > 1e-9
    assert off[lost:].max() > 1e-3
    np.testing.assert_allclose(traces["whole"].x, traces["joint"].x, atol=1e-9)


@pytest.mark.parametrize("name", ["luft", "interim"])
def test_pairwise_protocols_need_both_directions(name):
    """No robot hears robot 0: only robot 0 may notice what it sees, and no robot answers it."""
    _, stream = simulate("camera", trials=2, seed=30, ticks=60)
    link = stream.air.link.copy()
    link[..., 0] = False  # axis 2 is the receiver, axis 3 the sender
    stream = stream.replace_arrays({"air.link": link})
    sighting = stream.senses.sighting.copy()
    sighting[:, :, 0] = np.nan
    sighting[:, :, :, 0] = np.nan
    blind = stream.replace_arrays({"senses.sighting": sighting})
    a, b = trace("a", TEAM[name], stream), trace("b", TEAM[name], blind)
    np.testing.assert_array_equal(a.x[:, :, 1:], b.x[:, :, 1:])
    np.testing.assert_array_equal(a.P[:, :, 1:], b.P[:, :, 1:])


@pytest.mark.parametrize(
    "estimator",
    [EkfJoint(), EkfJoint(**PLAIN), EkfNaive(), EkfLuft(), EkfSplitCi(), EkfInterim()],
    ids=["joint-batch", "joint-plain", "naive", "luft", "split-ci", "interim"],
)
@pytest.mark.slow
def test_covariances_stay_definite_over_ten_thousand_ticks(estimator):
    """Without landmarks, so that what is shared grows while what is relative stays small."""
    _, stream = simulate("camera/n=2", seed=31, ticks=10_000)
    stream = without(stream, landmark=True)
    if isinstance(estimator, EkfJoint):
        for _, s in exchanges(estimator, stream)[::50]:
            P = s.P.reshape(6, 6)
            np.testing.assert_allclose(P, P.T, rtol=1e-12, atol=1e-12 * P.max())
            assert np.linalg.eigvalsh(P).min() > 0
    else:
        P = trace("long", estimator, stream).P
        np.testing.assert_allclose(P, P.mT, rtol=1e-12, atol=1e-12 * P.max())
        assert np.linalg.eigvalsh(P).min() > 0


@pytest.mark.parametrize("name", TEAM)
def test_gate_refuses_outliers(name):
    _, stream = linear_team(seed=33, trials=1, robots=2, ticks=1, share=1.0)
    stream = stream.replace_arrays({f"senses.{c}": getattr(stream.senses, c) + 300.0 for c in ("landmark", "sighting")})
    cls = type(TEAM[name])
    traces = run({"dead": DeadReckoning(), "gated": cls(), "open": cls(gate=np.inf)}, stream).traces
    np.testing.assert_allclose(traces["gated"].x, traces["dead"].x, atol=1e-9)
    np.testing.assert_allclose(traces["gated"].P, traces["dead"].P, atol=1e-9)
    assert np.abs(traces["open"].x - traces["dead"].x).max() > 10


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

"""CTRN and EKF-CI: without teammates equal to what they build on, with them to covariance intersection by hand."""

import numpy as np
import pytest
from oracles import covariances

import cooploc as cl
from cooploc.estimators import ctrn as by_moments
from cooploc.estimators.ctrn import follow, silence_singular
from cooploc.estimators.interface import Belief, Mail, Rows, Senses, World
from cooploc.estimators.models import Displacement, LogDistance, Range
from cooploc.estimators.particles import moments, weights
from cooploc.scenarios.runner.trace import trace

SMALL = {"particles": 60, "weights": "exact"}


def by_hand(x, P, x_j, P_j, z, sigma, grid=500):
    """Least position trace over a fine grid of w: the joint of two inflated positions, updated by a range, in full."""
    best = np.trace(P), x, P
    d = np.linalg.norm(x - x_j)
    u = (x - x_j) / d
    H = np.concatenate([u, -u])[None]
    for w in np.linspace(0.001, 0.999, grid):
        joint = np.zeros((4, 4))
        joint[:2, :2], joint[2:, 2:] = P / w, P_j / (1 - w)
        K = joint @ H.T / (H @ joint @ H.T + sigma**2)
        after = joint - K @ H @ joint
        if np.trace(after[:2, :2]) < best[0]:
            best = np.trace(after[:2, :2]), x + K[:2, 0] * (z - d), after[:2, :2]
    return best[1:]


@pytest.mark.slow
def test_moments_are_covariance_intersection_by_hand():
    """Two robots: every fused mean and covariance against a scan that shares no code with them."""
    _, stream = cl.simulate("robots-1-3/n=2", trials=6, seed=4, ticks=8)
    fused = []

    def watch(method, tick, arguments, call):
        result = call(*arguments)
        if method == "fuse" and tick in (2, 4, 7):
            fused.append((arguments[0].own, arguments[2], result.own.belief))
        return result

    trace("ctrn", cl.make("ctrn", weights="exact", particles=2000), stream, watch)
    gained = 0
    for mine, mail, got in fused:
        x, P = moments(mine.x, weights(mine.logw))
        for row in range(len(x)):
            sender = 1 - row % 2
            packet, z = mail.packets[row, sender], mail.range[row, sender]
            P_j = np.array([[packet[2], packet[3]], [packet[3], packet[4]]])
            expected_x, expected_P = by_hand(x[row], P[row], packet[:2], P_j, z, 0.1)
            assert np.trace(got.P[row]) == pytest.approx(np.trace(expected_P), rel=1e-5)
            np.testing.assert_allclose(got.P[row], expected_P, rtol=0.02, atol=1e-3)
            np.testing.assert_allclose(got.x[row], expected_x, atol=5e-3)
            gained += np.trace(expected_P) < 0.995 * np.trace(P[row])
    assert gained >= 3


def test_particles_follow_to_exactly_the_new_moments():
    rng = np.random.default_rng(0)
    for d in (2, 3):
        x, w = 0.1 * rng.normal(size=(5, 200, d)), rng.dirichlet(np.ones(200), 5)
        before = moments(x, w)
        root = rng.normal(size=(5, d, d))
        after = Belief(before.x + 0.1 * rng.normal(size=(5, d)), 0.001 * root @ root.mT + 0.005 * np.eye(d))
        after.x[2], after.P[2] = before.x[2], before.P[2]
        moved = follow(x, before, after)
        got = moments(moved, w)
        np.testing.assert_allclose(got.P, after.P, atol=1e-12)
        np.testing.assert_allclose(got.x[:, :2], after.x[:, :2], atol=1e-12)
        np.testing.assert_array_equal(moved[2], x[2])


# ------------------------------------------------------------------ the compiled chain

SENSORS = {"range": Range(), "rssi": LogDistance()}


def meeting(rng, reading, d, r=400, n=7):
    """Robots that hear each other, some of them badly: a state, its mail, and moments to start from."""
    world = World(n, 1.0, np.array([[0, 0], [20, 20]]), Displacement(), {f"radio_{reading}": SENSORS[reading]})
    P = covariances(rng, r, d=d) * 10 ** rng.uniform(-3, 0, (r, 1, 1))
    P[:20] = np.eye(d) * 10 ** rng.uniform(-12, 0, (20, 1, d))  # in different units
    P[20], P[21], P[22] = 0.0, np.ones((d, d)), np.diag([1.0, 1e-13, 1.0][:d])  # collapsed
    P[60:80] = np.diag([1e4, 1e-6, 1.0][:d])
    before = Belief(rng.uniform(0, 20, (r, d)), (P + P.mT) / 2)
    x_j, P_j = rng.uniform(0, 20, (r, n, 2)), covariances(rng, r, n, d=2) * 10 ** rng.uniform(-6, 1, (r, n, 1, 1))
    x_j[60:80], P_j[60:80] = before.x[60:80, None, :2] + [5.0, 0.0], 1e-3 * np.eye(2)  # along the thin belief
    x_j[30] = before.x[30, :2]  # at the same place
    packets = np.concatenate([x_j, P_j[..., 0, :], P_j[..., 1, 1:]], -1)
    packets[40, :, 2:] = np.inf, 0.0, np.inf  # knows nothing
    distance = np.linalg.norm(before.x[:, None, :2] - x_j, axis=-1)
    z = distance + 0.3 * rng.normal(size=(r, n)) if reading == "range" else -40 - 30 * np.log10(distance + 0.1)
    heard = rng.uniform(size=(r, n)) < 0.8
    packets[~heard], z = np.nan, np.where(heard, z, np.nan)
    packets[50, :, 3], packets[51, :, 0] = np.nan, np.nan  # a part is enough
    rows = Rows(np.arange(r) // n, np.arange(r) % n, rng.integers(0, 2**32, (r, 2), dtype=np.uint32))
    mail = Mail(heard, packets, *(z if reading == kind else z * np.nan for kind in ("rssi", "range")))
    return world, rows, before, mail


@pytest.mark.parametrize("reading", SENSORS)
@pytest.mark.parametrize("criterion", ["trace", "det"])
@pytest.mark.parametrize("d", [2, 3])
def test_the_compiled_chain_is_the_steps_one_by_one(reading, criterion, d):
    world, rows, before, mail = meeting(np.random.default_rng(4), reading, d)
    ctrn = cl.make("ctrn", reading=reading, criterion=criterion, anchor_reading="rssi", **SMALL)
    s, z = ctrn.init(before, world, rows), Senses(*np.empty((6, 0)))
    chained, fusions = by_moments.chain(before, SENSORS[reading], mail.packets, getattr(mail, reading), criterion)
    stepped, with_steps = by_moments.step_by_step(ctrn, s, before, z, mail)
    size = np.abs(before.P).max((1, 2)) + 1e-300
    np.testing.assert_allclose(chained.P / size[:, None, None], stepped.P / size[:, None, None], atol=1e-12)
    np.testing.assert_allclose(chained.x, stepped.x, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(fusions, with_steps.fusions)
    assert fusions.sum() > 300
    same = (chained.P == before.P).all((1, 2))
    assert same.sum() > 10
    assert (~same).sum() > 200
    for row in (20, 21, 22, 40, 50, 51):
        np.testing.assert_array_equal(chained.P[row], before.P[row])


@pytest.mark.parametrize("label", ["trajectory", "no-compass/n=3"])
def test_what_is_received_is_never_fed_back_nor_sent_on(label):
    """Packets are those of a robot that hears no other."""
    sent = {0.0: [], 1.0: []}
    for drop, packets in sent.items():

        def watch(method, tick, arguments, call, packets=packets):
            result = call(*arguments)
            if method == "send":
                packets.append(result)
            return result

        _, stream = cl.simulate(label, trials=2, seed=5, ticks=20, drop=drop)
        trace("ctrn", cl.make("ctrn", fusion="received", **SMALL), stream, watch)
    np.testing.assert_array_equal(sent[0.0], sent[1.0])


def test_what_was_received_moves_as_the_robot_does_until_it_hears_more():
    _, stream = cl.simulate("trajectory", trials=1, seed=5, ticks=6, drop=0.0)
    link, received = stream.air.link.copy(), []
    link[:, 1:] = False

    def watch(method, tick, arguments, call):
        result = call(*arguments)
        if method == "fuse":
            received.append(result.received)
        return result

    trace("ctrn", cl.make("ctrn", fusion="received", **SMALL), stream.replace_arrays({"air.link": link}), watch)
    first, last = received[0], received[-1]
    driven = stream.senses.odometry[0, 1:].sum(0)
    _, _, Q = stream.world.motion.move(first.x[:, 0], stream.senses.odometry[0, 1], stream.senses.dt[0, 1])
    np.testing.assert_allclose(last.x - first.x, np.where(np.isnan(first.x), np.nan, driven[:, None]), atol=1e-12)
    np.testing.assert_allclose((last.P - first.P)[0, 1], 5 * Q[0])


def test_cvxpy_and_exact_weights_agree():
    _, stream = cl.simulate("trajectory", trials=2, seed=6, ticks=15)
    exact = cl.run({"c": cl.make("ctrn", **SMALL)}, stream).traces["c"]
    assert exact.notes["fusions"].sum() == 2 * 3 * 2 * 15
    cvxpy = cl.run({"c": cl.make("ctrn", particles=60)}, stream).traces["c"]
    assert cvxpy.notes["fallbacks"].sum() == 0
    np.testing.assert_allclose(cvxpy.x[:, 0], exact.x[:, 0], atol=1e-3)


@pytest.mark.parametrize("label", ["trajectory[drop=1.0]", "robots-1-3/n=1", "camera/n=2[drop=1.0]"])
def test_ekf_ci_without_teammates_is_the_local_ekf(label):
    _, stream = cl.simulate(label, trials=2, seed=8, ticks=20)
    run = cl.run({"local": cl.make("ekf-local"), "ci": cl.make("ekf-ci")}, stream).traces
    np.testing.assert_allclose(run["ci"].x, run["local"].x, atol=1e-12)
    np.testing.assert_allclose(run["ci"].P, run["local"].P, atol=1e-12)


def test_a_robot_whose_particles_have_collapsed_is_silent():
    P = [(1.0, 0.0, 1.0), (1.0, 0.0, 1e-9), (0.0, 0.0, 0.0), (1.0, 2.0, 4.0), (1.0, 0.0, 0.0)]
    packets = np.array([(2.0, 3.0, *each) for each in P])
    np.testing.assert_array_equal(silence_singular(packets), np.concatenate([packets[:2], np.full((3, 5), np.nan)]))

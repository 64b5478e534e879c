"""The filters of CoLo (T.-K. Chang's repository): the equations written out robot by robot, on whole matrices."""

import numpy as np
import pytest
from oracles import linear_team, nees

from cooploc.estimators.ekf_gs_ci import EkfGsCi
from cooploc.estimators.ekf_luft import EkfLuft
from cooploc.scenarios.runner.trace import trace

inv = np.linalg.inv


def noise_of_moves(stream, trial, k, i):
    return 0.3**2 / 0.5 * stream.senses.dt[trial, k, i] * np.eye(2)


def at(robot):
    return slice(2 * robot, 2 * robot + 2)


def pick(n, robot):
    """The matrix (2, 2 n) that takes one robot's position out of all."""
    return np.eye(2 * n)[at(robot)]


def kalman_step(x, P, y, H, R):
    K = P @ H.T @ inv(H @ P @ H.T + R)
    return x + K @ y, P - K @ H @ P


def gs_ci(stream, trial, weight, drift, period):
    """Positions (T, n, 2) and covariances (T, n, 2, 2), each robot's of itself."""
    n, z, R = stream.robots, stream.senses, stream.world.sensors["sighting"].R
    x = [np.zeros(2 * n) for _ in range(n)]  # the middle of the arena, whose side is 18 m
    P = [18**2 / 12 * np.eye(2 * n) for _ in range(n)]
    means, covariances, silent = [], [], np.full(n, np.inf)
    for i in range(n):
        x[i][at(i)], P[i][at(i), at(i)] = stream.prior.x[trial, i], stream.prior.P[trial, i]
    for k in range(z.dt.shape[1]):
        for i in range(n):
            x[i][at(i)] += z.odometry[trial, k, i]
            for j in range(n):
                others = drift**2 * z.dt[trial, k, i] * np.eye(2)
                P[i][at(j), at(j)] += noise_of_moves(stream, trial, k, i) if i == j else others
            for place, reading in zip(stream.world.landmarks, z.landmark[trial, k, i], strict=True):
                if np.isfinite(reading).all():
                    H = pick(n, i)
                    x[i], P[i] = kalman_step(x[i], P[i], reading - (H @ x[i] - place), H, R)
        sent = [(x[i].copy(), P[i].copy()) for i in range(n)]
        silent += z.dt[trial, k]
        speaks = silent >= period
        silent[speaks] = 0
        for i in range(n):
            for j in range(n):
                if stream.air.link[trial, k, i, j] and i != j and speaks[j]:
                    x_j, P_j = sent[j]
                    C = inv(weight * inv(P[i]) + (1 - weight) * inv(P_j))
                    x[i] = C @ (weight * inv(P[i]) @ x[i] + (1 - weight) * inv(P_j) @ x_j)
                    P[i] = C
            for j in range(n):
                reading = z.sighting[trial, k, i, j]
                if np.isfinite(reading).all() and np.trace(P[i][at(j), at(j)]) < 18**2 / 12:
                    H = pick(n, i) - pick(n, j)
                    x[i], P[i] = kalman_step(x[i], P[i], reading - H @ x[i], H, R)
        means.append([x[i][at(i)].copy() for i in range(n)])
        covariances.append([P[i][at(i), at(i)].copy() for i in range(n)])
    return np.array(means), np.array(covariances)


@pytest.mark.parametrize(("weight", "period"), [(0.8, 0.0), (0.5, 0.0), (0.8, 1.9), (1.0, 0.0)])
def test_the_global_state_filter_is_its_equations_robot_by_robot(weight, period):
    _, stream = linear_team(seed=1, trials=2, robots=4, ticks=10)
    rng = np.random.default_rng(2)
    stream = stream.replace_arrays({"air.link": stream.air.link & (rng.uniform(size=stream.air.link.shape) < 0.6)})
    got = trace("gs", EkfGsCi(weight=weight, drift=0.7, period=period, gate=np.inf), stream)
    for trial in range(2):
        x, P = gs_ci(stream, trial, weight, 0.7, period)
        np.testing.assert_allclose(got.x[trial], x, atol=1e-8)
        np.testing.assert_allclose(got.P[trial], P, atol=1e-8)


def ls_bda(stream, trial):
    """One matrix of the team. A pair is updated exactly; its cross terms with others follow as Sigma' Sigma^-1."""
    n, z, R = stream.robots, stream.senses, stream.world.sensors["sighting"].R
    x, P = stream.prior.x[trial].ravel().copy(), np.zeros((2 * n, 2 * n))
    means, covariances = [], []
    for i in range(n):
        P[at(i), at(i)] = stream.prior.P[trial, i]

    def carry(robots, before):
        """The cross terms of `robots` with all others."""
        for i in robots:
            M = P[at(i), at(i)] @ inv(before[at(i), at(i)])
            for k in set(range(n)) - set(robots):
                P[at(i), at(k)] = M @ P[at(i), at(k)]
                P[at(k), at(i)] = P[at(i), at(k)].T

    def update(robots, y, H):
        """An update of the state of `robots` alone, H (2, 2 n)."""
        before, block = P.copy(), np.concatenate([np.arange(2 * i, 2 * i + 2) for i in robots])
        grid = np.ix_(block, block)
        x[block], P[grid] = kalman_step(x[block], P[grid], y, H[:, block], R)
        carry(robots, before)

    for k in range(z.dt.shape[1]):
        for i in range(n):
            x[at(i)] += z.odometry[trial, k, i]
            P[at(i), at(i)] += noise_of_moves(stream, trial, k, i)
            for place, reading in zip(stream.world.landmarks, z.landmark[trial, k, i], strict=True):
                if np.isfinite(reading).all():
                    update([i], reading - (x[at(i)] - place), pick(n, i))
        for j in range(n):
            for i in range(n):
                reading = z.sighting[trial, k, i, j]
                if np.isfinite(reading).all():
                    update([i, j], reading - (x[at(i)] - x[at(j)]), pick(n, i) - pick(n, j))
        means.append(x.reshape(n, 2).copy())
        covariances.append(np.stack([P[at(i), at(i)] for i in range(n)]))
    return np.array(means), np.array(covariances)


@pytest.mark.parametrize("robots", [2, 4])
def test_lufts_filter_is_what_colo_calls_ls_bda(robots):
    """Few readings, so that no correlation comes near the limit that our filter has and CoLo's has not."""
    _, stream = linear_team(seed=3, trials=3, robots=robots, ticks=10, share=0.2)
    got = trace("luft", EkfLuft(gate=np.inf), stream)
    for trial in range(3):
        x, P = ls_bda(stream, trial)
        np.testing.assert_allclose(got.x[trial], x, atol=1e-8)
        np.testing.assert_allclose(got.P[trial], P, atol=1e-8)


def test_the_global_state_filter_is_conservative_where_the_drift_covers_the_motion():
    """Of 300 linear teams, whose robots move by about 1 m in a tick of 0.2 to 2 s."""
    x, stream = linear_team(seed=4, trials=300, robots=3, ticks=10)
    got = trace("gs", EkfGsCi(drift=2.5, gate=np.inf), stream)
    assert nees(x, got).mean((0, 2)).max() < 1.1

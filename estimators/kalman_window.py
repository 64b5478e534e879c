"""A sliding window over a team's last states: its log-posterior, its Kalman smoother, and a second place to start.

All is linearised at the window's own states; the past before it is one Gaussian. A tick's two RSSI readings of a pair
count as one, as shadowing is the same in both directions.

Sources: B. Bell, "The iterated Kalman smoother as a Gauss-Newton method", SIAM J. Optimization 4(3), 1994; A. Bryson,
M. Frazier, "Smoothing for linear and nonlinear dynamic systems", TDR 63-119, Wright-Patterson AFB, 1963 (the way back).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Belief, Mail, Senses, World
from cooploc.estimators.joint_gaussian import block_diagonal, flat, square
from cooploc.estimators.kalman import root, symmetric
from cooploc.estimators.models import wrap_heading

inverse: Any = np.linalg.inv


class Window(NamedTuple):
    """The team's last l states, oldest first, and everything that was read in them."""

    x: Array  # (t, l, n, d)  most probable states
    P: Array  # (t, n d, n d)  covariance of the newest
    past: Belief  # x (t, n d), P (t, n d, n d)  of the state before the window, from the readings up to then
    at: Array  # (t, n, d)  where the past was linearised
    young: bool  # nothing has left the window yet
    z: Senses  # (t, l, n, ...)
    air: Mail  # (t, l, n, n)
    world: World

    @property
    def last(self) -> Array:
        """The newest states (t, n, d)."""
        return self.x[:, -1] if self.x.shape[1] else self.at


def empty(prior: Belief, world: World) -> Window:
    """Return the window before tick 0."""
    t, n, d = prior.x.shape
    past = Belief(flat(prior.x), square(block_diagonal(prior.P)))
    none = np.empty((t, 0))
    z, air = Senses(none, none, none, none, none, {}), Mail(none.astype(bool), none, none, none)
    return Window(np.empty((t, 0, n, d)), past.P, past, prior.x, True, z, air, world)


def append_tick(s: Window, z: Senses) -> Window:
    """Add a new state x' = f(x, u) at the end, and what was sensed there."""
    newest, _, _ = s.world.motion.move(s.last, z.odometry, z.dt)
    past = s.z if s.z.extra else s.z._replace(extra=dict.fromkeys(z.extra, s.z.dt))  # before tick 0 all are empty
    return s._replace(x=append(s.x, newest), z=map_senses(append, past, z))


def drop_oldest(s: Window, oldest: Belief) -> Window:
    """Drop the oldest state, whose belief becomes the past."""
    z = map_senses(lambda readings: readings[:, 1:], s.z)
    air = s.air._replace(**{name: getattr(s.air, name)[:, 1:] for name in Mail._fields})
    return s._replace(x=s.x[:, 1:], z=z, air=air, past=oldest, at=s.x[:, 0], young=False)


def map_senses(f: Callable[..., Array], *senses: Senses) -> Senses:
    """Return senses whose every array, in `extra` too, is `f` of those of the given ones."""
    extra = {name: f(*(z.extra[name] for z in senses)) for name in senses[0].extra}
    arrays = {name: f(*(getattr(z, name) for z in senses)) for name in Senses._fields if name != "extra"}
    return Senses(**arrays, extra=extra)


def cost(s: Window) -> Array:
    """Return -2 log of the posterior density of the window's states (t,), up to a constant."""
    _, x_moved, F, Q = _linearise(s)
    off = wrap_heading(s.x - x_moved).reshape(*s.x.shape[:2], -1)
    first = off[:, 0] - times(F[:, 0], _subtract(s.past.x, flat(s.at), s.x.shape[-1]))
    # A robot that sleeps moves without noise: pinv.
    total = _squared_norm(first, np.linalg.pinv(F[:, 0] @ s.past.P @ F[:, 0].mT + Q[:, 0]))
    total = total + _squared_norm(off[:, 1:], np.linalg.pinv(Q[:, 1:])).sum(1)
    for sensor, place, reading in s.world.fixed(s.z):
        y, _, _ = sensor.innovation(s.x, place, reading)
        total = total + np.nansum(_squared_norm(y, inverse(sensor.R)), (1, 2))
    for sensor, j, reading in s.world.relative(s.z, _average_directions(s.air)):
        y, _, _ = sensor.innovation(s.x, s.x[:, :, j, None, :2], reading)
        total = total + np.nansum(_squared_norm(y, inverse(sensor.R)), (1, 2))
    return np.asarray(total)


def second_start(s: Window) -> Window:
    """Return the window with each robot's track shifted, by up to 3 sigma, to where its own readings fit best."""
    t, n, d = s.at.shape
    P = np.stack([s.past.P.reshape(t, n, d, n, d)[:, i, :2, i, :2] for i in range(n)], 1)
    grid = np.stack(np.meshgrid(*[np.linspace(-3, 3, 13)] * 2, indexing="ij"), -1).reshape(-1, 1, 1, 2)
    shift = times(root(P), grid)  # (g, t, n, 2)
    x = np.broadcast_to(s.x, (len(grid), *s.x.shape)).copy()
    x[..., :2] += shift[:, :, None]
    total = np.broadcast_to((grid**2).sum(-1), (len(grid), t, n)).copy()
    for sensor, place, reading in s.world.fixed(s.z):
        y, _, _ = sensor.innovation(x, place, reading)
        total += np.nansum(_squared_norm(y, inverse(sensor.R)), 2)
    best = total.argmin(0)
    x = s.x.copy()
    x[..., :2] += np.take_along_axis(shift, best[None, ..., None], 0)[0][:, None]
    return s._replace(x=x)


class Smoothed(NamedTuple):
    """The result of one Kalman smoother over a window."""

    x: Array  # (t, l, n, d)  the new states
    filtered: list[Belief]  # of each state from the readings up to it: x (t, n d), P (t, n d, n d)
    F: Array  # (t, l, n d, n d)
    weights: list[Array]  # A (t, n d, n d) of each state
    Lambda: Array  # (t, l, n d, n d)  information of each state's readings

    @property
    def P(self) -> Array:
        """Return the covariance (t, l, n d, n d) of every state, given all readings of the window.

        P = P_f - P_f M P_f,  M = F' M' F of the next state,  M' = A (Lambda + M A').
        """
        P, M = [], np.zeros_like(self.filtered[-1].P)
        for k in reversed(range(len(self.filtered))):
            P_f, A = self.filtered[k].P, self.weights[k]
            P.append(symmetric(P_f - P_f @ M @ P_f))
            M = self.F[:, k].mT @ symmetric(A @ (self.Lambda[:, k] + M @ A.mT)) @ self.F[:, k]
        return np.stack(P[::-1], 1)


def smooth_window(s: Window) -> Smoothed:
    """Smooth by all readings, linearised at s.x."""
    return smooth(s, *information(s))


def smooth(s: Window, eta: Array, Lambda: Array) -> Smoothed:
    """Smooth by readings of eta = sum H'R^-1 y (t, l, n d), Lambda = sum H'R^-1 H (t, l, n d, n d), taken at s.x.

    Forth:  A = (I + Lambda P_p)^-1,  P = P_p A,  x_f = x_p + P g,  g = eta + Lambda (s.x - x_p).
    Back:   x = x_f + P F' l',  l = A (g + F' l').  P_p is not inverted: it may be singular where a robot is certain.
    """
    length, d = s.x.shape[1], s.x.shape[-1]
    at, x_moved, F, Q = _linearise(s)
    belief, filtered, pulls, weights = s.past, [], [], []
    for k in range(length):
        mean = flat(x_moved[:, k]) + times(F[:, k], _subtract(belief.x, flat(at[:, k]), d))
        P = symmetric(F[:, k] @ belief.P @ F[:, k].mT + Q[:, k])
        weights.append(inverse(np.eye(P.shape[-1]) + Lambda[:, k] @ P))
        pulls.append(eta[:, k] + times(Lambda[:, k], _subtract(flat(s.x[:, k]), mean, d)))
        P = symmetric(P @ weights[k])
        belief = Belief(mean + times(P, pulls[k]), P)
        filtered.append(belief)
    x, later = [], np.zeros_like(belief.x)  # F' l' of the next state
    for k in reversed(range(length)):
        x.append(filtered[k].x + times(filtered[k].P, later))
        later = times(F[:, k].mT, times(weights[k], pulls[k] + later))
    return Smoothed(np.stack(x[::-1], 1).reshape(s.x.shape), filtered, F, weights, Lambda)


def _linearise(s: Window) -> tuple[Array, Array, Array, Array]:
    """Return the states before each move (t, l, n, d), those after it, F and Q of the whole team (t, l, n d, n d)."""
    t, length, n, d = s.x.shape
    at = np.concatenate([s.at[:, None], s.x[:, :-1]], 1)
    x_moved, F, Q = s.world.motion.move(at, s.z.odometry, s.z.dt)
    F, Q = (square(block_diagonal(a.reshape(-1, n, d, d))).reshape(t, length, n * d, n * d) for a in (F, Q))
    return at, x_moved, F, Q


def _subtract(a: Array, b: Array, d: int) -> Array:
    """Return a - b of flat states (t, n d), headings wrapped."""
    return flat(wrap_heading((a - b).reshape(len(a), -1, d)))


def information(s: Window) -> tuple[Array, Array]:
    """Return eta = sum H'R^-1 y (t, l, n d), Lambda = sum H'R^-1 H (t, l, n d, n d) of all readings at s.x."""
    x, (t, length, n, d) = s.x, s.x.shape
    eta, Lambda = np.zeros(x.shape), np.zeros((t, length, n, d, n, d))
    own = np.arange(n)
    for sensor, place, reading in s.world.fixed(s.z):
        y, H, _ = sensor.innovation(x, place, reading)
        y, W = _weigh(y, sensor.R, H)
        eta += times(W, y)
        Lambda[:, :, own, :, own] += np.moveaxis(W @ H, 2, 0)
    for sensor, j, reading in s.world.relative(s.z, _average_directions(s.air)):
        y, H, Hq = sensor.innovation(x, x[:, :, j, None, :2], reading)
        H_j = np.concatenate([Hq, np.zeros((*Hq.shape[:-1], d - 2))], -1)
        y, W, W_j = _weigh(y, sensor.R, H, H_j)
        eta += times(W, y)
        eta[:, :, j] += times(W_j, y).sum(2)
        Lambda[:, :, own, :, own] += np.moveaxis(W @ H, 2, 0)
        Lambda[:, :, j, :, j] += (W_j @ H_j).sum(2)
        between = W @ H_j  # (t, l, n, d, d)
        Lambda[:, :, :, :, j] += between
        Lambda[:, :, j] += between.transpose(0, 1, 4, 2, 3)
    return eta.reshape(t, length, n * d), Lambda.reshape(t, length, n * d, n * d)


def _weigh(y: Array, R: Array, *Hs: Array) -> list[Array]:
    """Return the innovation y (..., k) and H' R^-1 (..., d, k) of each Jacobian, 0 where there is no reading."""
    there, weight = np.asarray(~np.isnan(y).any(-1)), inverse(R)
    return [np.where(there[..., None], y, 0.0), *(np.where(there[..., None, None], H.mT @ weight, 0.0) for H in Hs)]


def _average_directions(air: Mail) -> Mail:
    """Return each pair's RSSI once: the mean of both directions, held by the robot of the smaller number."""
    if not air.rssi.shape[-1]:
        return air
    both = np.stack([air.rssi, air.rssi.swapaxes(-1, -2)])
    count = (~np.isnan(both)).sum(0)
    mean = np.where(count > 0, np.nansum(both, 0) / np.maximum(count, 1), np.nan)
    n = mean.shape[-1]
    return air._replace(rssi=np.where(np.triu(np.ones((n, n), bool), 1), mean, np.nan))


def append(window: Any, newest: Any) -> Any:
    """Return a window (t, l, ...) with one more entry at its end; an empty one takes the entry's shape."""
    return np.concatenate([window, newest[:, None]], 1) if window.shape[1] else newest[:, None].copy()


def _squared_norm(y: Array, information: Any) -> Array:
    """Return y' M y of vectors (..., k)."""
    return np.asarray((y * times(information, y)).sum(-1))


def times(A: Array, x: Array) -> Array:
    """Return A x of matrices (..., m, k) and vectors (..., k)."""
    return np.asarray((A @ x[..., None])[..., 0])

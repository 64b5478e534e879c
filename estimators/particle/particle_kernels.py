"""The compiled passes of steps.py over rows, each row by itself, in buffers.

Python hands a NamedTuple over as `tuple(...)`: numba needs a microsecond to recognise each NamedTuple of a call.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cooploc.estimators.compiled import random_numbers
from cooploc.estimators.compiled.elementary_functions import exp
from cooploc.estimators.compiled.formats import is_single, ordered
from cooploc.estimators.compiled.jit import inlined, kernel, wide
from cooploc.estimators.compiled.row_buffers import extent, fill, load, row_buffer, store
from cooploc.estimators.interface import Array, Indices, Keys, Mask
from cooploc.estimators.particle.link_kernels import NUMBERS, add_anchors, add_teammates, load_row, row_of
from cooploc.estimators.particle.resampling import mark_ancestors

BANDWIDTH = 0.3  # h of Liu and West's kernel, times n^(-1/6)


class Cloud(NamedTuple):
    """The particles of all rows."""

    x: Array  # (2 r, n)  x of a row, then y [m]
    logw: Array  # (r, n)
    due: Mask  # (r,)  rows to renew


class Moved(NamedTuple):
    """The particles of all rows after a step, to be written."""

    x: Array  # (2 r, n) [m]
    logw: Array  # (r, n)


class Step(NamedTuple):
    """How particles move in a tick, and their random numbers."""

    u: Array  # (r, 2) [m], nan where absent
    sd: Array  # (r,) [m]
    key: Keys  # (r, 2)
    counter: int  # of the tick's first random number


class Scratch(NamedTuple):
    """What renewing a row needs."""

    w: Array  # (n,)  weights
    east: Array  # (n,)  noise
    north: Array
    copies: Indices  # (n,)
    marks: Indices  # (n + 1,)
    words: NDArray[np.uint32]  # (2, n)
    renewed: Array  # (2, n)


@kernel
def advance_rows(cloud, step, anchors, sends, out, belief):
    """`steps.advance` of a cloud into `out`, and where it sends into the belief."""
    wide()
    (x, logw, due), (u, sd, key, counter), (x_out, logw_out) = cloud, step, out
    n, links = logw.shape[1], np.empty((len(anchors[0]), NUMBERS), logw.dtype)
    row, w = row_of(logw), row_buffer(logw)
    marks, words = np.empty(n + 1, np.int64), np.empty((2, len(w)), np.uint32)
    renewed = np.empty((2, n), logw.dtype)
    scratch = Scratch(w, row_buffer(logw), row_buffer(logw), np.empty(n, np.int64), marks, words, renewed)
    for r in range(len(logw)):
        k = np.int64(key[r, 0]), np.int64(key[r, 1])
        load(logw, r, row.logw)
        if due[r]:
            load(x, 2 * r, row.X)
            load(x, 2 * r + 1, row.Y)
            _renew(row, k, counter - random_numbers.PURPOSES, scratch)
        random_numbers.draw_words(k[0], k[1], counter + random_numbers.MOVE, words)
        random_numbers.normal_pairs(words, row.X, row.Y)
        if due[r]:
            fill(row.logw, 0, 0.0)
            west, east = _move(renewed, 0, u[r, 0], sd[r], row.X)
            south, north = _move(renewed, 1, u[r, 1], sd[r], row.Y)
        else:
            west, east = _move(x, 2 * r, u[r, 0], sd[r], row.X)
            south, north = _move(x, 2 * r + 1, u[r, 1], sd[r], row.Y)
        store(row.X, x_out, 2 * r)
        store(row.Y, x_out, 2 * r + 1)
        if len(links) > 0:
            add_anchors(row, (west, east, south, north), r, anchors, links)
        store(row.logw, logw_out, r)
        if sends:
            _moments_into(belief, r, row, n, w)


@inlined
def _move(rows, r, way, sd, noise):
    """One axis of a row's particles, in the place of the noise that moves them; their extent."""
    wide()
    n, real = rows.shape[1], rows.dtype.type
    way, sd = real(0.0 if np.isnan(way) else way), real(sd)
    low = high = ordered(rows[r, 0] + way + sd * noise[0])
    for i in range(n):
        noise[i] = rows[r, i] + way + sd * noise[i]
        low, high = min(low, ordered(noise[i])), max(high, ordered(noise[i]))
    fill(noise, n, noise[0])
    return ordered(low), ordered(high)


@inlined
def _renew(row, key, counter, scratch):
    """One row of `steps.renew`: m + shrink (x_a - m) + h L noise, L the Cholesky factor of P, which may be singular."""
    wide()
    (X, Y, _), (w, east, north, copies, marks, words, renewed) = row, scratch
    n = len(copies)
    h = BANDWIDTH * n ** (-1 / 6)
    shrink = np.sqrt(1 - h * h)
    total, _, mx, my, xx, xy, yy = _weighted_moments(row, n, w)
    u, _ = random_numbers.uniform_pair(key[0], key[1], counter + random_numbers.RESAMPLE, 0)
    mark_ancestors(w, total, u, copies, marks)
    random_numbers.draw_words(key[0], key[1], counter + random_numbers.JITTER, words)
    random_numbers.normal_pairs(words, east, north)
    mx, my = (1 - shrink) * mx, (1 - shrink) * my
    a = np.sqrt(max(xx, 0.0))
    b = xy / a if a > 0 else 0.0
    c = h * np.sqrt(max(yy - b * b, 0.0))
    real, a, b = X.dtype.type, h * a, h * b
    shrink, mx, my, a, b, c = real(shrink), real(mx), real(my), real(a), real(b), real(c)
    ancestor = 0
    for i in range(n):
        ancestor = max(ancestor, marks[i])
        j = np.uint64(ancestor)
        g0, g1 = east[i], north[i]
        renewed[0, i] = shrink * X[j] + (mx + a * g0)
        renewed[1, i] = shrink * Y[j] + (my + (b * g0 + c * g1))


@inlined
def _moments_into(belief, r, row, n, w):
    """Moments of a row into the belief; the sum of its weights and of their squares."""
    total, squares, mx, my, xx, xy, yy = _weighted_moments(row, n, w)
    mean, P = belief
    if is_single(total):  # rounding may leave a correlation above 1
        most = np.sqrt(np.float64(xx) * np.float64(yy))
        xy = min(max(xy, -most), most)
    mean[r, 0], mean[r, 1] = mx, my
    P[r, 0, 0], P[r, 0, 1], P[r, 1, 0], P[r, 1, 1] = xx, xy, xy, yy
    return total, squares


@inlined
def _weighted_moments(row, n, w):
    """Weights of a row of n into `w`, all equal where it is nothing but -inf; their sum, squares, and the moments."""
    wide()
    X, Y, logw = row
    fill(logw, n, -np.inf)
    _, top = extent(logw)
    zero = logw.dtype.type(0.0)
    if top == -np.inf:
        top = zero
        for i in range(n):
            logw[i] = zero
    if is_single(top):  # few digits: what all share is left out
        for i in range(len(logw)):
            logw[i] -= top
        top = zero
    total, squares, mx, my = zero, zero, zero, zero
    for i in range(len(logw)):
        w[i] = exp(logw[i] - top)
        total += w[i]
        squares += w[i] * w[i]
        mx += w[i] * X[i]
        my += w[i] * Y[i]
    mx, my = mx / total, my / total
    xx, xy, yy = zero, zero, zero
    for i in range(len(logw)):
        ex, ey = X[i] - mx, Y[i] - my
        xx += w[i] * (ex * ex)
        xy += w[i] * (ex * ey)
        yy += w[i] * (ey * ey)
    return total, squares, mx, my, xx / total, xy / total, yy / total


@kernel
def conclude_rows(x, logw, heard, belief, logw_out, due):
    """`steps.conclude` for particles x (2 r, n), into all that follows `heard`."""
    wide()
    n, links = logw.shape[1], np.empty((heard[1].shape[1], NUMBERS), logw.dtype)
    row, w = row_of(logw), row_buffer(logw)
    for r in range(len(logw)):
        load_row(x, 2, logw, r, row)
        add_teammates(row, r, heard, links)
        total, squares = _moments_into(belief, r, row, n, w)
        due[r] = total * total < n / 2 * squares
        store(row.logw, logw_out, r)

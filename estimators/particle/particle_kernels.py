"""The compiled passes of particles.py over rows, each row by itself, in scratch."""

import numpy as np

from cooploc.estimators.compiled import random_numbers
from cooploc.estimators.compiled.elementary_functions import exp, ordered
from cooploc.estimators.compiled.jit import inlined, kernel, wide
from cooploc.estimators.compiled.row_buffers import blank, extent, fill, give, take
from cooploc.estimators.particle import link_kernels, resampling

BANDWIDTH = 0.3  # h of Liu and West's kernel, times n^(-1/6)


@kernel
def advance_rows(  # type: ignore[no-untyped-def]
    x, logw, due, places, readings, A, slope, unit, u, sd, key, counter, tell, out, logw_out, mean, P
):
    """`particles.advance` for particles x (2 r, n) into `out` (2 r, n), and what follows it."""
    wide()
    n, links, ln_unit = logw.shape[1], np.empty((len(places), link_kernels.NUMBERS)), np.log(unit)
    X, Y, total, w = blank(n), blank(n), blank(n), blank(n)
    noise, count, marks = (blank(n), blank(n)), np.empty(n, np.int64), np.empty(n + 1, np.int64)
    renewed, words = np.empty((2, n)), np.empty((2, len(X)), np.uint32)
    for r in range(len(logw)):
        k0, k1 = np.int64(key[r, 0]), np.int64(key[r, 1])
        take(logw, r, total)
        if due[r]:
            take(x, 2 * r, X)
            take(x, 2 * r + 1, Y)
            _renew(X, Y, total, k0, k1, counter - random_numbers.PURPOSES, w, count, marks, words, noise, renewed)
        random_numbers.draw_words(k0, k1, counter + random_numbers.MOVE, words)
        random_numbers.normal_pairs(words, X, Y)
        if due[r]:
            fill(total, 0, 0.0)
            west, east = _moved(renewed, 0, u[r, 0], sd[r], X)
            south, north = _moved(renewed, 1, u[r, 1], sd[r], Y)
        else:
            west, east = _moved(x, 2 * r, u[r, 0], sd[r], X)
            south, north = _moved(x, 2 * r + 1, u[r, 1], sd[r], Y)
        give(X, out, 2 * r)
        give(Y, out, 2 * r + 1)
        if len(places) > 0:
            box = west, east, south, north
            link_kernels.add_anchors(X, Y, box, r, places, readings, A, slope, unit, ln_unit, links, total)
        give(total, logw_out, r)
        if tell:
            _weigh(X, Y, total, n, w, mean, P, r)


@inlined
def _moved(rows, r, way, sd, noise):  # type: ignore[no-untyped-def]
    """One axis of a row's particles, in the place of the noise that moves them; their extent."""
    wide()
    n, way = rows.shape[1], 0.0 if np.isnan(way) else way
    low = high = ordered(rows[r, 0] + way + sd * noise[0])
    for i in range(n):
        noise[i] = rows[r, i] + way + sd * noise[i]
        low, high = min(low, ordered(noise[i])), max(high, ordered(noise[i]))
    fill(noise, n, noise[0])
    return ordered(low), ordered(high)


@inlined
def _renew(X, Y, logw, k0, k1, counter, w, count, marks, words, noise, renewed):  # type: ignore[no-untyped-def]
    """One row of `renew`: m + shrink (x_a - m) + h L noise, L the Cholesky factor of P, which may be singular."""
    wide()
    n, (east, north) = len(count), noise
    h = BANDWIDTH * n ** (-1 / 6)
    shrink = np.sqrt(1 - h * h)
    total, _, mx, my, xx, xy, yy = _weighed(X, Y, logw, n, w)
    u, _ = random_numbers.uniform_pair(k0, k1, counter + random_numbers.RESAMPLE, 0)
    resampling.mark_ancestors(w, total, u, count, marks)
    random_numbers.draw_words(k0, k1, counter + random_numbers.JITTER, words)
    random_numbers.normal_pairs(words, east, north)
    mx, my = (1 - shrink) * mx, (1 - shrink) * my
    a = np.sqrt(max(xx, 0.0))
    b = xy / a if a > 0 else 0.0
    c = h * np.sqrt(max(yy - b * b, 0.0))
    a, b = h * a, h * b
    ancestor = 0
    for i in range(n):
        ancestor = max(ancestor, marks[i])
        j = np.uint64(ancestor)
        g0, g1 = east[i], north[i]
        renewed[0, i] = shrink * X[j] + (mx + a * g0)
        renewed[1, i] = shrink * Y[j] + (my + (b * g0 + c * g1))


@inlined
def _weigh(X, Y, logw, n, w, mean, P, r):  # type: ignore[no-untyped-def]
    """Moments of a row into mean and P; the sum of its weights and of their squares."""
    total, squares, mx, my, xx, xy, yy = _weighed(X, Y, logw, n, w)
    mean[r, 0], mean[r, 1] = mx, my
    P[r, 0, 0], P[r, 0, 1], P[r, 1, 0], P[r, 1, 1] = xx, xy, xy, yy
    return total, squares


@inlined
def _weighed(X, Y, logw, n, w):  # type: ignore[no-untyped-def]
    """Weights into `w` of a row of n, which starts again if it is nothing but -inf; their sum, squares, moments."""
    wide()
    fill(logw, n, -np.inf)
    _, top = extent(logw)
    if top == -np.inf:
        top = 0.0
        for i in range(n):
            logw[i] = 0.0
    total, squares, mx, my = 0.0, 0.0, 0.0, 0.0
    for i in range(len(logw)):
        w[i] = exp(logw[i] - top)
        total += w[i]
        squares += w[i] * w[i]
        mx += w[i] * X[i]
        my += w[i] * Y[i]
    mx, my = mx / total, my / total
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(len(logw)):
        ex, ey = X[i] - mx, Y[i] - my
        xx += w[i] * (ex * ex)
        xy += w[i] * (ex * ey)
        yy += w[i] * (ey * ey)
    return total, squares, mx, my, xx / total, xy / total, yy / total


@kernel
def conclude_rows(  # type: ignore[no-untyped-def]
    x, logw, packets, readings, ranged, A, slope, unit, gain, mean, P, logw_out, due
):
    """`particles.conclude` for particles x (2 r, n), into all that follows `gain`."""
    wide()
    n, links, ln_unit = logw.shape[1], np.empty((readings.shape[1], link_kernels.NUMBERS)), np.log(unit)
    X, Y, total, w = blank(n), blank(n), blank(n), blank(n)
    for r in range(len(logw)):
        take(x, 2 * r, X)
        take(x, 2 * r + 1, Y)
        take(logw, r, total)
        link_kernels.add_teammates(X, Y, r, packets, readings, ranged, A, slope, unit, ln_unit, gain, links, total)
        sum_w, squares = _weigh(X, Y, total, n, w, mean, P, r)
        due[r] = sum_w * sum_w < n / 2 * squares
        give(total, logw_out, r)

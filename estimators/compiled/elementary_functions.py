"""Logarithm, exponential, sine and arctangent as polynomials without branches, so that LLVM can vectorise their loops.

numba calls the C library once per number otherwise. Arguments are assumed finite: a nan gives any number in `log`, and
stays nan in `exp`. Coefficients are Chebyshev interpolants, whose error is within a small factor of the best one's;
tests/estimators/compiled/test_elementary_functions.py checks the error that every function states, of double and of
single numbers.
"""

import numpy as np

from cooploc.estimators.compiled.formats import SINGLE, bits, by_format, from_bits, odd, polynomial
from cooploc.estimators.compiled.jit import inlined

LN2 = float(np.log(2.0))
COMPACT = 1 / 4  # how far a compact cloud reaches from the middle of its squared distances, as a share of that
EIGHTH = float(np.tan(np.pi / 8))


def _log(f):
    series = polynomial(f, lambda t: np.log1p(t) / t, (14, 7), (0.5**0.5 - 1, 2**0.5 - 1))
    sqrt_half, mantissa, word, real, one, ln2 = f.bits(0.5**0.5), f.mantissa, f.word, f.real, f.real(1), f.real(LN2)

    def log(x):
        b = bits(x)
        e = word(b - sqrt_half) >> mantissa
        t = from_bits(word(b - (e << mantissa))) - one
        return real(e) * ln2 + t * series(t)

    return log


def _ln(f):
    if f is SINGLE:
        return _log(f)  # whose error vanishes at 1, where variances are
    series = polynomial(f, lambda t: np.log(1.5 + t), (15, 0), (-0.5, 0.5), -f.bias * LN2)
    fraction, one, mantissa = (1 << f.mantissa) - 1, f.one, f.mantissa

    def ln(x):
        b = bits(x)
        t = from_bits((b & fraction) | one) - 1.5
        return (b >> mantissa) * LN2 + series(t)

    return ln


def _log1p_compact(f):
    series = polynomial(f, np.log1p, (12, 7), (-COMPACT, COMPACT))

    def log1p_compact(t):
        return series(t)

    return log1p_compact


def _exp(f):
    series = polynomial(f, np.exp, (10, 5), (-LN2 / 2, LN2 / 2))
    rounder = 1.5 * 2.0**f.mantissa  # a number this large has no fraction: adding it rounds
    lowest, rounded, ln2, inverse = f.real(-708.0 if f.bias > 127 else -87.0), f.bits(rounder), f.real(LN2), 1 / LN2
    zero, rounder, inverse, (real, word, mantissa, bias) = f.real(0), f.real(rounder), f.real(inverse), f

    def exp(x):
        k = word(bits(x * inverse + rounder) - rounded)
        return zero if x < lowest else series(x - real(k) * ln2) * from_bits(word((k + bias) << mantissa))

    return exp


def _quarter(f):
    square = 0.0, (np.pi / 4) ** 2
    sine = polynomial(f, odd(np.sin), (5, 3), square)
    cosine = polynomial(f, lambda s: np.cos(np.sqrt(s)), (6, 3), square)

    def quarter(r):
        s = r * r
        return cosine(s), r * sine(s)

    return quarter


def _arc(f):
    series = polynomial(f, odd(np.arctan), (9, 4), (0.0, EIGHTH**2))
    pi, half, eighth, least = (
        f.real(np.pi),
        f.real(np.pi / 2),
        f.real(EIGHTH),
        f.real(1e-300 if f.bias > 127 else 1e-30),
    )
    zero, quarter = f.real(0), f.real(np.pi / 4)

    def arc(y, x):
        y, a = abs(y), abs(x)
        small, large = min(y, a), max(y, a)
        beyond = small > eighth * large  # then arctan(t) = pi/4 + arctan((t - 1) / (t + 1))
        t = (small - large if beyond else small) / max(small + large if beyond else large, least)
        angle = (quarter if beyond else zero) + t * series(t * t)
        angle = half - angle if y > a else angle
        return pi - angle if x < zero else angle

    return arc


# In double and in single precision:
log = by_format(_log)  # ln x of normal x > 0, x = 2^e (1 + t), 1 + t in [sqrt(1/2), sqrt(2)); error below 3e-13 or 2e-7
ln = by_format(_ln)  # the same in fewer steps; error below 5e-13, or as of `log`, of 1 + |ln x|
log1p_compact = by_format(_log1p_compact)  # ln (1 + t) for |t| <= COMPACT, error below 5e-13 or 1e-7
exp = by_format(_exp)  # e^x, 0 below -708 or -87; relative error below 1e-12 or 2e-7 of 1 + |x|
quarter = by_format(_quarter)  # cos r and sin r for |r| <= pi/4, errors below 1e-13 or 2e-7
arc = by_format(_arc)  # |arctan2(y, x)| in [0, pi], 0 at the origin; error below 1e-12 or 1e-6


@inlined
def turned(k, c, s):
    """(c, s) turned by k right angles."""
    swap, left, down = k & 1, ((k + 1) & 2) != 0, (k & 2) != 0
    a, b = (s if swap else c), (c if swap else s)
    return (-a if left else a), (-b if down else b)

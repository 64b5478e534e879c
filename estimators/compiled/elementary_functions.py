"""Logarithm, exponential, sine and arctangent as polynomials without branches, so that LLVM can vectorise their loops.

numba calls the C library once per number otherwise. Arguments are assumed finite: a nan gives any number in `log`, and
stays nan in `exp`. Coefficients are Chebyshev interpolants, whose error is within a small factor of the best one's;
tests/estimators/test_elementary_functions.py checks the stated error of every function.
"""

from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np
from numba import types
from numpy.polynomial import Chebyshev, Polynomial

from cooploc.estimators.compiled.jit import inlined, intrinsic
from cooploc.estimators.interface import Array

FUSED = ("contract",)

LN2 = float(np.log(2.0))
SQRT_HALF = 0x3FE6A09E667F3BCD  # bits of sqrt(1/2)
MANTISSA = 52  # bits
FRACTION = (1 << MANTISSA) - 1
ONE = 1023 << MANTISSA  # bits of 1.0
ROUND = 1.5 * 2.0**52  # a number this large has no fraction: adding it rounds
LOWEST = -708.0  # exp of less is 0 here
COMPACT = 1 / 4  # how far a compact cloud reaches from the middle of its squared distances, as a share of that
EIGHTH = float(np.tan(np.pi / 8))


def _bitcast(target: Any, builder: Any, signature: Any, a: Any) -> Any:
    return builder.bitcast(a[0], target.get_value_type(signature.return_type))


@intrinsic
def bits(context: Any, x: Any) -> Any:
    """The bits of a float64 as an int64."""
    return types.int64(types.float64), _bitcast


@intrinsic
def from_bits(context: Any, x: Any) -> Any:
    """The float64 with these bits."""
    return types.float64(types.int64), _bitcast


@intrinsic
def ordered(context: Any, x: Any) -> Any:
    """The bits of a float64 as an int64 that is ordered as the floats are, which LLVM can sort in vectors; or back."""

    def generate(target: Any, builder: Any, signature: Any, a: Any) -> Any:
        word = target.get_value_type(types.int64)
        b = builder.bitcast(a[0], word)
        turned = builder.xor(b, builder.lshr(builder.ashr(b, word(63)), word(1)))
        return builder.bitcast(turned, target.get_value_type(signature.return_type))

    return (types.int64(types.float64) if x == types.float64 else types.float64(types.int64)), generate


def _odd(function: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """f(x) / x as a function of x^2."""
    return lambda square: function(np.sqrt(square)) / np.sqrt(square)


def _polynomial(function: Callable[[Array], Array], degree: int, low: float, high: float, shift: float = 0.0) -> Any:
    """A polynomial close to `function` on [low, high], plus `shift`: pairs of terms, by Horner's rule in x^2."""
    fitted = Chebyshev.interpolate(function, degree, [low, high]).convert(kind=Polynomial).coef
    coefficients = [float(fitted[0] + shift), *fitted[1:].tolist()]

    def generate(target: Any, builder: Any, signature: Any, a: Any) -> Any:
        def fused(a: Any, b: Any, c: Any) -> Any:
            return builder.fadd(builder.fmul(a, b, flags=FUSED), c, flags=FUSED)

        x, (*terms,) = a[0], map(target.get_value_type(types.float64), coefficients)
        square = builder.fmul(x, x)
        pairs = [fused(terms[i + 1], x, terms[i]) if i + 1 < len(terms) else terms[i] for i in range(0, len(terms), 2)]
        return reduce(lambda total, pair: fused(total, square, pair), reversed(pairs))

    return intrinsic(lambda context, x: (types.float64(types.float64), generate))


_log1p_over_t = _polynomial(lambda t: np.log1p(t) / t, 14, 0.5**0.5 - 1, 2**0.5 - 1)
_log_above = _polynomial(lambda t: np.log(1.5 + t), 15, -0.5, 0.5, -1023 * LN2)
log1p_compact = _polynomial(np.log1p, 12, -COMPACT, COMPACT)  # ln (1 + t) for |t| <= COMPACT, error below 5e-13
_exp = _polynomial(np.exp, 10, -LN2 / 2, LN2 / 2)
_sin_over_r = _polynomial(_odd(np.sin), 5, 0.0, (np.pi / 4) ** 2)
_cos = _polynomial(lambda square: np.cos(np.sqrt(square)), 6, 0.0, (np.pi / 4) ** 2)
_arctan_over_t = _polynomial(_odd(np.arctan), 9, 0.0, EIGHTH**2)


@inlined
def log(x):
    """ln x for normal x > 0, error below 3e-13: x = 2^e (1 + t) with 1 + t in [sqrt(1/2), sqrt(2))."""
    b = bits(x)
    e = (b - SQRT_HALF) >> MANTISSA
    t = from_bits(b - (e << MANTISSA)) - 1.0
    return e * LN2 + t * _log1p_over_t(t)


@inlined
def ln(x):
    """ln x for normal x > 0, error below 5e-13 wherever x is: fewer steps than `log`, whose error vanishes at 1."""
    b = bits(x)
    t = from_bits((b & FRACTION) | ONE) - 1.5
    return (b >> MANTISSA) * LN2 + _log_above(t)


@inlined
def exp(x):
    """e^x for x <= 700, relative error below 1e-12 (of 1 + |x|/100); 0 below -708."""
    shifted = x * (1 / LN2) + ROUND
    k = bits(shifted) - bits(ROUND)
    return 0.0 if x < LOWEST else _exp(x - k * LN2) * from_bits((k + 1023) << MANTISSA)


@inlined
def quarter(r):
    """cos r and sin r for |r| <= pi/4, errors below 1e-13."""
    s = r * r
    return _cos(s), r * _sin_over_r(s)


@inlined
def turned(k, c, s):
    """(c, s) turned by k right angles."""
    swap, left, down = k & 1, ((k + 1) & 2) != 0, (k & 2) != 0
    a, b = (s if swap else c), (c if swap else s)
    return (-a if left else a), (-b if down else b)


@inlined
def cosine_sine(angle):
    """cos and sin of an angle of a few turns at most, errors below 1e-12."""
    k = bits(angle * (2 / np.pi) + ROUND) - bits(ROUND)
    c, s = quarter(angle - k * (np.pi / 2))
    return turned(k, c, s)


@inlined
def arc(y, x):
    """|arctan2(y, x)| in [0, pi], error below 1e-12; 0 at the origin."""
    y, a = abs(y), abs(x)
    small, large = min(y, a), max(y, a)
    beyond = small > EIGHTH * large  # then arctan(t) = pi/4 + arctan((t - 1) / (t + 1))
    t = (small - large if beyond else small) / max(small + large if beyond else large, 1e-300)
    angle = (np.pi / 4 if beyond else 0.0) + t * _arctan_over_t(t * t)
    angle = np.pi / 2 - angle if y > a else angle
    return np.pi - angle if x < 0 else angle

"""Logarithm, exponential, sine and arctangent as polynomials without branches, so that LLVM can vectorise their loops.

numba calls the C library once per number otherwise. Arguments are assumed finite: a nan gives any number in `log`, and
stays nan in `exp`. Coefficients are Chebyshev interpolants, whose error is within a small factor of the best one's;
tests/test_elementary.py holds every function to its stated error.

"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic as untyped_intrinsic
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray

from cooploc.estimators.interface import Array

Scalar = TypeVar("Scalar", bound=np.generic)

# Not the full fastmath: it deletes tests for nan.
FAST: dict[str, Any] = {"error_model": "numpy", "fastmath": {"reassoc", "nsz", "arcp", "contract", "afn"}}
inlined: Any = numba.njit(forceinline=True, **FAST)  # for what stands in a loop, which a call would keep from vectors

LN2 = float(np.log(2.0))
SQRT_HALF = 0x3FE6A09E667F3BCD  # bits of sqrt(1/2)
MANTISSA = 52  # bits
ROUND = 1.5 * 2.0**52  # a number this large has no fraction: adding it rounds
LOWEST = -708.0  # exp of less is 0 here
EIGHTH = float(np.tan(np.pi / 8))


# Whatever kernels are made of. numba by itself compiles again when a kernel's own file has changed, not when a file has
# from which it takes functions.
SOURCES = [
    Path(__file__).with_name(f"{name}.py").read_bytes() for name in ("elementary", "kernels", "likelihood", "models")
]


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a loop when it is first called, and keep it on disk until its source changes."""
    compiled = numba.njit(cache=True, **FAST)(function)
    own = Path(function.__code__.co_filename).read_bytes()
    compiled._cache._cache_file._source_stamp = hashlib.sha256(b"".join([*SOURCES, own])).hexdigest()
    return compiled


def _fit(function: Callable[[Array], Array], degree: int, low: float, high: float) -> tuple[float, ...]:
    """Coefficients of a polynomial close to `function` on [low, high], lowest power first."""
    return tuple(Chebyshev.interpolate(function, degree, [low, high]).convert(kind=Polynomial).coef.tolist())


def _odd(function: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """f(x) / x as a function of x^2."""
    return lambda square: function(np.sqrt(square)) / np.sqrt(square)


LOG = _fit(lambda t: np.log1p(t) / t, 14, 0.5**0.5 - 1, 2**0.5 - 1)
EXP = _fit(np.exp, 10, -LN2 / 2, LN2 / 2)
SIN = _fit(_odd(np.sin), 5, 0.0, (np.pi / 4) ** 2)
COS = _fit(lambda square: np.cos(np.sqrt(square)), 6, 0.0, (np.pi / 4) ** 2)
ATAN = _fit(_odd(np.arctan), 9, 0.0, EIGHTH**2)


def readable(array: NDArray[Scalar]) -> NDArray[Scalar]:
    """The array as kernels take it: contiguous and not to be written to, so that each is compiled once."""
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view


intrinsic: Any = untyped_intrinsic


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
def wide(context: Any) -> Any:
    """Ask LLVM for 512-bit vectors in the calling kernel, where the processor has them: it prefers 256 of itself."""

    def generate(target: Any, builder: Any, signature: Any, a: Any) -> Any:
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')  # llvmlite knows no attributes with a value
        return target.get_dummy_value()

    return types.none(), generate


@inlined
def log(x):  # type: ignore[no-untyped-def]
    """ln x for normal x > 0, error below 3e-13: x = 2^e (1 + t) with 1 + t in [sqrt(1/2), sqrt(2))."""
    b = bits(x)
    e = (b - SQRT_HALF) >> MANTISSA
    t = from_bits(b - (e << MANTISSA)) - 1.0
    t2 = t * t
    t4 = t2 * t2
    low = (LOG[0] + LOG[1] * t) + (LOG[2] + LOG[3] * t) * t2 + ((LOG[4] + LOG[5] * t) + (LOG[6] + LOG[7] * t) * t2) * t4
    high = (LOG[8] + LOG[9] * t) + (LOG[10] + LOG[11] * t) * t2 + ((LOG[12] + LOG[13] * t) + LOG[14] * t2) * t4
    return e * LN2 + t * (low + high * (t4 * t4))


@inlined
def exp(x):  # type: ignore[no-untyped-def]
    """e^x for x <= 700, relative error below 1e-12 (of 1 + |x|/100); 0 below -708."""
    shifted = max(x, LOWEST) * (1 / LN2) + ROUND
    k = bits(shifted) - bits(ROUND)
    r = x - k * LN2
    r2 = r * r
    r4 = r2 * r2
    low = (EXP[0] + EXP[1] * r) + (EXP[2] + EXP[3] * r) * r2
    high = (EXP[4] + EXP[5] * r) + (EXP[6] + EXP[7] * r) * r2 + ((EXP[8] + EXP[9] * r) + EXP[10] * r2) * r4
    return 0.0 if x < LOWEST else (low + high * r4) * from_bits((k + 1023) << MANTISSA)


@inlined
def quarter(r):  # type: ignore[no-untyped-def]
    """cos r and sin r for |r| <= pi/4, errors below 1e-13."""
    s = r * r
    s2 = s * s
    c = (COS[0] + COS[1] * s) + (COS[2] + COS[3] * s) * s2 + ((COS[4] + COS[5] * s) + COS[6] * s2) * (s2 * s2)
    odd = (SIN[0] + SIN[1] * s) + (SIN[2] + SIN[3] * s) * s2 + (SIN[4] + SIN[5] * s) * (s2 * s2)
    return c, r * odd


@inlined
def turned(k, c, s):  # type: ignore[no-untyped-def]
    """(c, s) turned by k right angles."""
    swap, left, down = k & 1, ((k + 1) & 2) != 0, (k & 2) != 0
    a, b = (s if swap else c), (c if swap else s)
    return (-a if left else a), (-b if down else b)


@inlined
def cosine_sine(angle):  # type: ignore[no-untyped-def]
    """cos and sin of an angle of a few turns at most, errors below 1e-12."""
    k = bits(angle * (2 / np.pi) + ROUND) - bits(ROUND)
    c, s = quarter(angle - k * (np.pi / 2))
    return turned(k, c, s)


@inlined
def arc(y, x):  # type: ignore[no-untyped-def]
    """|arctan2(y, x)| in [0, pi], error below 1e-12; 0 at the origin."""
    y, a = abs(y), abs(x)
    small, large = min(y, a), max(y, a)
    beyond = small > EIGHTH * large  # then arctan(t) = pi/4 + arctan((t - 1) / (t + 1))
    t = (small - large if beyond else small) / max(small + large if beyond else large, 1e-300)
    s = t * t
    s2 = s * s
    low = (ATAN[0] + ATAN[1] * s) + (ATAN[2] + ATAN[3] * s) * s2
    high = (ATAN[4] + ATAN[5] * s) + (ATAN[6] + ATAN[7] * s) * s2 + (ATAN[8] + ATAN[9] * s) * (s2 * s2)
    angle = (np.pi / 4 if beyond else 0.0) + t * (low + high * (s2 * s2))
    angle = np.pi / 2 - angle if y > a else angle
    return np.pi - angle if x < 0 else angle

"""Polynomials against numpy at the errors they state, inside loops that LLVM vectorises and outside."""

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles import repeatable

from cooploc.estimators import compiled
from cooploc.estimators.compiled import FAST, order, wide


def over(function, arguments):
    """A loop of `function` over the rows of `arguments` (n, k), compiled the way kernels are."""

    @numba.njit(**FAST)
    def loop(a, b, out):
        wide()
        for i in range(len(a)):
            out[i] = function(a[i], b[i])

    return lambda a, b: (out := np.empty_like(a), loop(a, b, out))[0]


@numba.njit(**FAST)
def log(x, _):
    return compiled.log(x)


@numba.njit(**FAST)
def ln(x, _):
    return compiled.ln(x)


@numba.njit(**FAST)
def log1p(x, _):
    return compiled.log1p_compact(x)


@numba.njit(**FAST)
def compare(a, b):
    """-1, 0 or 1, by the integers that stand for two floats."""
    a, b = order(a), order(b)
    return 1.0 * (a > b) - 1.0 * (a < b)


@numba.njit(**FAST)
def back(x, _):
    return order(order(x))


@numba.njit(**FAST)
def exp(x, _):
    return compiled.exp(x)


@numba.njit(**FAST)
def cosine(x, _):
    return compiled.quarter(x)[0]


@numba.njit(**FAST)
def sine(x, _):
    return compiled.quarter(x)[1]


@numba.njit(**FAST)
def arc(y, x):
    return compiled.arc(y, x)


LOOPS = {f.__name__: over(f, None) for f in (log, ln, log1p, compare, back, exp, cosine, sine, arc)}
positive = st.floats(1e-300, 1e300)
finite = st.floats(-1e150, 1e150).filter(lambda v: v == 0 or abs(v) > 1e-150)


def at(name, a, b=0.0):
    """Alone, and among others in a vector."""
    alone = LOOPS[name](np.array([a]), np.array([b]))[0]
    among = LOOPS[name](np.full(37, a), np.full(37, b))
    np.testing.assert_allclose(among, alone, rtol=1e-15, atol=1e-300)
    return alone


@given(positive)
@repeatable
def test_logarithm(x):
    assert at("log", x) == pytest.approx(np.log(x), rel=3e-13, abs=3e-13)


@given(st.floats(-compiled.COMPACT, compiled.COMPACT))
@repeatable
def test_logarithm_near_the_middle_of_a_compact_cloud(t):
    assert at("log1p", t) == pytest.approx(np.log1p(t), abs=5e-13)


@given(st.floats(-0.29, 0.41))
@repeatable
def test_logarithm_near_one_keeps_its_relative_error(t):
    assert at("log", 1 + t) == pytest.approx(np.log(1 + t), rel=1e-12, abs=1e-300)


@given(st.floats(-708, 700))
@repeatable
def test_exponential(x):
    assert at("exp", x) == pytest.approx(np.exp(x), rel=1e-12 * (1 + abs(x) / 100))


@given(st.floats(-np.pi / 4, np.pi / 4))
@repeatable
def test_cosine_and_sine(angle):
    assert at("cosine", angle) == pytest.approx(np.cos(angle), abs=1e-13)
    assert at("sine", angle) == pytest.approx(np.sin(angle), abs=1e-13)


@given(finite, finite)
@repeatable
def test_arc_is_the_size_of_arctan2(y, x):
    assert at("arc", y, x) == pytest.approx(abs(np.arctan2(y, x)), abs=1e-12)


# ---------------------------------------------------------------- single precision


SPANS = {  # arguments, the function, and the error that is stated: absolute, and of the result
    "log": ((1e-30, 1e30), np.log, 2e-7, 2e-7),
    "ln": ((1e-30, 1e30), np.log, 2e-7, 2e-7),
    "log1p": ((-compiled.COMPACT, compiled.COMPACT), np.log1p, 1e-7, 0),
    "exp": ((-87, 80), np.exp, 0, 2e-5),
    "cosine": ((-np.pi / 4, np.pi / 4), np.cos, 2e-7, 0),
    "sine": ((-np.pi / 4, np.pi / 4), np.sin, 2e-7, 0),
}


@pytest.mark.parametrize("name", SPANS)
def test_single_numbers_have_the_error_that_is_stated(name):
    (low, high), function, absolute, relative = SPANS[name]
    x = np.geomspace(low, high, 9999) if low > 0 else np.linspace(low, high, 9999)
    x = x.astype(np.float32)
    found = LOOPS[name](x, x)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, function(x.astype(float)), atol=absolute, rtol=relative)

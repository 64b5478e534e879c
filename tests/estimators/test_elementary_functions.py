"""Polynomials against numpy at the errors they state, in double and in single precision."""

import numba
import numpy as np
import pytest

from cooploc.estimators import compiled
from cooploc.estimators.compiled import FAST, wide

cosine = numba.njit(**FAST)(lambda r: compiled.quarter(r)[0])
sine = numba.njit(**FAST)(lambda r: compiled.quarter(r)[1])


def call(function, *arguments):
    """A loop of `function` over arrays, compiled the way kernels are."""
    body = f"def loop(out, {', '.join('ab'[: len(arguments)])}):\n    wide()\n    for i in range(len(out)):\n"
    scope = {"f": function, "wide": wide}
    exec(f"{body}        out[i] = f({', '.join(f'{one}[i]' for one in 'ab'[: len(arguments)])})", scope)
    out = np.empty_like(arguments[0])
    numba.njit(**FAST)(scope["loop"])(out, *arguments)
    return out


POSITIVE, COMPACT, EIGHTH = (1e-300, 1e300), (-compiled.COMPACT, compiled.COMPACT), (-np.pi / 4, np.pi / 4)
SPANS = {  # the function, numpy's, the arguments, and the errors: absolute, and relative to the result
    "log": (compiled.log, np.log, POSITIVE, 3e-13, 3e-13),
    "log near one": (compiled.log, np.log, (0.71, 1.41), 1e-16, 1e-12),
    "ln": (compiled.ln, np.log, POSITIVE, 5e-13, 5e-13),
    "log1p": (compiled.log1p_compact, np.log1p, COMPACT, 5e-13, 0),
    "exp": (compiled.exp, np.exp, (-708, 700), 0, 8e-12),
    "cosine": (cosine, np.cos, EIGHTH, 1e-13, 0),
    "sine": (sine, np.sin, EIGHTH, 1e-13, 0),
    "log, single": (compiled.log, np.log, (1e-30, 1e30), 2e-7, 2e-7),
    "ln, single": (compiled.ln, np.log, (1e-30, 1e30), 2e-7, 2e-7),
    "log1p, single": (compiled.log1p_compact, np.log1p, COMPACT, 1e-7, 0),
    "exp, single": (compiled.exp, np.exp, (-87, 80), 0, 2e-5),
    "cosine, single": (cosine, np.cos, EIGHTH, 2e-7, 0),
    "sine, single": (sine, np.sin, EIGHTH, 2e-7, 0),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SPANS)
def test_functions_have_the_error_that_is_stated(name):
    function, exact, (low, high), absolute, relative = SPANS[name]
    x = np.geomspace(low, high, 9999) if low > 0 else np.linspace(low, high, 9999)
    x = x.astype(np.float32 if "single" in name else np.float64)
    found = call(function, x)
    assert found.dtype == x.dtype
    np.testing.assert_allclose(found, exact(x.astype(float)), atol=absolute, rtol=relative)


def test_arc_is_the_size_of_arctan2():
    rng = np.random.default_rng(0)
    y, x = rng.choice([-1, 0, 1], (2, 9999)) * 10 ** rng.uniform(-150, 150, (2, 9999))
    np.testing.assert_allclose(call(compiled.arc, y, x), np.abs(np.arctan2(y, x)), atol=1e-12)

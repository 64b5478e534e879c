"""Double and single precision: what loops must know of the bits of a number, and functions that exist for both.

A kernel is written once. numba compiles it for the type of the arrays that it is given, and a function that is marked
`by_format` for the type of its first argument. A constant in a loop over single numbers is written `real(0.5)`, with
`real` the type of the array, `X.dtype.type`: as a plain 0.5 it would make everything that it meets double.
"""

from collections.abc import Callable
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload
from numpy.polynomial import Chebyshev, Polynomial

from cooploc.estimators.compiled.jit import FAST, intrinsic
from cooploc.estimators.interface import Array

FUSED = ("contract",)


class Format(NamedTuple):
    """How a number is kept."""

    real: Any  # numpy's type of it
    word: Any  # numpy's type of an integer of as many bits
    mantissa: int  # bits
    bias: int  # of the exponent

    @property
    def one(self) -> int:
        """The bits of 1."""
        return self.bias << self.mantissa

    def bits(self, x: float) -> int:
        """The bits of a constant."""
        return int(np.array(x, self.real).view(self.word))


DOUBLE = Format(np.float64, np.int64, 52, 1023)
SINGLE = Format(np.float32, np.int32, 23, 127)
WORDS: Any = {types.float64: types.int64, types.float32: types.int32}
FLOATS: Any = {word: real for real, word in WORDS.items()}


def by_format(make: Callable[[Format], Callable[..., Any]]) -> Any:
    """A function for loops that `make` writes for either format; its first argument says which is meant."""
    versions = {types.float64: make(DOUBLE), types.float32: make(SINGLE)}

    def chosen(*arguments: Any) -> Any:
        raise NotImplementedError("this function is called by compiled loops only")

    options: Any = {"forceinline": True, **FAST}
    overload(chosen, strict=False, jit_options=options)(lambda *kinds: versions.get(kinds[0]))
    return chosen


def _bitcast(target: Any, builder: Any, signature: Any, a: Any) -> Any:
    return builder.bitcast(a[0], target.get_value_type(signature.return_type))


@intrinsic
def bits(context: Any, x: Any) -> Any:
    """The bits of a number as an integer."""
    return WORDS[x](x), _bitcast


@intrinsic
def from_bits(context: Any, x: Any) -> Any:
    """The number with these bits."""
    return FLOATS[x](x), _bitcast


@intrinsic
def ordered(context: Any, x: Any) -> Any:
    """The bits of a number as an integer that is ordered as numbers are, which LLVM can sort in vectors; or back."""

    def generate(target: Any, builder: Any, signature: Any, a: Any) -> Any:
        word = target.get_value_type(WORDS.get(x, x))
        b = builder.bitcast(a[0], word)
        turned = builder.xor(b, builder.lshr(builder.ashr(b, word(word.width - 1)), word(1)))
        return builder.bitcast(turned, target.get_value_type(signature.return_type))

    return (WORDS.get(x) or FLOATS[x])(x), generate


@intrinsic
def is_single(context: Any, x: Any) -> Any:
    """Whether a number is single: known when the loop is compiled."""
    return types.boolean(x), lambda target, builder, *_: target.get_constant(types.boolean, x == types.float32)


def odd(function: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """f(x) / x as a function of x^2."""
    return lambda square: function(np.sqrt(square)) / np.sqrt(square)


def polynomial(
    f: Format,
    function: Callable[[Array], Array],
    degrees: tuple[int, int],
    span: tuple[float, float],
    shift: float = 0.0,
) -> Any:
    """A polynomial close to `function` on a span, plus `shift`: pairs of terms, by Horner's rule in x^2.

    Args:
        f: the format.
        function: what is approximated.
        degrees: of the polynomial in double and in single precision.
        span: the lowest and the highest argument.
        shift: added to the polynomial.

    """
    degree = degrees[f is SINGLE]
    fitted = Chebyshev.interpolate(function, degree, span).convert(kind=Polynomial).coef
    coefficients = [float(fitted[0] + shift), *fitted[1:].tolist()]
    kind = types.float32 if f is SINGLE else types.float64

    def generate(target: Any, builder: Any, signature: Any, a: Any) -> Any:
        def fused(a: Any, b: Any, c: Any) -> Any:
            return builder.fadd(builder.fmul(a, b, flags=FUSED), c, flags=FUSED)

        x, (*terms,) = a[0], map(target.get_value_type(kind), map(float, map(f.real, coefficients)))
        square = builder.fmul(x, x)
        pairs = [fused(terms[i + 1], x, terms[i]) if i + 1 < len(terms) else terms[i] for i in range(0, len(terms), 2)]
        return reduce(lambda total, pair: fused(total, square, pair), reversed(pairs))

    return intrinsic(lambda context, x: (kind(kind), generate))

"""Tools for compiled loops: caching on disk, number formats, elementary functions, row buffers."""

import hashlib
import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import reduce
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numba
import numpy as np
from filelock import FileLock
from numba import types
from numba.core.caching import IndexDataCacheFile
from numba.extending import intrinsic as untyped_intrinsic
from numba.extending import overload
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray

Scalar = TypeVar("Scalar", bound=np.generic)

STRICT: dict[str, Any] = {"error_model": "numpy"}  # every operation as written: nan and infinity keep their meaning
# Not the full fastmath: it deletes tests for nan. In such a loop a square is written x * x: numba compiles a power once
# in a process, as the first function wants it that has one, and bits would depend on which that is.
FAST: dict[str, Any] = {**STRICT, "fastmath": {"reassoc", "nsz", "arcp", "contract", "afn"}}
KEPT: dict[str, Any] = {"cache": True, "no_cfunc_wrapper": True}
INSIDE: dict[str, Any] = {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

# A function inside a loop: inlined, because a call would keep the loop from being vectorised. Kernels alone call it.
inlined: Any = numba.njit(**INSIDE, **FAST)
strict_inlined: Any = numba.njit(**INSIDE, **STRICT)
intrinsic: Any = untyped_intrinsic

# numba looks at a kernel's own file only. The names of our files on disk hold a stamp of all that a kernel may call, so
# that one of another version is never opened.
KERNELS = "joint_kernels", "kalman_kernels", "particle_kernels", "split_kernels"
SHARED = "compiled", "random_numbers", "models", "covariance_intersection", *KERNELS
SOURCES = [(Path(__file__).parent / f"{name}.py").read_bytes() for name in SHARED]


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a loop when it is first called, with fast mathematics, and keep it on disk until its source changes."""
    return _cache_on_disk(function, FAST)


def strict_kernel(function: Callable[..., Any]) -> Any:
    """Compile as `kernel` does, without fast mathematics: every operation as written."""
    return _cache_on_disk(function, STRICT)


def _cache_on_disk(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Compile and cache; of two processes that need a kernel, the second waits for the first and finds it on disk."""
    try:
        compiled = numba.njit(**KEPT, **options)(function)
    except RuntimeError:  # neither our folder nor the user's can be written, as in many containers
        os.environ["NUMBA_CACHE_DIR"] = str(_own_temporary_directory())  # of later processes, too
        numba.config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]  # type: ignore[attr-defined]
        compiled = numba.njit(**KEPT, **options)(function)
    stamp = hashlib.sha256(b"".join([*SOURCES, Path(function.__code__.co_filename).read_bytes()])).hexdigest()
    name, compile_now = f"{compiled._cache._impl.filename_base}-{stamp[:16]}", compiled.compile
    compiled._cache._cache_file = IndexDataCacheFile(compiled._cache.cache_path, name, stamp)
    lock = cache_directory(compiled) / f"{name}.lock"

    def compile_in_turn(signature: Any) -> Any:
        with FileLock(lock, is_singleton=True, thread_local=False):
            return compile_now(signature)

    compiled.compile = compile_in_turn
    return compiled


def _own_temporary_directory() -> Path:
    """Return this user's directory for kernels among temporary files; a new one if that is not theirs alone."""
    place = Path(tempfile.gettempdir()) / f"cooploc-{os.getuid()}"
    with suppress(OSError):
        place.mkdir(mode=0o700)
    found = place.lstat() if place.exists() else None
    is_own = found and found.st_uid == os.getuid() and found.st_mode & 0o170077 == 0o040000
    return place if is_own else Path(tempfile.mkdtemp(prefix="cooploc-"))


def cache_directory(compiled: Any) -> Path:
    """Return the directory on disk that holds a kernel."""
    return Path(compiled._cache.cache_path)


def readable(array: NDArray[Scalar]) -> NDArray[Scalar]:
    """Return the array as kernels take it: contiguous and read-only, so that each kernel is compiled for one type."""
    array = np.ascontiguousarray(array)
    if not array.flags.writeable:
        return array
    view = array.view()
    view.setflags(write=False)
    return view


def spread_out(array: NDArray[Scalar], shape: tuple[int, ...]) -> NDArray[Scalar]:
    """Broadcast as np.broadcast_to does, in a tenth of its time for a few rows, and make the result `readable`."""
    if array.shape == shape:
        return readable(array)
    whole = np.empty(shape, array.dtype)
    whole[...] = array
    whole.setflags(write=False)
    return whole


@intrinsic
def wide(context: Any) -> Any:
    """Ask LLVM for 512-bit vectors in the calling function where the processor has them; its default is 256."""

    def generate(target: Any, builder: Any, signature: Any, a: Any) -> Any:
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')  # llvmlite knows no attributes with a value
        return target.get_dummy_value()

    return types.none(), generate


# Double and single precision: a kernel is compiled for the type of its arrays, a function marked `by_format` for the
# type of its first argument. In a loop a constant is `real(0.5)`: a plain 0.5 makes all that it meets double.


class Format(NamedTuple):
    """A format of numbers."""

    real: Any  # numpy's type of it
    word: Any  # numpy's type of an integer of as many bits
    mantissa: int  # bits
    bias: int  # of the exponent

    def bits(self, x: float) -> int:
        """Return the bits of a constant."""
        return int(np.array(x, self.real).view(self.word))


DOUBLE = Format(np.float64, np.int64, 52, 1023)
SINGLE = Format(np.float32, np.int32, 23, 127)
WORDS: Any = {types.float64: types.int64, types.float32: types.int32}
FLOATS: Any = {word: real for real, word in WORDS.items()}


def by_format(make: Callable[[Format], Callable[..., Any]]) -> Any:
    """Return a function for loops that `make` writes for either format; its first argument says which is meant."""
    versions = {types.float64: make(DOUBLE), types.float32: make(SINGLE)}

    def choose(*arguments: Any) -> Any:
        raise NotImplementedError("this function is called by compiled loops only")

    options: Any = {"forceinline": True, **FAST}
    overload(choose, strict=False, jit_options=options)(lambda *kinds: versions.get(kinds[0]))
    return choose


@intrinsic
def bits(context: Any, x: Any) -> Any:
    """Return the bits of a number as an integer, or the number with these bits."""

    def generate(target: Any, builder: Any, signature: Any, a: Any) -> Any:
        return builder.bitcast(a[0], target.get_value_type(signature.return_type))

    return (WORDS.get(x) or FLOATS[x])(x), generate


@intrinsic
def order(context: Any, x: Any) -> Any:
    """Return a number's bits as an integer ordered as numbers are, which LLVM can compare in vectors; or back."""

    def generate(target: Any, builder: Any, signature: Any, a: Any) -> Any:
        word = target.get_value_type(WORDS.get(x, x))
        b = builder.bitcast(a[0], word)
        turned = builder.xor(b, builder.lshr(builder.ashr(b, word(word.width - 1)), word(1)))
        return builder.bitcast(turned, target.get_value_type(signature.return_type))

    return (WORDS.get(x) or FLOATS[x])(x), generate


@intrinsic
def is_single(context: Any, x: Any) -> Any:
    """Return whether a number is single: known when the loop is compiled."""
    return types.boolean(x), lambda target, builder, *_: target.get_constant(types.boolean, x == types.float32)


def polynomial(f: Format, function: Any, degrees: tuple[int, int], span: tuple[float, float], shift: float = 0) -> Any:
    """Return a polynomial close to `function` on a span, plus `shift`: pairs of terms, by Horner's rule in x^2.

    The degrees are those in double and in single precision.
    """
    degree = degrees[f is SINGLE]
    fitted = Chebyshev.interpolate(function, degree, span).convert(kind=Polynomial).coef
    coefficients = [float(fitted[0] + shift), *fitted[1:].tolist()]
    kind = types.float32 if f is SINGLE else types.float64

    def generate(target: Any, builder: Any, signature: Any, a: Any) -> Any:
        def fuse(a: Any, b: Any, c: Any) -> Any:
            return builder.fadd(builder.fmul(a, b, flags=("contract",)), c, flags=("contract",))

        x, (*terms,) = a[0], map(target.get_value_type(kind), map(float, map(f.real, coefficients)))
        square = builder.fmul(x, x)
        pairs = [fuse(terms[i + 1], x, terms[i]) if i + 1 < len(terms) else terms[i] for i in range(0, len(terms), 2)]
        return reduce(lambda total, pair: fuse(total, square, pair), reversed(pairs))

    return intrinsic(lambda context, x: (kind(kind), generate))


# Elementary functions as polynomials without branches, so that LLVM can vectorise their loops, with their errors in
# double and in single precision. Arguments are finite: a nan gives any number in `log`, and stays nan in `exp`.

LN2 = float(np.log(2.0))
COMPACT = 1 / 4  # how far a compact cloud reaches from the middle of its squared distances, as a share of that
EIGHTH = float(np.tan(np.pi / 8))


def make_log(f):
    """ln x of normal x > 0, x = 2^e (1 + t), 1 + t in [sqrt(1/2), sqrt(2)); error below 3e-13 or 2e-7."""
    series = polynomial(f, lambda t: np.log1p(t) / t, (14, 7), (0.5**0.5 - 1, 2**0.5 - 1))
    sqrt_half, mantissa, word, real, one, ln2 = f.bits(0.5**0.5), f.mantissa, f.word, f.real, f.real(1), f.real(LN2)

    def log(x):
        b = bits(x)
        e = word(b - sqrt_half) >> mantissa
        t = bits(word(b - (e << mantissa))) - one
        return real(e) * ln2 + t * series(t)

    return log


log = by_format(make_log)


@by_format
def ln(f):
    """ln x in fewer steps; error below 5e-13, or as of `log`, of 1 + |ln x|."""
    if f is SINGLE:
        return make_log(f)  # whose error vanishes at 1, where variances are
    series = polynomial(f, lambda t: np.log(1.5 + t), (15, 0), (-0.5, 0.5), -f.bias * LN2)
    fraction, one, mantissa = (1 << f.mantissa) - 1, f.bits(1.0), f.mantissa

    def ln(x):
        b = bits(x)
        t = bits((b & fraction) | one) - 1.5
        return (b >> mantissa) * LN2 + series(t)

    return ln


@by_format
def log1p_compact(f):
    """ln (1 + t) for |t| <= COMPACT; error below 5e-13 or 1e-7."""
    series = polynomial(f, np.log1p, (12, 7), (-COMPACT, COMPACT))
    return lambda t: series(t)


@by_format
def exp(f):
    """e^x, 0 below -708 or -87; relative error below 1e-12 or 2e-7 of 1 + |x|."""
    series = polynomial(f, np.exp, (10, 5), (-LN2 / 2, LN2 / 2))
    rounder = 1.5 * 2.0**f.mantissa  # a number this large has no fraction: adding it rounds
    lowest, rounded, ln2, inverse = f.real(-708.0 if f.bias > 127 else -87.0), f.bits(rounder), f.real(LN2), 1 / LN2
    zero, rounder, inverse, (real, word, mantissa, bias) = f.real(0), f.real(rounder), f.real(inverse), f

    def exp(x):
        k = word(bits(x * inverse + rounder) - rounded)
        return zero if x < lowest else series(x - real(k) * ln2) * bits(word((k + bias) << mantissa))

    return exp


@by_format
def quarter(f):
    """cos r and sin r for |r| <= pi/4; errors below 1e-13 or 2e-7."""
    square = 0.0, (np.pi / 4) ** 2
    sine = polynomial(f, lambda s: np.sin(np.sqrt(s)) / np.sqrt(s), (5, 3), square)
    cosine = polynomial(f, lambda s: np.cos(np.sqrt(s)), (6, 3), square)

    def quarter(r):
        s = r * r
        return cosine(s), r * sine(s)

    return quarter


@by_format
def arc(f):
    """|arctan2(y, x)| in [0, pi], 0 at the origin; error below 1e-12 or 1e-6."""
    series = polynomial(f, lambda s: np.arctan(np.sqrt(s)) / np.sqrt(s), (9, 4), (0.0, EIGHTH**2))
    numbers = np.pi, np.pi / 2, np.pi / 4, EIGHTH, 0, 1e-30 if f is SINGLE else 1e-300
    pi, half, quarter, eighth, zero, least = map(f.real, numbers)

    def arc(y, x):
        y, a = abs(y), abs(x)
        small, large = min(y, a), max(y, a)
        beyond = small > eighth * large  # then arctan(t) = pi/4 + arctan((t - 1) / (t + 1))
        t = (small - large if beyond else small) / max(small + large if beyond else large, least)
        angle = (quarter if beyond else zero) + t * series(t * t)
        angle = half - angle if y > a else angle
        return pi - angle if x < zero else angle

    return arc


@inlined
def rotate_quarters(k, c, s):
    """(c, s) turned by k right angles."""
    swap, left, down = k & 1, ((k + 1) & 2) != 0, (k & 2) != 0
    a, b = (s if swap else c), (c if swap else s)
    return (-a if left else a), (-b if down else b)


# Buffers for one row of an array, where compiled loops work on it: whole vectors that stay in the first cache.


@inlined
def load(rows, r, out):
    """Load row r into a buffer, filled up with its first entry. A view of the row would cost counting a reference."""
    wide()
    for i in range(rows.shape[1]):
        out[i] = rows[r, i]
    fill(out, rows.shape[1], rows[r, 0])


@inlined
def fill(out, first, value):
    """Write the value into a buffer from `first` on."""
    for i in range(first, len(out)):
        out[np.uint64(i)] = value


@inlined
def store(values, rows, r):
    """Write a buffer into row r."""
    wide()
    for i in range(rows.shape[1]):
        rows[r, i] = values[i]


@inlined
def row_buffer(rows):
    """Return a buffer for one of these rows, in whole vectors: a remainder would be computed number by number."""
    return np.empty((rows.shape[1] + 15) // 16 * 16, rows.dtype)


@inlined
def extent(values):
    """Return the smallest and the largest of a row."""
    wide()
    low = high = order(values[0])
    for i in range(len(values)):
        low, high = min(low, order(values[i])), max(high, order(values[i]))
    return order(low), order(high)

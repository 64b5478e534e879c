"""How loops are compiled: `kernel` and `inlined` by numba, `intrinsic` in LLVM, and arrays as kernels take them.

A kernel is kept on disk, and compiled again when its source changes. numba by itself looks at the kernel's own file
only; here the files that kernels take functions and constants from count too (`SHARED`).
"""

import hashlib
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from filelock import FileLock
from numba import types
from numba.extending import intrinsic as untyped_intrinsic
from numpy.typing import NDArray

Scalar = TypeVar("Scalar", bound=np.generic)

STRICT: dict[str, Any] = {"error_model": "numpy"}  # every operation as written: nan and infinity keep their meaning
# Not the full fastmath: it deletes tests for nan. In such a loop a square is written x * x: numba compiles a power once
# in a process, as the first function wants it that has one, and bits would depend on which that is.
FAST: dict[str, Any] = {**STRICT, "fastmath": {"reassoc", "nsz", "arcp", "contract", "afn"}}

# Only Python and C need wrappers around a function, which take a fifth of the time that compiling takes.
KEPT: dict[str, Any] = {"cache": True, "no_cfunc_wrapper": True}
INSIDE: dict[str, Any] = {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

# A function inside a loop: inlined, because a call would keep the loop from being vectorised. Kernels alone call it.
inlined: Any = numba.njit(**INSIDE, **FAST)
strict_inlined: Any = numba.njit(**INSIDE, **STRICT)
intrinsic: Any = untyped_intrinsic

SHARED = (
    "compiled/jit",
    "compiled/elementary_functions",
    "compiled/formats",
    "compiled/random_numbers",
    "compiled/row_buffers",
    "covariance_intersection/criterion",
    "covariance_intersection/scalar_readings",
    "covariance_intersection/newton",
    "covariance_intersection/small_matrices",
    "kalman/decoupled_kernels",
    "kalman/information_kernels",
    "kalman/matrix_kernels",
    "kalman/row_kernels",
    "kalman/sequential_kernels",
    "kalman/split_kernels",
    "models/angles",
    "models/sensors",
    "particle/link_kernels",
    "particle/resampling",
)
SOURCES = [(Path(__file__).parents[1] / f"{name}.py").read_bytes() for name in SHARED]


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a loop when it is first called, with fast mathematics, and keep it on disk until its source changes."""
    return _kept_on_disk(function, FAST)


def strict_kernel(function: Callable[..., Any]) -> Any:
    """`kernel` without fast mathematics: every operation as written."""
    return _kept_on_disk(function, STRICT)


def _kept_on_disk(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    compiled = numba.njit(**KEPT, **options)(function)
    file = Path(function.__code__.co_filename)
    compiled._cache._cache_file._source_stamp = hashlib.sha256(b"".join([*SOURCES, file.read_bytes()])).hexdigest()
    compiled.compile = _in_turn(compiled.compile, kept_at(compiled) / f"{file.stem}.{function.__name__}.lock")
    return compiled


def kept_at(compiled: Any) -> Path:
    """The directory on disk that holds a kernel."""
    return Path(compiled._cache.cache_path)


def _in_turn(compiles: Callable[..., Any], place: Path) -> Callable[..., Any]:
    """Of two processes that need a kernel, the second waits for the first, and finds it on disk."""

    def compile_in_turn(signature: Any) -> Any:
        with ExitStack() as held:
            with suppress(OSError):  # a place that cannot be written, where nothing is kept either
                held.enter_context(FileLock(place, is_singleton=True, thread_local=False))
            return compiles(signature)

    return compile_in_turn


def readable(array: NDArray[Scalar]) -> NDArray[Scalar]:
    """The array as kernels take it: contiguous and read-only, so that each kernel is compiled for one type."""
    array = np.ascontiguousarray(array)
    if not array.flags.writeable:
        return array
    view = array.view()
    view.setflags(write=False)
    return view


def spread_out(array: NDArray[Scalar], shape: tuple[int, ...]) -> NDArray[Scalar]:
    """`readable` of an array that broadcasts to this shape; np.broadcast_to takes ten times as long for a few rows."""
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

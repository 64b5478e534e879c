"""How loops are compiled: `kernel` and `inlined` by numba, `intrinsic` in LLVM, and arrays as kernels take them.

A kernel is kept on disk, and compiled again when its source changes. numba by itself looks at the kernel's own file
only; here the files that kernels take functions and constants from count too (`SHARED`).
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic as untyped_intrinsic
from numpy.typing import NDArray

Scalar = TypeVar("Scalar", bound=np.generic)

STRICT: dict[str, Any] = {"error_model": "numpy"}  # every operation as written: nan and infinity keep their meaning
# Not the full fastmath: it deletes tests for nan.
FAST: dict[str, Any] = {**STRICT, "fastmath": {"reassoc", "nsz", "arcp", "contract", "afn"}}

# A function inside a loop: inlined, because a call would keep the loop from being vectorised.
inlined: Any = numba.njit(forceinline=True, **FAST)
strict_inlined: Any = numba.njit(forceinline=True, **STRICT)
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
    "kalman/matrix_kernels",
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
    compiled = numba.njit(cache=True, **options)(function)
    source = Path(function.__code__.co_filename).read_bytes()
    compiled._cache._cache_file._source_stamp = hashlib.sha256(b"".join([*SOURCES, source])).hexdigest()
    return compiled


def readable(array: NDArray[Scalar]) -> NDArray[Scalar]:
    """The array as kernels take it: contiguous and read-only, so that each kernel is compiled for one type."""
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view


@intrinsic
def wide(context: Any) -> Any:
    """Ask LLVM for 512-bit vectors in the calling function where the processor has them; its default is 256."""

    def generate(target: Any, builder: Any, signature: Any, a: Any) -> Any:
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')  # llvmlite knows no attributes with a value
        return target.get_dummy_value()

    return types.none(), generate

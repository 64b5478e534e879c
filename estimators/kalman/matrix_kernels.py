"""How the loops of this room are compiled, and the small matrix steps that they share."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np

from cooploc.estimators.interface import Array, Mask

Loop = TypeVar("Loop", bound=Callable[..., Any])

# By itself numba compiles again when the file of a kernel changes, not when a file does from which it takes functions.
ROOM = Path(__file__).parent
SOURCES = [path.read_bytes() for path in (*sorted(ROOM.glob("*_kernels.py")), ROOM.parent / "models" / "sensors.py")]


def compiled(loop: Loop) -> Loop:
    """Compile a loop when it is first called, by IEEE's rules, and keep it on disk until its sources change."""
    function: Any = numba.njit(cache=True, error_model="numpy")(loop)
    function._cache._cache_file._source_stamp = hashlib.sha256(b"".join(SOURCES)).hexdigest()
    same: Loop = function
    return same


@compiled
def whiten(C: Array, B: Array) -> None:
    """Turn S (k, k) into its Cholesky factor C, and B (k, m) into C^-1 B, in place."""
    for c in range(len(C)):
        for b in range(c + 1):
            for a in range(b):
                C[c, b] -= C[c, a] * C[b, a]
            if b < c:
                C[c, b] /= C[b, b]
        C[c, c] = np.sqrt(C[c, c])
        for m in range(B.shape[1]):
            for a in range(c):
                B[c, m] -= C[c, a] * B[a, m]
            B[c, m] /= C[c, c]


@compiled
def fill_definite(P: Array, out: Mask) -> None:
    """The last pivot of a Cholesky factor is above 0 if all are, and nan if one before it was not."""
    d = P.shape[1]
    C, nothing = np.empty((d, d)), np.empty((d, 0))
    for s in range(len(P)):
        C[:] = P[s]
        whiten(C, nothing)
        out[s] = C[d - 1, d - 1] > 0


@compiled
def fill_widened(P: Array, Q: Array, out: Array) -> None:
    """(P + P')/2 with Q_i added to P_ii."""
    t, n, d, _ = Q.shape
    for s in range(t):
        out[s] = P[s] + 0.0
        for i in range(n):
            for a in range(d):
                for b in range(d):
                    out[s, i * d + a, i * d + b] += Q[s, i, a, b]
        for a in range(n * d):
            for b in range(a):
                out[s, a, b] = out[s, b, a] = (out[s, a, b] + out[s, b, a]) / 2

"""The particle loops: a counter-based generator and systematic resampling, compiled by numba.

Every random number is a function of (row key, tick, purpose, particle) alone, so results do not depend on how rows are
chunked, ordered or spread over processes. `*_reference` are the same functions in plain numpy; tests hold them equal.

Source of the generator: J. K. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011 (Threefry-2x32-20).
"""

import numba
import numpy as np
from numpy.typing import NDArray

from cooploc.estimators.interface import Array, Indices, Keys

ROTATIONS = (13, 15, 26, 6, 17, 29, 16, 24)
PARITY = 0x1BD11BDA
PURPOSES = 8  # counters a tick may use

INIT, INIT_HEADING, MOVE, RESAMPLE, JITTER, JITTER_HEADING, BOX, AUDIT = range(8)

# Not the full fastmath: it deletes tests for nan.
kernel = numba.njit(cache=True, error_model="numpy", fastmath={"reassoc", "nsz", "arcp", "contract", "afn"})


@kernel
def _threefry(k0, k1, c0, c1):  # type: ignore[no-untyped-def]
    """Two uint32 words for the counter (c0, c1) under the key (k0, k1), held in uint64 and masked."""
    mask = np.uint64(0xFFFFFFFF)
    keys = (np.uint64(k0), np.uint64(k1), np.uint64(k0) ^ np.uint64(k1) ^ np.uint64(PARITY))
    a = (np.uint64(c0) + keys[0]) & mask
    b = (np.uint64(c1) + keys[1]) & mask
    for block in range(5):
        for i in range(4):
            turn = np.uint64(ROTATIONS[(block % 2) * 4 + i])
            a = (a + b) & mask
            b = ((b << turn) | (b >> (np.uint64(32) - turn))) & mask
            b ^= a
        a = (a + keys[(block + 1) % 3]) & mask
        b = (b + keys[(block + 2) % 3] + np.uint64(block + 1)) & mask
    return a, b


@kernel
def _fill_normals(key, counter, out):  # type: ignore[no-untyped-def]
    for r in range(out.shape[0]):
        for i in range(out.shape[1]):
            a, b = _threefry(key[r, 0], key[r, 1], counter, i)
            radius = np.sqrt(-2.0 * np.log((a + 0.5) * 2.0**-32))
            angle = 2.0 * np.pi * (b + 0.5) * 2.0**-32
            out[r, i, 0] = radius * np.cos(angle)
            out[r, i, 1] = radius * np.sin(angle)


@kernel
def _fill_uniforms(key, counter, out):  # type: ignore[no-untyped-def]
    for r in range(out.shape[0]):
        for i in range(out.shape[1]):
            a, b = _threefry(key[r, 0], key[r, 1], counter, i)
            out[r, i, 0] = (a + 0.5) * 2.0**-32
            out[r, i, 1] = (b + 0.5) * 2.0**-32


@numba.njit(cache=True, error_model="numpy")
def _fill_ancestors(w, u, out):  # type: ignore[no-untyped-def]
    rows, n = w.shape
    for r in range(rows):
        total = w[r, 0]
        j = 0
        for i in range(n):
            position = (i + u[r]) / n
            while total <= position and j < n - 1:
                j += 1
                total += w[r, j]
            out[r, i] = j


def normals(key: Keys, tick: int, purpose: int, n: int) -> Array:
    """Standard normal pairs (r, n, 2) by Box-Muller, for particles 0 .. n-1."""
    out = np.empty((len(key), n, 2))
    _fill_normals(key, tick * PURPOSES + purpose, out)
    return out


def uniforms(key: Keys, tick: int, purpose: int, n: int) -> Array:
    """Uniform pairs (r, n, 2) in (0, 1)."""
    out = np.empty((len(key), n, 2))
    _fill_uniforms(key, tick * PURPOSES + purpose, out)
    return out


def systematic(w: Array, u: Array) -> Indices:
    """Systematic resampling: ancestors (r, n) for weights w (r, n) that sum to one and one uniform u (r,) each.

    filterpy's `systematic_resample`, but with the uniform given and without its global generator.
    """
    out = np.empty(w.shape, np.int64)
    _fill_ancestors(np.ascontiguousarray(w), u, out)
    return out


def threefry_reference(key: Keys, counter: int, n: int) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """Threefry-2x32-20 words (r, n), (r, n) in plain numpy."""
    k0, k1 = key[:, :1], key[:, 1:]
    ks = (k0, k1, k0 ^ k1 ^ np.uint32(PARITY))
    a = np.uint32(counter) + ks[0] + np.zeros(n, np.uint32)
    b = np.arange(n, dtype=np.uint32) + ks[1]
    for block in range(5):
        for i in range(4):
            turn = np.uint32(ROTATIONS[(block % 2) * 4 + i])
            a = a + b
            b = ((b << turn) | (b >> np.uint32(32 - turn))) ^ a
        a = a + ks[(block + 1) % 3]
        b = b + ks[(block + 2) % 3] + np.uint32(block + 1)
    return a, b


def normals_reference(key: Keys, tick: int, purpose: int, n: int) -> Array:
    """`normals` in plain numpy."""
    a, b = threefry_reference(key, tick * PURPOSES + purpose, n)
    radius = np.sqrt(-2 * np.log((a + 0.5) * 2.0**-32))
    angle = 2 * np.pi * (b + 0.5) * 2.0**-32
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)

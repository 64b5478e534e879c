"""Random numbers of the particle filters, each a function of (row key, tick, purpose, particle) alone.

So results do not depend on how rows are chunked, ordered or spread over processes.

Source of the generator: J. K. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011 (Threefry-2x32-20).
"""

from typing import Any

import numpy as np
from numba import types

from cooploc.estimators import compiled
from cooploc.estimators.compiled import SINGLE, inlined, intrinsic, kernel, quarter, readable, rotate_quarters, wide
from cooploc.estimators.interface import Array, Keys

ROTATIONS = (13, 15, 26, 6, 17, 29, 16, 24)
PARITY = 0x1BD11BDA
PURPOSES = 8  # counters per tick, one for each of the purposes below

WORDS: Any = types.Tuple((types.uint32, types.uint32))

INIT, INIT_HEADING, MOVE, RESAMPLE, JITTER, JITTER_HEADING, BOX = range(7)

# What filters exchange draws from a further stream of each row: a robot that hears nobody draws what one alone draws.
FURTHER = np.array([0, 0x6A09E667], np.uint32)  # `key ^ FURTHER` is the key of the further stream
SHARE, SENDER, PLACE, NOISE, ANCESTOR, SAMPLE = range(6)  # its purposes


@intrinsic
def threefry(context: Any, k0: Any, k1: Any, c0: Any, c1: Any) -> Any:
    """Compute two uint32 words for the counter (c0, c1) under the key (k0, k1), in true 32-bit integers."""

    def generate(target: Any, builder: Any, signature: Any, a: Any) -> Any:
        word = target.get_value_type(types.uint32)
        k0, k1, x0, x1 = (builder.trunc(v, word) for v in a)
        ks = (k0, k1, builder.xor(builder.xor(k0, k1), word(PARITY)))
        x0, x1 = builder.add(x0, k0), builder.add(x1, k1)
        for i in range(20):
            turn = ROTATIONS[i % 8]
            x0 = builder.add(x0, x1)
            x1 = builder.or_(builder.shl(x1, word(turn)), builder.lshr(x1, word(32 - turn)))
            x1 = builder.xor(x1, x0)
            if i % 4 == 3:
                block = i // 4 + 1
                x0 = builder.add(x0, ks[block % 3])
                x1 = builder.add(builder.add(x1, ks[(block + 1) % 3]), word(block))
        return target.make_tuple(builder, signature.return_type, (x0, x1))

    return WORDS(*[types.int64] * 4), generate


@inlined
def draw_words(k0, k1, counter, words):
    """Write Threefry's words (2, n) of particles 0 .. n-1, apart from any floats: a vector then holds twice as many."""
    wide()
    first, second = words[0], words[1]
    for i in range(words.shape[1]):
        first[i], second[i] = threefry(k0, k1, counter, i)


@compiled.by_format
def normal_pair(f):
    """Return two standard normals by Box-Muller from two words, in the format of the first argument."""
    real, word, spare = f.real, f.word, 2 if f is SINGLE else 34  # bits of an integer above the lower 30
    two, turn, start = real(-2), real(2 * np.pi * 2.0**-32), real(np.pi * 2.0**-32)
    if f is SINGLE:  # from 31 bits: an integer with a sign becomes a number sooner
        uniform = inlined(lambda a: np.float32(np.int32(a >> 1)) * np.float32(2.0**-31) + np.float32(2.0**-32))
    else:
        uniform = inlined(lambda a: a * 2.0**-32 + 2.0**-33)

    def normal_pair(_, a, b):
        radius = np.sqrt(two * compiled.log(uniform(a)))
        right_angles, rest = word(np.int64(b) + 2**29) >> 30, word(np.int64(b) << spare) >> spare  # the rest has a sign
        c, s = quarter(real(rest) * turn + start)
        c, s = rotate_quarters(right_angles, c, s)
        return radius * c, radius * s

    return normal_pair


@inlined
def normal_pairs(words, X, Y):
    """Write the standard normals of `words` (2, n)."""
    wide()
    first, second, like = words[0], words[1], X.dtype.type(0)
    for i in range(len(X)):
        X[i], Y[i] = normal_pair(like, first[i], second[i])


@inlined
def uniform_pair(k0, k1, counter, i):
    """Return two uniforms in (0, 1)."""
    a, b = threefry(k0, k1, counter, i)
    return (a + 0.5) * 2.0**-32, (b + 0.5) * 2.0**-32


@kernel
def _fill_normals(key, counter, out):
    wide()
    words = np.empty((2, out.shape[1] // 2), np.uint32)
    for r in range(out.shape[0]):
        draw_words(np.int64(key[r, 0]), np.int64(key[r, 1]), counter, words)
        row, first, second = out[r], words[0], words[1]
        for i in range(len(first)):
            row[2 * i], row[2 * i + 1] = normal_pair(0.0, first[i], second[i])


@kernel
def _fill_uniforms(key, counter, out):
    wide()
    for r in range(out.shape[0]):
        k0, k1 = np.int64(key[r, 0]), np.int64(key[r, 1])
        row = out[r]
        for i in range(out.shape[1] // 2):
            row[2 * i], row[2 * i + 1] = uniform_pair(k0, k1, counter, i)


def normals(key: Keys, tick: int, purpose: int, n: int) -> Array:
    """Return standard normal pairs (r, n, 2) by Box-Muller, for particles 0 .. n-1."""
    out = np.empty((len(key), 2 * n))
    _fill_normals(readable(key), tick * PURPOSES + purpose, out)
    return out.reshape(-1, n, 2)


def uniforms(key: Keys, tick: int, purpose: int, n: int) -> Array:
    """Return uniform pairs (r, n, 2) in (0, 1)."""
    out = np.empty((len(key), 2 * n))
    _fill_uniforms(readable(key), tick * PURPOSES + purpose, out)
    return out.reshape(-1, n, 2)

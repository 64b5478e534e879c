"""Buffers for one row of an array, where compiled loops work on it: whole vectors that stay in the first cache."""

import numpy as np

from cooploc.estimators.compiled.formats import ordered
from cooploc.estimators.compiled.jit import inlined, wide


@inlined
def load(rows, r, out):
    """Row r into a buffer, filled up with its first entry. A view of the row would cost the counting of a reference."""
    wide()
    for i in range(rows.shape[1]):
        out[i] = rows[r, i]
    fill(out, rows.shape[1], rows[r, 0])


@inlined
def fill(out, first, value):
    """The value into a buffer from `first` on."""
    for i in range(first, len(out)):
        out[np.uint64(i)] = value


@inlined
def store(values, rows, r):
    """A buffer into row r."""
    wide()
    for i in range(rows.shape[1]):
        rows[r, i] = values[i]


@inlined
def row_buffer(rows):
    """A buffer for one of these rows, in whole vectors: a remainder would be computed number by number."""
    return np.empty((rows.shape[1] + 15) // 16 * 16, rows.dtype)


@inlined
def extent(values):
    """The smallest and the largest of a row."""
    wide()
    low = high = ordered(values[0])
    for i in range(len(values)):
        low, high = min(low, ordered(values[i])), max(high, ordered(values[i]))
    return ordered(low), ordered(high)

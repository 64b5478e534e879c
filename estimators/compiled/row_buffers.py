"""Rows of arrays in scratch, where compiled loops work on them: whole vectors that stay in the first cache."""

import numpy as np

from cooploc.estimators.compiled.elementary_functions import ordered
from cooploc.estimators.compiled.jit import inlined, wide


@inlined
def take(rows, r, out):  # type: ignore[no-untyped-def]
    """Row r into scratch, its first entry to the end. A view of the row instead would be a reference to count."""
    wide()
    for i in range(rows.shape[1]):
        out[i] = rows[r, i]
    fill(out, rows.shape[1], rows[r, 0])


@inlined
def fill(out, first, value):  # type: ignore[no-untyped-def]
    """Scratch from `first` on."""
    for i in range(first, len(out)):
        out[np.uint64(i)] = value


@inlined
def give(values, rows, r):  # type: ignore[no-untyped-def]
    """Scratch into row r."""
    wide()
    for i in range(rows.shape[1]):
        rows[r, i] = values[i]


@inlined
def blank(n):  # type: ignore[no-untyped-def]
    """Room for a row in whole vectors: what is left of a row would be computed one by one."""
    return np.empty((n + 15) // 16 * 16)


@inlined
def extent(values):  # type: ignore[no-untyped-def]
    """The smallest and the largest of a row."""
    wide()
    low = high = ordered(values[0])
    for i in range(len(values)):
        low, high = min(low, ordered(values[i])), max(high, ordered(values[i]))
    return ordered(low), ordered(high)

"""The hash of a trial, which says whether two results are paired: they are where their trials' hashes are equal."""

import hashlib
from collections.abc import Iterable, Mapping

import numpy as np

from cooploc.estimators.interface import Array


def hash_of_trial(arrays: Mapping[str, Array], i: int) -> str:
    """SHA-256 over the names, shapes and canonical little-endian values of row `i` of every array."""
    digest = hashlib.sha256()
    for name, array in arrays.items():
        one = np.ascontiguousarray(array[i])
        one = one.astype(one.dtype.newbyteorder("<"))
        if one.dtype.kind == "f":
            one[np.isnan(one)] = np.nan  # one nan, whatever its bits
        digest.update(f"{name} {one.dtype.str} {one.shape};".encode())
        digest.update(one.data)
    return digest.hexdigest()


def hash_of_trials(hashes: Iterable[str]) -> str:
    """The hash of the trials' hashes."""
    return hashlib.sha256("".join(hashes).encode()).hexdigest()

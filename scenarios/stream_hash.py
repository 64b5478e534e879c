"""The hash of a trial, which says whether two results are paired: they are where their trials' hashes are equal."""

import hashlib
import re
from collections.abc import Iterable, Mapping

import numpy as np

from cooploc.estimators.interface import Array


def hash_of_trial(arrays: Mapping[str, Array], i: int, assumed: str = "") -> str:
    """Return SHA-256 over names, shapes and little-endian values of row `i` of every array, and over `assumed`."""
    digest = hashlib.sha256()
    for name, array in arrays.items():
        one = np.ascontiguousarray(array[i])
        one = one.astype(one.dtype.newbyteorder("<"))
        if one.dtype.kind == "f":
            one[np.isnan(one)] = np.nan  # one nan, whatever its bits
        digest.update(f"{name} {one.dtype.str} {one.shape};".encode())
        digest.update(one.data)
    digest.update(assumed.encode())
    return digest.hexdigest()


def assumptions(label: str) -> str:
    """Return the assumptions in a scenario's label that differ from the truth, in one form."""
    found = re.findall(r"[\[,]\s*(assumed\.[^=,\]]+?)\s*=\s*([^,\]]+)", label)
    return ";".join(sorted(f"{key}={_number(value.strip())}" for key, value in found))


def _number(value: str) -> str:
    """A number in one form, "2", "2.0" or "2e0"; any other text as it is."""
    try:
        return repr(float(value))
    except ValueError:
        return value


def hash_of_trials(hashes: Iterable[str]) -> str:
    """The hash of the trials' hashes."""
    return hashlib.sha256("".join(hashes).encode()).hexdigest()

"""The counter-based generator against its published vectors, and the distributions of what it draws."""

import numba
import numpy as np
import oracles
import pytest
from scipy.stats import kstest

from cooploc.estimators import random_numbers

KEY = np.array([[0x13198A2E, 0x03707344]], np.uint32)


@numba.njit
def threefry(k0, k1, c0, c1):
    return random_numbers.threefry(k0, k1, c0, c1)


# Random123, examples/kat_vectors: threefry 2x32, 20 rounds, as (counter, key, result)
KNOWN = [
    ((0x00000000, 0x00000000), (0x00000000, 0x00000000), (0x6B200159, 0x99BA4EFE)),
    ((0xFFFFFFFF, 0xFFFFFFFF), (0xFFFFFFFF, 0xFFFFFFFF), (0x1CB996FC, 0xBB002BE7)),
    ((0x243F6A88, 0x85A308D3), (0x13198A2E, 0x03707344), (0xC4923A9C, 0x483DF7A0)),
]


@pytest.mark.parametrize(("counter", "key", "result"), KNOWN)
def test_published_vectors(counter, key, result):
    by_numpy = oracles.threefry(np.array([key], np.uint32), counter[0], np.array([counter[1]]))
    assert tuple(word.item() for word in by_numpy) == result
    assert tuple(map(int, threefry(*key, *counter))) == result


@pytest.mark.parametrize("tick", [0, 1, 199, 100_000])
def test_compiled_normals_equal_the_numpy_reference(tick):
    key = np.random.default_rng(tick).integers(0, 2**32, (5, 2), np.uint32)
    compiled = random_numbers.normals(key, tick, random_numbers.MOVE, 300)
    np.testing.assert_allclose(compiled, oracles.normals(key, 8 * tick + random_numbers.MOVE, 300), rtol=0, atol=1e-12)


def test_normals_have_the_distribution_they_claim():
    z = random_numbers.normals(KEY, 3, random_numbers.MOVE, 400_000)[0]
    n = len(z)
    assert all(kstest(axis, "norm").pvalue > 1e-3 for axis in z.T)
    assert abs(np.corrcoef(z.T)[0, 1]) < 4 / np.sqrt(n)
    assert abs(np.corrcoef(z.T**2)[0, 1]) < 4 / np.sqrt(n)

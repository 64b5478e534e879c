"""Systematic resampling against filterpy's, and what it promises."""

import filterpy.monte_carlo.resampling as filterpy_resampling
import numpy as np
import pytest
from filterpy.monte_carlo import systematic_resample
from hypothesis import given
from hypothesis import strategies as st
from oracles import repeatable

from cooploc.estimators.particle_kernels import systematic

weights = st.lists(st.floats(0, 1), min_size=2, max_size=40).filter(lambda w: sum(w) > 1e-3)


def resample(w, u):
    return systematic(np.array([w]), np.array([u]))[0]


@given(weights, st.integers(0, 2**53 - 1))
@repeatable
def test_ancestors_are_filterpys_for_the_same_uniform(w, bits):
    w, u = np.array(w) / np.sum(w), bits / 2**53
    if (u + len(w) - 1) / len(w) >= np.cumsum(w)[-1]:
        return  # filterpy runs off the end of weights that sum to just less than one
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(filterpy_resampling, "random", lambda: u)
        theirs = systematic_resample(w)
    np.testing.assert_array_equal(resample(w, u), theirs)


@given(weights)
@repeatable
def test_resampling_is_unbiased_over_its_uniform(w):
    w = np.array(w) / np.sum(w)
    n, draws = len(w), 2000
    u = (np.arange(draws) + 0.5) / draws
    counts = np.stack([np.bincount(c, minlength=n) for c in systematic(np.tile(w, (draws, 1)), u)])
    # Each count is a step function of u with two jumps at most, so the midpoint rule is off by 2/draws at most.
    np.testing.assert_allclose(counts.mean(0), n * w, atol=2.1 / draws)


@pytest.mark.parametrize("bad", [np.nan, -1.0, np.inf, -np.inf, 1e300])
def test_bad_weights_choose_particles_that_exist(bad):
    """Whatever they choose: nothing is written or read beside the row."""
    w = np.full((3, 40), 1 / 40)
    w[1, ::7] = bad
    chosen = systematic(w, np.full(3, 0.5))
    assert ((chosen >= 0) & (chosen < 40)).all()
    np.testing.assert_array_equal(chosen[[0, 2]], np.tile(np.arange(40), (2, 1)))

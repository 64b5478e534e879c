"""A cloud of particles may collapse: what is left of its covariance is zero, and no fault."""

import numpy as np
import pytest

from cooploc.scenarios import simulate
from cooploc.scenarios.runner.tick import EstimatorError
from cooploc.scenarios.runner.trace import require_covariances

UNSOUND = np.array([[1.0, 2.0], [2.0, 1.0]])  # its variances along the diagonals are 3 and -1


@pytest.mark.parametrize("size", [0.0, 5e-324, 1e-310, 1e-250])
def test_a_covariance_of_subnormal_numbers_is_zero(size):
    _, stream = simulate("trajectory[ticks=2]")
    require_covariances("mine", stream, np.broadcast_to(size * UNSOUND, (1, 2, 3, 2, 2)))


def test_a_small_one_is_still_looked_at():
    _, stream = simulate("trajectory[ticks=2]")
    with pytest.raises(EstimatorError, match="negative variance"):
        require_covariances("mine", stream, np.broadcast_to(1e-150 * UNSOUND, (1, 2, 3, 2, 2)))

"""Huber's least squares."""

import numpy as np
import pytest
from statsmodels.api import RLM
from statsmodels.robust.norms import HuberT
from statsmodels.robust.scale import HuberScale

from cooploc.scenarios.recordings.fit import K, huber


@pytest.mark.parametrize("outliers", [0.0, 0.1, 0.3])
def test_it_is_that_of_statsmodels(outliers):
    rng = np.random.default_rng(1)
    X = np.stack([np.ones(600), rng.uniform(-3, 3, 600)], -1)
    y = X @ [2.0, -0.7] + 0.3 * rng.normal(size=600) + 9.0 * (rng.random(600) < outliers)
    theirs = RLM(y, X, M=HuberT(K)).fit(scale_est=HuberScale(K, tol=1e-10, maxiter=500), tol=1e-10, maxiter=500)
    ours = huber(X, y)
    np.testing.assert_allclose(ours.beta, theirs.params, rtol=1e-5)
    assert ours.sigma == pytest.approx(theirs.scale, rel=1e-4)


def test_one_bad_run_in_ten_turns_it_by_little_and_least_squares_by_much():
    rng = np.random.default_rng(2)
    x = rng.uniform(0.5, 1.5, 1000)
    y = 0.98 * x + 0.05 * rng.normal(size=1000)
    y[:100] = -0.5 * x[:100]
    assert abs(huber(x[:, None], y).beta[0] - 0.98) < 0.02
    assert abs(np.linalg.lstsq(x[:, None], y)[0][0] - 0.98) > 0.1


def test_what_fits_exactly_has_no_noise():
    x = np.arange(1.0, 20.0)
    line = huber(x[:, None], 3 * x)
    assert line.beta[0] == pytest.approx(3)
    assert line.sigma < 1e-9
    assert huber(np.empty((5, 0)), np.zeros(5)).sigma == 0

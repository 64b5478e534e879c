"""What tuning makes small: robust, proper, and the worst for what fails."""

import numpy as np
import pandas as pd
import pytest

import cooploc as cl
from cooploc.analysis.tuning.search import CAP, LARGEST, cap_score, trial_scores
from cooploc.estimators.plugins.errors import BadInput


def rows(**columns):
    table = {"trial": [0, 0, 1, 1], "ticks": [10, 10, 10, 10], "nll": [1.0, 2.0, 3.0, 4.0], "mse": [1.0] * 4}
    return pd.DataFrame({**table, "failure": [None] * 4, **columns})


def test_the_cap_keeps_the_order_and_takes_the_weight():
    nll = np.array([-5.0, 0.0, CAP, CAP + 1, 1e3, 1e5, np.inf])
    found = cap_score(nll)
    np.testing.assert_array_equal(found[:3], nll[:3])
    assert (np.diff(found) > 0).all()
    assert found[-1] < CAP + 15
    assert cap_score(np.array([np.nan]))[0] == cap_score(np.array([LARGEST]))[0]


def test_a_trial_s_score_is_the_mean_over_its_robots():
    assert trial_scores(rows(), "nll").tolist() == [1.5, 3.5]
    assert trial_scores(rows(mse=[4.0, 4.0, 1.0, 1.0]), "rmse").tolist() == pytest.approx([np.log(2), 0.0])


@pytest.mark.parametrize("objective", ["nll", "rmse"])
def test_a_trial_that_failed_is_worse_than_any_other(objective):
    table = rows(
        failure=["it raised", "it raised", None, None], nll=[np.nan, np.nan, 1e5, 1e5], ticks=[np.nan] * 2 + [9] * 2
    )
    scores = trial_scores(table, objective)
    assert scores[0] > scores[1]
    assert np.isfinite(scores).all()


def test_claiming_to_be_surer_does_not_pay_by_likelihood_and_is_not_seen_by_rmse():
    truth, stream = cl.simulate("robots-1-3/n=1[ticks=60]", trials=6, seed=2)
    names = ["ekf-local[anchor_reading=rssi]", "ekf-local[anchor_reading=rssi,inflation=0.2]"]
    table = cl.errors(truth, cl.run(names, stream)).assign(failure=None)
    nll = [trial_scores(table[table["estimator"] == name], "nll").mean() for name in names]
    assert nll[0] + 0.5 < nll[1]


def test_an_objective_that_there_is_not_is_refused_with_the_nearest():
    with pytest.raises(BadInput, match="nll"):
        trial_scores(rows(), "nnl")

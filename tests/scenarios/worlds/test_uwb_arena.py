"""The world `uwb`: its ranges err as recorded ones do."""

import numpy as np
import pytest

from cooploc.scenarios import simulate
from cooploc.scenarios.worlds.uwb import residual, residual_quantiles, residual_sd

# Of another recording of the same two robots, seven minutes before from a recording in uwb-tiers.
LEVELS = [0.05, 0.1, 0.25, 0.75, 0.9, 0.95]
OTHER = [-0.1087, -0.0861, -0.0473, 0.0366, 0.0701, 0.0882]  # [m] around its median


def errors(**parameters):
    """Range minus distance (trials, T, n, n), nan on the diagonal."""
    truth, stream = simulate("uwb", trials=20, seed=3, **parameters)
    delta = truth.x[:, :, :, None] - truth.x[:, :, None]
    return stream.air.range - np.hypot(delta[..., 0], delta[..., 1])


def pairs(error):
    """The errors (pairs over all trials, T) of each pair once."""
    i, j = np.triu_indices(error.shape[2], 1)
    return np.moveaxis(error[:, :, i, j], 1, -1).reshape(-1, error.shape[1])


def test_the_spread_around_a_pairs_median_is_that_of_another_recording_within_a_tenth():
    each = pairs(errors(tick=5.0, range_bias_sd=0.0))  # ticks far apart, as the quantiles of a memory converge slowly
    found = np.quantile(each - np.median(each), LEVELS)
    assert np.allclose(found, OTHER, rtol=0.12), found / OTHER  # 10 % and the sampling error of 12,000 readings


def test_the_recorded_residuals_have_no_mean_and_the_spread_that_the_team_assumes():
    levels, quantiles = residual_quantiles()
    assert abs(np.trapezoid(quantiles, levels)) < 1e-3
    drawn = residual(np.random.default_rng(1).normal(size=100_000))
    assert drawn.std() == pytest.approx(residual_sd(), rel=0.02)


def test_each_pair_has_a_bias_of_its_own_that_lasts_for_a_trial():
    bias = pairs(errors()).mean(-1)
    assert bias.mean() == pytest.approx(0.32, abs=0.04)
    assert bias.std() == pytest.approx(0.08, abs=0.025)


def test_both_robots_of_a_pair_read_the_same_and_removing_the_mean_bias_shifts_every_range_by_it():
    error, shifted = errors(), errors(bias="removed")
    assert np.array_equal(error, error.transpose(0, 1, 3, 2), equal_nan=True)
    np.testing.assert_allclose(pairs(error - shifted), 0.32)
    raw, removed = (simulate("uwb", trials=1, bias=b)[1].world.sensors["radio_range"].sigma for b in ("raw", "removed"))
    assert (raw, removed) == pytest.approx((0.1, np.hypot(0.08, residual_sd())))


def test_a_wall_between_two_robots_makes_their_range_longer():
    walls = {"walls": ((3.0, 0.0, 3.0, 6.0),)}
    added = pairs(errors(**walls, nlos_range_bias=0.7)) - pairs(errors(**walls))
    assert np.unique(added.round(9)).tolist() == [0.0, 0.7]


def test_a_residual_is_remembered_for_about_two_seconds():
    each = pairs(errors(tick=0.5, range_bias_sd=0.0))
    each = each - each.mean()

    def correlation(lag):
        return (each[:, lag:] * each[:, :-lag]).mean() / each.var()

    assert 0.35 < correlation(1) < 0.6
    assert correlation(10) < 0.1


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_outliers_come_late_and_lost_readings_are_absent_in_the_share_asked_for(share):
    excess = pairs(errors(outliers=share)) - pairs(errors())
    late = excess > 1e-9
    assert late.mean() == pytest.approx(share, abs=0.015)
    assert excess[late].mean() == pytest.approx(0.5, rel=0.1)
    assert np.abs(excess[~late]).max() < 1e-9
    assert np.isnan(pairs(errors(lost=share))).mean() == pytest.approx(share, abs=0.02)


def test_the_radio_arena_around_it_is_the_same_to_the_bit():
    uwb, paper = simulate("uwb", trials=2, seed=5)[1], simulate("trajectory", trials=2, seed=5)[1]
    assert np.array_equal(uwb.senses.odometry, paper.senses.odometry)
    assert np.array_equal(uwb.senses.anchor_rssi, paper.senses.anchor_rssi)
    assert np.array_equal(uwb.air.rssi, paper.air.rssi, equal_nan=True)

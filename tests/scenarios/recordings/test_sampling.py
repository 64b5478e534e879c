"""Series and readings on a grid of ticks."""

import numpy as np
import pytest
from made_team import TICK, drive

from cooploc.estimators.errors import BadInput
from cooploc.estimators.models import Unicycle, wrap
from cooploc.scenarios.recordings import sampling
from cooploc.scenarios.recordings.sampling import Grid
from cooploc.scenarios.recordings.team_log import Places, ReadingSeries, Series, TeamLog

NOWHERE = Places((), np.empty((0, 2)))


@pytest.fixture(scope="module")
def motions():
    return drive(3, seconds=20.0)


def grid(motions, start=0.0, ticks=150):
    return Grid(motions.time[0] + start, TICK, ticks)


def series(motions, kind):
    """What a perfect sensor of a kind logs of robot 0."""
    u, time, pose = motions.u[:, 0], motions.time, motions.pose[:, 0]
    if kind == "velocity":
        return Series(time[:-1], u, kind)
    if kind == "path":
        length = 5.0 + np.concatenate([[0.0], np.cumsum(u[:, 0]) * TICK / 2])
        return Series(time, np.column_stack([length, np.append(u[:, 1], 0.0)]), kind)
    if kind == "displacement":
        return Series(time, np.diff(pose[:, :2], axis=0, prepend=[[7.0, 7.0]]), kind)
    c, s = np.cos(1.0), np.sin(1.0)  # a frame of its own
    own = np.column_stack([pose[:, :2] @ np.array([[c, s], [-s, c]]) + [3.0, -4.0], wrap(pose[:, 2] + 1.0)])
    return Series(time, own, kind)


@pytest.mark.parametrize("kind", ["velocity", "path", "pose"])
def test_any_odometry_leads_along_the_same_path(motions, kind):
    g = grid(motions)
    u = sampling.odometry(kind, series(motions, kind), g, 0.5)
    at, exact = motions.pose[0, 0], Unicycle(0.0, 0.0)
    for k in range(g.ticks):
        at = exact.move(at, u[k], np.array(TICK))[0]
        assert np.abs(at[:2] - motions.pose[2 * (k + 1), 0, :2]).max() < 2e-3
    assert abs(wrap(at[2] - motions.pose[2 * g.ticks, 0, 2])) < 1e-6


@pytest.mark.parametrize(
    ("kind", "known"), [("velocity", False), ("path", True), ("pose", True), ("displacement", True)]
)
def test_across_a_gap_a_speed_is_unknown_and_a_counter_is_not(motions, kind, known):
    whole, g = series(motions, kind), grid(motions)
    kept = (whole.time < motions.time[100]) | (whole.time > motions.time[140])
    values = whole.values[kept]
    if kind == "displacement":  # since the line before, wherever that is
        values[100] += whole.values[~kept].sum(0)
    gap = sampling.odometry(kind, Series(whole.time[kept], values, ""), g, 0.5)
    full = sampling.odometry(kind, whole, g, 0.5)
    inside = np.isnan(gap[:, 0])
    assert inside.any() != known
    assert not np.isnan(np.concatenate([gap[:48], gap[72:]])).any()
    np.testing.assert_allclose(gap[:48], full[:48], atol=1e-9)
    if known and kind != "pose":
        assert gap[:, 0].sum() == pytest.approx(full[:, 0].sum(), abs=1e-6)


def test_truth_is_not_invented_across_gaps_and_headings_turn_the_short_way():
    time = np.array([0.0, 0.1, 0.2, 1.2, 1.3])
    values = np.array([[0, 0, 3.1], [1, 0, -3.1], [2, 0, np.nan], [9, 0, 0.0], [10, 0, 0.0]])
    found = sampling.poses(Series(time, values, ""), np.array([-0.1, 0.05, 0.15, 0.7, 1.25, 1.4]), 0.5)
    np.testing.assert_allclose(found[:, 0], [np.nan, 0.5, 1.5, np.nan, 9.5, np.nan])
    assert abs(wrap(found[1, 2] - np.pi)) < 1e-9
    assert np.isnan(found[2, 2])  # from 0.1 s on the next heading is 1.1 s away
    assert np.isnan(sampling.poses(None, np.zeros(3), 0.5)).all()


def test_a_reading_is_at_the_tick_nearest_to_its_stamp():
    g = Grid(100.0, 0.1, 5)
    time = np.array([100.04, 100.06, 100.14, 100.16, 100.54, 100.56])
    readings = ReadingSeries(time, np.zeros(6, int), np.ones(6, int), np.arange(6.0)[:, None], "")
    table, counts = sampling.cells(readings, g, 2, 2)
    np.testing.assert_array_equal(table[:, 0, 1, 0], [2, 3, np.nan, np.nan, 4])
    assert np.isnan(table[:, 1]).all()
    assert counts == {"readings": 6, "kept": 3, "collisions": 1, "outside_span": 2}


def test_ranges_that_go_to_both_are_used_once_each():
    rng = np.random.default_rng(0)
    robot = rng.integers(0, 3, 40)
    other = (robot + rng.integers(1, 3, 40)) % 3
    before = ReadingSeries(np.arange(40.0), robot, other, np.arange(40.0)[:, None], "")
    after = sampling.alternate_ranges(before)
    np.testing.assert_array_equal(after.values, before.values)
    for a, b in ((0, 1), (0, 2), (1, 2)):
        of_pair = [set(pair) == {a, b} for pair in zip(robot, other, strict=True)]
        np.testing.assert_array_equal(np.sort([after.robot, after.other], 0)[:, of_pair].T, [[a, b]] * sum(of_pair))
        np.testing.assert_array_equal(after.robot[of_pair], ([a, b] * 40)[: sum(of_pair)])


def test_the_span_is_where_all_have_odometry_and_any_has_truth():
    def one(*time):
        return Series(np.array(time), np.zeros((len(time), 3)), str(time))

    def span(odometry, truth):
        return sampling.span(TeamLog("x", ("a", "b"), "pose", odometry, truth, {}, NOWHERE, NOWHERE))

    assert span((one(0, 9), one(1, 8)), (one(2, 5), one(0, 7))) == (2, 7)
    assert span((one(0, 9), one(1, 8)), (None, one(0, 20))) == (1, 8)
    with pytest.raises(BadInput, match="they share no time: state clock_offset"):
        span((one(0, 9), one(1, 8)), (None, one(100, 120)))

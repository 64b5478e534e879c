"""What is odd about a recording is named, and nothing where nothing is; on simulated teams whose truth is known."""

import numpy as np
import pytest
from made_teams import GLITCHES, WORLDS, changed_truth, team_log

from cooploc.scenarios.recordings.inspect.dead_reckoned import dead_reckoned
from cooploc.scenarios.recordings.inspect.finding import KINDS
from cooploc.scenarios.recordings.inspect.looks import findings, look_at_all
from cooploc.scenarios.recordings.inspect.robust import slope
from cooploc.scenarios.recordings.inspect.series_table import measured_counts, series_rows

SURE = {  # of a hundred teams, ninety-five or more; the rest depends on how often robots see each other
    name for name in GLITCHES if name not in ("a biased pair", "teammates exchanged", "clock of the ranges")
}


@pytest.mark.parametrize("world", WORLDS)
def test_a_clean_team_has_no_finding(world):
    assert findings(team_log(world, seed=1)) == ()


@pytest.mark.parametrize("name", sorted(SURE))
def test_a_glitch_is_named_with_its_robot_and_the_setting_to_change(name):
    kind, robot, worlds, spoil = GLITCHES[name]
    found = [f for f in findings(spoil(team_log(worlds[-1], seed=2))) if (f.kind, f.robot) == (kind, robot)]
    assert found, f"{name} was not named"
    assert found[0].fact
    assert found[0].change.setting


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(GLITCHES) - SURE))
def test_what_needs_many_readings_is_named_in_most_teams(name):
    kind, robot, worlds, spoil = GLITCHES[name]
    teams = [team_log(world, seed) for seed in range(3) for world in worlds]
    named = [(kind, robot) in {(f.kind, f.robot) for f in findings(spoil(team))} for team in teams]
    assert np.mean(named) > 0.5


def test_every_kind_that_a_glitch_has_is_explained():
    assert {kind for kind, *_ in GLITCHES.values()} <= set(KINDS)


def test_the_offset_of_a_clock_is_what_it_was_shifted_by():
    log = changed_truth(team_log("no-compass", 3), 1, lambda t, v: (t + 12.5, v))
    setting = next(f.change.setting for f in findings(log) if f.kind == "clock")
    assert float(setting.split("= ")[1].split(";")[0]) == pytest.approx(-12.5, abs=0.5)


def test_stamps_without_a_time_in_common_are_a_clock():
    log = changed_truth(team_log("no-compass", 3), 1, lambda t, v: (t + 1.7e9, v))
    assert [(f.kind, f.robot) for f in findings(log)] == [("clock", "r1")]


def test_what_is_corrected_for_the_eye_is_the_clean_recording():
    clean = team_log("camera", 4)
    log = changed_truth(clean, 1, lambda t, v: (t, v * [1000, 1000, 1]))
    np.testing.assert_allclose(look_at_all(log).log.truth[1].values, clean.truth[1].values)


def test_the_recording_itself_is_not_changed():
    log = changed_truth(team_log("camera", 4), 1, lambda t, v: (t, v * [1000, 1000, 1]))
    before = log.truth[1].values.copy()
    findings(log)
    np.testing.assert_array_equal(log.truth[1].values, before)


def test_a_robot_without_truth_and_one_that_stands_are_no_findings():
    log = team_log("camera", 5)
    still = log.truth[1]._replace(values=np.tile([2.0, 2.0, 0.0], (len(log.truth[1].time), 1)))
    odometry = (*log.odometry[:1], log.odometry[1]._replace(values=0 * log.odometry[1].values), *log.odometry[2:])
    alone = log._replace(truth=(None, still, log.truth[2]), odometry=odometry, readings={})
    assert findings(alone) == ()


def test_an_arena_that_is_stated_holds_the_truth():
    found = findings(team_log("camera", 1), np.array([[0.0, 0.0], [4.0, 4.0]]))
    assert {f.kind for f in found} == {"outside"}


def test_half_of_the_samples_may_be_wrong_for_a_slope(rng):
    x = rng.normal(0, 1, 400)
    y = 3 * x + rng.normal(0, 0.1, 400)
    y[:160] = rng.normal(0, 100, 160)
    b, error = slope(x, y)
    assert b == pytest.approx(3, abs=0.1)
    assert 0 < error < 0.1


def test_dead_reckoning_without_noise_is_the_truth():
    log = team_log("no-compass", 6, ticks=80)
    truth = log.truth[0].values
    u = np.column_stack([np.hypot(*np.diff(truth[:, :2], axis=0).T), np.angle(np.exp(1j * np.diff(truth[:, 2])))])
    exact = log.odometry[0]._replace(time=log.truth[0].time, values=np.vstack([u, [0, 0]]))
    found = dead_reckoned(log._replace(odometry=(exact, *log.odometry[1:])), 0)
    np.testing.assert_allclose(found, truth[:, :2], atol=1e-9)


def test_rows_and_counts_are_those_of_the_series():
    log = team_log("camera", 7)
    rows = {(row.series, row.of): row for row in series_rows(log)}
    assert rows["odometry", "r0"].rate == pytest.approx(10)
    sightings = sum(row.samples for (series, _), row in rows.items() if series == "sighting")
    assert sightings == len(log.readings["sighting"].time)
    robots, names, counts = measured_counts(log)
    assert counts[:, : len(robots)].sum() == sightings
    assert counts.sum() == sum(len(readings.time) for readings in log.readings.values())
    assert names[len(robots) :] == log.landmarks.names

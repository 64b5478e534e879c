"""What is odd about a recording is found, and nothing where nothing is; on simulated teams whose truth is known."""

import re
import tomllib

import numpy as np
import pytest

import cooploc as cl
from cooploc.analysis.plot.worlds import finding
from cooploc.scenarios.recordings.inspect.checks import check_recording
from cooploc.scenarios.recordings.inspect.inspection import count_measurements, series_rows
from cooploc.scenarios.recordings.inspect.motion import dead_reckoned
from cooploc.scenarios.recordings.sampling import ends
from cooploc.scenarios.recordings.team_log import Places, ReadingSeries, Series, TeamLog

WORLDS = {"camera": 600, "no-compass": 300, "trajectory": 300}  # family -> ticks


def team_log(family, seed, ticks=None):
    """A clean recording of a simulated team."""
    truth, stream = cl.simulate(f"{family}[ticks={ticks or WORLDS[family]}]", trials=1, seed=seed)
    n, t, senses, air, world = stream.robots, stream.time, stream.senses, stream.air, stream.world
    robots = tuple(f"r{i}" for i in range(n))
    compass = truth.x.shape[-1] == 2
    begin = t if compass else t - world.tick  # a displacement is since the line before, a speed until the next
    poses = np.full((len(t), n, 3), np.nan)
    poses[:, :, : truth.x.shape[-1]] = truth.x[0]
    channels = {"landmark": senses.landmark[0], "sighting": senses.sighting[0]}
    channels |= {"anchor_rssi": senses.anchor_rssi[0][..., None], "range": air.range[0][..., None]}
    channels |= {"rssi": air.rssi[0][..., None]}
    readings = {}
    for name, values in channels.items():
        if values.size:
            tick, robot, other = np.nonzero(np.isfinite(values[..., 0]))
            readings[name] = ReadingSeries(t[tick], robot, other, values[tick, robot, other], name)
    places = [np.asarray(p, float).reshape(-1, 2) for p in (world.landmarks, world.anchors)]
    landmarks, anchors = (Places(tuple(f"{a}{k}" for k in range(len(p))), p) for a, p in zip("LA", places, strict=True))
    return TeamLog(
        name="simulated",
        robots=robots,
        odometry_kind="displacement" if compass else "velocity",
        odometry=tuple(Series(begin, senses.odometry[0][:, i], f"odom_{r}") for i, r in enumerate(robots)),
        truth=tuple(Series(t, poses[:, i], f"truth_{r}") for i, r in enumerate(robots)),
        readings=readings,
        landmarks=landmarks,
        anchors=anchors,
    )


def series(table, robot, change):
    """Plant a fault in one robot's "truth" or "odometry": change(time, values) -> (time, values)."""

    def plant(log):
        every = list(getattr(log, table))
        time, values = change(every[robot].time.copy(), every[robot].values.copy())
        every[robot] = every[robot]._replace(time=time, values=values)
        return log._replace(**{table: tuple(every)})

    return plant


def readings(channels, field, change):
    """Plant a fault in a field of the first of the channels that a recording has."""

    def plant(log):
        channel = next(channel for channel in channels if channel in log.readings)
        changed = log.readings[channel]._replace(**{field: change(log.readings[channel])})
        return log._replace(readings={**log.readings, channel: changed})

    return plant


def times(*factors):
    return lambda t, v: (t, v * np.array(factors))


def places(change):
    return lambda t, v: (t, np.column_stack([*change(v[:, 0], v[:, 1]), v[:, 2]]))


def later(t):
    return t + 0.05 * (t[-1] - t[0])


def repeat(t, v):
    v[len(t) // 2 : len(t) // 2 + len(t) // 10] = v[len(t) // 2]
    return t, v


def leap(t, v):
    v[len(t) // 3, :2] += 3.0
    return t, v


def gap(t, v):
    kept = np.setdiff1d(np.arange(len(t)), np.arange(len(t) // 4, len(t) // 3))
    return t[kept], v[kept]


def bias(r):
    """Ranges between the first two robots are 0.3 m too long."""
    return r.values + np.where(r.robot + r.other == 1, 0.3, 0.0)[:, None] * np.eye(1, r.values.shape[1])


def of_map(log):
    seen = log.readings["sighting"]
    turned = seen.values + np.column_stack([0 * seen.time, ends(log, "sighting")[0][:, 2]])
    return log._replace(readings={**log.readings, "sighting": seen._replace(values=turned)})


def aside(r):
    """The camera of the third robot looks 30 degrees to the left."""
    return r.values - np.outer(r.robot == 2, [0.0, np.pi / 6])


def turned_survey(log):
    places = log.landmarks.positions @ [[0.8, 0.6], [-0.6, 0.8]] + [1.0, -2.0]
    return log._replace(landmarks=log.landmarks._replace(positions=places))


def zeros(t, v):
    v[len(t) // 2 : len(t) // 2 + len(t) // 5] = 0.0
    return t, v


RANGES, DEGREES = ("range", "sighting"), 180 / np.pi
COMPASS = series("truth", 1, lambda t, v: (t, np.column_stack([v[:, :2], np.pi / 2 - v[:, 2]])))
# fault -> (kind of the finding, robot whose data it is or "", a world where it can be seen, how it is planted)
FAULTS = {
    "truth in mm": ("unit", "r1", "trajectory", series("truth", 1, times(1e3, 1e3, 1))),
    "truth in cm": ("unit", "r1", "trajectory", series("truth", 1, times(1e2, 1e2, 1))),
    "odometry in mm": ("unit", "r0", "no-compass", series("odometry", 0, times(1e3, 1))),
    "turns in degrees": ("degrees", "r0", "no-compass", series("odometry", 0, times(1, DEGREES))),
    "headings in degrees": ("degrees", "r1", "no-compass", series("truth", 1, times(1, 1, DEGREES))),
    "turns to the right": ("turn sign", "r1", "no-compass", series("odometry", 1, times(1, -1))),
    "zeros for a while": ("dropout", "r1", "no-compass", series("odometry", 1, zeros)),
    "a gyroscope's bias": (
        "turn bias",
        "r1",
        "no-compass",
        series("odometry", 1, lambda t, v: (t, v + np.array([0, 0.1]))),
    ),
    "clockwise headings": ("heading", "r1", "no-compass", COMPASS),
    "axes exchanged": ("axes", "r1", "trajectory", series("truth", 1, places(lambda x, y: (y, x)))),
    "mirrored frame": ("mirrored", "r1", "trajectory", series("truth", 1, places(lambda x, y: (x, 6 - y)))),
    "clock of the truth": ("clock", "r1", "trajectory", series("truth", 1, lambda t, v: (later(t), v))),
    "moves ahead": ("frame", "r1", "trajectory", series("odometry", 1, lambda t, v: (t, np.c_[np.hypot(*v.T), 0 * t]))),
    "truths exchanged": ("robots", "r0", "trajectory", lambda g: g._replace(truth=(*g.truth[1::-1], *g.truth[2:]))),
    "ranges in mm": ("unit", "", "trajectory", readings(RANGES, "values", lambda r: 1e3 * r.values)),
    "clock of ranges": ("clock", "", "trajectory", readings(RANGES, "time", lambda r: r.time + 1.5)),
    "bearings in degrees": ("degrees", "", "camera", readings(RANGES, "values", lambda r: r.values * [1, DEGREES])),
    "bearings to the right": ("bearing", "", "camera", readings(RANGES, "values", lambda r: r.values * [1, -1])),
    "bearings of the map": ("bearing", "", "camera", of_map),
    "a camera aside": ("bearing", "", "camera", readings(RANGES[1:], "values", aside)),
    "stale positions": ("stale", "r1", "trajectory", series("truth", 1, repeat)),
    "a leap": ("jump", "r1", "trajectory", series("truth", 1, leap)),
    "a gap": ("gap", "r1", "trajectory", series("truth", 1, gap)),
    "names of others": ("names", "", "trajectory", readings(["range"], "other", lambda r: 3 - r.robot - r.other)),
    "a biased pair": ("bias", "", "camera", readings(RANGES, "values", bias)),
}


def findings(log):
    return check_recording(log).findings


@pytest.mark.slow
@pytest.mark.parametrize("world", WORLDS)
def test_a_clean_team_has_few_findings(world):
    found = [findings(team_log(world, seed)) for seed in range(3)]
    assert found[1] == []
    assert sum(map(bool, found)) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(FAULTS))
def test_a_planted_fault_is_found_with_its_robot_and_the_setting_to_change(name):
    kind, robot, world, plant = FAULTS[name]
    found = [f for f in findings(plant(team_log(world, seed=2))) if (f.kind, f.robot) == (kind, robot)]
    assert found, f"{name} was not found"
    assert found[0].fact
    assert found[0].setting


@pytest.mark.slow
def test_one_that_stands_here_and_there_does_not_jump():
    def stand(t, v):
        v[:] = np.repeat(v[::20], 20, axis=0)[: len(v)] * 5
        return t, v

    log = series("odometry", 1, lambda t, v: (t, 0 * v))(team_log("trajectory", 2))
    assert "jump" not in {f.kind for f in findings(series("truth", 1, stand)(log))}


@pytest.mark.slow
@pytest.mark.parametrize("shift", [12.5, 1.7e9 + 12.3])  # the latter leaves no time in common
def test_the_offset_of_a_clock_is_what_it_was_shifted_by(shift):
    log = team_log("no-compass", 3)
    later = [series("truth", i, lambda t, v: (t + shift, v)) for i in range(3)]
    found = findings(later[1](log))
    assert [(f.kind, f.robot) for f in found] == [("clock", "r1")]
    assert float(re.fullmatch(r"clock_offset = { r1 = (.*) }", found[0].setting)[1]) == pytest.approx(-shift, abs=0.5)
    assert ("begin together" in found[0].fact) == (shift > 1e9)
    found = findings(later[0](later[1](later[2](log))))
    assert [(f.kind, f.robot, f.table) for f in found] == [("clock", r, "truth") for r in ("r0", "r1", "r2")]
    assert [float(f.setting.removeprefix("clock_offset = ")) for f in found] == pytest.approx([-shift] * 3, abs=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("robots", [range(3), [1]])
def test_odometry_is_late_where_readings_agree_with_the_truth(robots):
    log = team_log("camera", 3)
    for i in robots:
        log = series("odometry", i, lambda t, v: (t - 0.4, v))(log)
    found = [f for f in findings(log) if f.kind == "clock"]
    assert [(f.robot, f.table) for f in found] == [(f"r{i}", "odometry") for i in robots]
    assert all("readings agree with the truth" in f.fact for f in found)
    offsets = {float(offset) for f in found for offset in re.findall(r"-?\d\.\d+", f.setting)}
    assert [*offsets] == pytest.approx([0.4] * len(offsets), abs=0.1)


@pytest.mark.slow
def test_odometry_that_is_too_rare_for_what_the_robot_does_is_said():
    log = series("odometry", 1, lambda t, v: (t[::5], v[::5]))(team_log("no-compass", 2))
    found = [f for f in findings(log) if f.kind == "coarse"]
    assert [(f.robot, f.table) for f in found] == [("r1", "odometry")]
    assert found[0].fact.startswith("odometry comes every 5 s, and ")


@pytest.mark.slow
def test_sightings_are_late_by_what_bearings_say():
    log = readings(["landmark"], "time", lambda r: r.time + 0.3)(team_log("camera", 3))
    (found,) = findings(log)
    assert "stamps of bearings are +0.3" in found.fact
    assert -0.35 < float(found.setting.removeprefix("clock_offset = ")) < -0.25


@pytest.mark.slow
def test_the_corrected_recording_is_the_clean_one_and_the_original_is_not_changed():
    clean = team_log("camera", 4)
    log = series("truth", 1, times(1000, 1000, 1))(clean)
    before = log.truth[1].values.copy()
    np.testing.assert_allclose(check_recording(log).log.truth[1].values, clean.truth[1].values)
    np.testing.assert_array_equal(log.truth[1].values, before)


@pytest.mark.slow
def test_offsets_of_single_robots_are_one_setting_by_name():
    log = team_log("camera", 2)
    (camera,) = findings(FAULTS["a camera aside"][3](log))
    assert re.fullmatch(r"bearing_offset = { r2 = 0\.5\d+ }", camera.setting)
    (right,) = findings(FAULTS["bearings to the right"][3](log))
    assert "-rad" in right.setting
    for robot, offset in ((0, 0.7), (2, -1.2)):
        log = series("truth", robot, lambda t, v, by=offset: (t, np.add(v, [0.0, 0.0, by])))(log)
    settings = {f.setting for f in findings(log) if f.kind == "heading"}
    assert len(settings) == 1
    assert re.search(r"heading_offset = { r0 = -0\.[67]\d*, r2 = 1\.[12]\d* }", settings.pop())


@pytest.mark.slow
def test_a_bias_is_calibrated_of_cameras_and_fitted_of_radios():
    for world, channel, setting in (
        ("camera", "sighting", "nothing: calibrate the camera"),
        ("trajectory", "range", "nothing: "),
    ):
        (found,) = (f for f in findings(readings([channel], "values", bias)(team_log(world, 2))) if f.kind == "bias")
        assert found.setting.startswith(setting)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4, 6])
def test_places_that_ranges_fit_are_those_before_they_were_moved(seed):
    clean = team_log("camera", seed)
    moved = turned_survey(clean)
    (found,) = (one for one in findings(moved) if one.kind == "places")
    places = tomllib.loads(found.setting)["places"]
    assert [*places] == [*clean.landmarks.names]
    there = np.array([*places.values()])
    said = np.array([f"{name} " in found.fact for name in places])
    apart = np.hypot(*(clean.landmarks.positions - moved.landmarks.positions).T)[said]
    assert [float(d) for d in re.findall(r"([\d.]+) m away", found.fact)] == pytest.approx(apart, abs=0.3)
    np.testing.assert_allclose(there[said], clean.landmarks.positions[said], atol=0.3)
    np.testing.assert_allclose(there[~said], moved.landmarks.positions[~said], atol=0.01)


def test_a_robot_without_truth_and_one_that_stands_are_no_findings():
    log = team_log("camera", 5)
    still = log.truth[1]._replace(values=np.tile([2.0, 2.0, 0.0], (len(log.truth[1].time), 1)))
    odometry = (*log.odometry[:1], log.odometry[1]._replace(values=0 * log.odometry[1].values), *log.odometry[2:])
    assert findings(log._replace(truth=(None, still, log.truth[2]), odometry=odometry, readings={})) == []


def test_dead_reckoning_without_noise_is_the_truth():
    log = team_log("no-compass", 6, ticks=80)
    truth = log.truth[0].values
    u = np.column_stack([np.hypot(*np.diff(truth[:, :2], axis=0).T), np.angle(np.exp(1j * np.diff(truth[:, 2])))])
    exact = log.odometry[0]._replace(time=log.truth[0].time, values=np.vstack([u, [0, 0]]))
    found = dead_reckoned(log._replace(odometry=(exact, *log.odometry[1:])), 0)
    np.testing.assert_allclose(found, truth[:, :2], atol=1e-9)


def test_dead_reckoning_without_headings_ends_with_the_last_of_regular_stamps():
    log = team_log("no-compass", 6, ticks=95)
    stamps = 1.7e9 + 1012.5 + 0.1 * np.arange(95)
    odometry, truth = (tuple(s._replace(time=stamps) for s in every) for every in (log.odometry, log.truth))
    truth = tuple(s._replace(values=s.values * [1, 1, np.nan]) for s in truth)
    assert np.isfinite(dead_reckoned(log._replace(odometry=odometry, truth=truth), 0)).all()


def test_rows_and_counts_are_those_of_the_series():
    log = team_log("camera", 7)
    rows = {(row.series, row.of): row for row in series_rows(log)}
    assert rows["odometry", "r0"].rate == pytest.approx(10)
    sightings = sum(row.samples for (series, _), row in rows.items() if series == "sighting")
    assert sightings == len(log.readings["sighting"].time)
    robots, names, counts = count_measurements(log)
    assert counts[:, : len(robots)].sum() == sightings
    assert counts.sum() == sum(len(readings.time) for readings in log.readings.values())
    assert names[len(robots) :] == log.landmarks.names


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "fact", "setting"),
    [
        (lambda r: np.maximum(r.values, np.quantile(r.values, 0.25)), "25% of the signals", "missing_below = "),
        (lambda r: r.values / 10, r"change by -\d\.\d+ dB in ten times", "nothing: "),
        (lambda r: 5 * r.values, r"change by -\d+ dB in ten times", "nothing: "),
        (lambda r: r.values - 6 * (r.robot == 1)[:, None], r"received by r0 \+\d dB, r1 -\d dB", "nothing: "),
        (lambda r: r.values - 9 * (r.other == 2)[:, None], "sent by A0", "nothing: "),
        (lambda r: r.values[np.maximum(np.arange(len(r.time)) - 48, 0)], r"\+[345]\.?\d* s from", "clock_offset = -"),
    ],
)
def test_signals_that_fall_otherwise_than_by_distance_are_found(change, fact, setting):
    log = readings(["anchor_rssi"], "values", change)(team_log("trajectory", 4))
    (found,) = findings(log)
    assert re.search(fact, found.fact)
    assert found.setting.startswith(setting)
    (ax,) = finding(found, log, log).axes
    assert [line.get_label() for line in ax.lines] == [*log.robots]
    assert (ax.get_xscale(), ax.get_ylabel()) == ("log", "signal strength [dBm]")


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_ranges_that_were_computed_from_signals_are_told_from_measured_ones(noise):
    log = team_log("trajectory", 4)
    signals = log.readings["rssi"]
    far = 10 ** ((-40 - signals.values) / 20) * np.random.default_rng(0).lognormal(0, noise, signals.values.shape)
    ranges = signals._replace(values=far.round(2), source="range")
    found = findings(log._replace(readings={"rssi": signals, "range": ranges}))
    follow = [one.change for one in found if "ranges follow from the signals" in one.fact]
    assert follow == ["[ranges] remove this table: filters would count one measurement twice"] * (noise == 0)

"""Recordings of teams whose truth is known, from cooploc's own worlds, and what can be wrong with them."""

import numpy as np

import cooploc as cl
from cooploc.scenarios.recordings.team_log import Places, Readings, Series, TeamLog

WORLDS = {"camera": 600, "no-compass": 300, "trajectory": 300}  # family -> ticks


def team_log(family, seed, ticks=None):
    """A clean recording of a simulated team."""
    label = f"{family}[ticks={ticks or WORLDS[family]}]"
    truth, stream = cl.simulate(label, trials=1, seed=seed)
    return from_stream(truth, stream)


def from_stream(truth, stream):
    """The first trial of a stream as a recording."""
    n, t, senses, air = stream.robots, stream.time, stream.senses, stream.air
    robots = tuple(f"r{i}" for i in range(n))
    compass = truth.x.shape[-1] == 2
    begin = t if compass else t - stream.world.tick  # a displacement is since the line before, a speed until the next
    poses = np.full((len(t), n, 3), np.nan)
    poses[:, :, : truth.x.shape[-1]] = truth.x[0]
    channels = {
        "landmark": senses.landmark[0],
        "sighting": senses.sighting[0],
        "anchor_rssi": senses.anchor_rssi[0][..., None],
        "range": air.range[0][..., None] if air.range.shape[-1] else air.range[0],
        "rssi": air.rssi[0][..., None] if air.rssi.shape[-1] else air.rssi[0],
    }
    found = {name: _readings(t, values, name) for name, values in channels.items()}
    return TeamLog(
        name="simulated",
        robots=robots,
        odometry_kind="displacement" if compass else "velocity",
        odometry=tuple(Series(begin, senses.odometry[0][:, i], f"odom_{r}") for i, r in enumerate(robots)),
        truth=tuple(Series(t, poses[:, i], f"truth_{r}") for i, r in enumerate(robots)),
        readings={name: readings for name, readings in found.items() if readings is not None},
        landmarks=_places(stream.world.landmarks, "L"),
        anchors=_places(stream.world.anchors, "A"),
    )


def _readings(t, values, source):
    """Readings (T, n, m, k) that are not nan, in order of time."""
    if values.ndim < 4 or not values.size:
        return None
    tick, robot, other = np.nonzero(np.isfinite(values[..., 0]))
    return Readings(t[tick], robot, other, values[tick, robot, other], source)


def _places(positions, letter):
    positions = np.asarray(positions, float).reshape(-1, 2)
    return Places(tuple(f"{letter}{k + 1}" for k in range(len(positions))), positions)


def changed_truth(log, robot, change):
    """The log with one robot's truth changed: change(time, values) -> (time, values)."""
    truth = list(log.truth)
    time, values = change(truth[robot].time.copy(), truth[robot].values.copy())
    truth[robot] = truth[robot]._replace(time=time, values=values)
    return log._replace(truth=tuple(truth))


def changed_odometry(log, robot, factors):
    """The log with the columns of one robot's odometry multiplied."""
    odometry = list(log.odometry)
    odometry[robot] = odometry[robot]._replace(values=odometry[robot].values * factors)
    return log._replace(odometry=tuple(odometry))


def changed_readings(log, channel, **changes):
    """The log with fields of a channel's readings changed, each by a function of the readings."""
    readings = log.readings[channel]
    new = readings._replace(**{name: change(readings) for name, change in changes.items()})
    return log._replace(readings={**log.readings, channel: new})


def _columns(*factors):
    return lambda time, values: (time, values * np.array(factors))


def _positions(change):
    return lambda time, values: (time, np.column_stack([*change(values[:, 0], values[:, 1]), values[:, 2]]))


def _repeat(time, values):
    """Stale for a tenth of the time."""
    start, count = len(time) // 2, len(time) // 10
    values[start : start + count] = values[start]
    return time, values


def _leap(time, values):
    values[len(time) // 3, :2] += 3.0
    return time, values


def _gap(time, values):
    kept = np.ones(len(time), bool)
    kept[len(time) // 4 : len(time) // 3] = False
    return time[kept], values[kept]


def _span(log):
    return log.odometry[0].time[-1] - log.odometry[0].time[0]


def _exchanged(log):
    truth = list(log.truth)
    truth[0], truth[1] = truth[1], truth[0]
    return log._replace(truth=tuple(truth))


BOTH = ("camera", "no-compass")
EVERY = (*BOTH, "trajectory")
# glitch -> (kind of the finding, robot whose data it is or "", families where it can be seen, what goes wrong)
GLITCHES = {
    "truth in mm": ("unit", "r1", EVERY, lambda log: changed_truth(log, 1, _columns(1e3, 1e3, 1))),
    "truth in cm": ("unit", "r1", EVERY, lambda log: changed_truth(log, 1, _columns(1e2, 1e2, 1))),
    "odometry in mm": ("unit", "r0", BOTH, lambda log: changed_odometry(log, 0, [1e3, 1])),
    "odometry 1.5 times too long": ("scale", "r0", EVERY, lambda log: changed_odometry(log, 0, [1.5, 1.5])),
    "turns in degrees": ("degrees", "r0", BOTH, lambda log: changed_odometry(log, 0, [1, 180 / np.pi])),
    "headings in degrees": ("degrees", "r1", BOTH, lambda log: changed_truth(log, 1, _columns(1, 1, 180 / np.pi))),
    "turns to the right": ("turn sign", "r1", BOTH, lambda log: changed_odometry(log, 1, [1, -1])),
    "clockwise headings": (
        "heading",
        "r1",
        BOTH,
        lambda log: changed_truth(log, 1, lambda t, v: (t, np.column_stack([v[:, :2], np.pi / 2 - v[:, 2]]))),
    ),
    "axes exchanged": ("axes", "r1", EVERY, lambda log: changed_truth(log, 1, _positions(lambda x, y: (y, x)))),
    "mirrored frame": ("mirrored", "r1", EVERY, lambda log: changed_truth(log, 1, _positions(lambda x, y: (x, 6 - y)))),
    "clock of the truth": (
        "clock",
        "r1",
        EVERY,
        lambda log: changed_truth(log, 1, lambda t, v: (t + 0.05 * _span(log), v)),
    ),
    "clock of the ranges": (
        "clock",
        "",
        BOTH,
        lambda log: changed_readings(log, ranged(log), time=lambda r: r.time + 0.05 * _span(log)),
    ),
    "truths exchanged": ("robots", "r0", EVERY, _exchanged),
    "ranges in mm": (
        "unit",
        "",
        EVERY,
        lambda log: changed_readings(
            log, ranged(log), values=lambda r: r.values * np.array([1e3, 1][: r.values.shape[1]])
        ),
    ),
    "a biased pair": ("bias", "", EVERY, lambda log: changed_readings(log, ranged(log), values=_biased)),
    "bearings in degrees": (
        "degrees",
        "",
        ("camera",),
        lambda log: changed_readings(log, "sighting", values=lambda r: r.values * [1, 180 / np.pi]),
    ),
    "bearings to the right": (
        "bearing",
        "",
        ("camera",),
        lambda log: changed_readings(log, "sighting", values=lambda r: r.values * [1, -1]),
    ),
    "teammates exchanged": ("robots", "", EVERY, lambda log: changed_readings(log, ranged(log), other=_misnamed)),
    "signal strength without its sign": (
        "rssi",
        "",
        ("no-compass", "trajectory"),
        lambda log: changed_readings(log, "rssi", values=lambda r: -r.values),
    ),
    "stale positions": ("stale", "r1", EVERY, lambda log: changed_truth(log, 1, _repeat)),
    "a leap": ("jump", "r1", EVERY, lambda log: changed_truth(log, 1, _leap)),
    "a gap": ("gap", "r1", EVERY, lambda log: changed_truth(log, 1, _gap)),
}


def ranged(log):
    """The channel of the team's ranges."""
    return "range" if "range" in log.readings else "sighting"


def _biased(readings):
    """Ranges between the first two robots are 0.3 m too long."""
    pair = (readings.robot + readings.other == 1).astype(float)
    values = readings.values.copy()
    values[:, 0] += 0.3 * pair
    return values


def _misnamed(readings):
    """Robot 0 confuses robots 1 and 2."""
    names = np.array([0, 2, 1])
    return np.where(readings.robot == 0, names[readings.other], readings.other)

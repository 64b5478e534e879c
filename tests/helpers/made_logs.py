"""A lab's own log, written from a motion and a model that are known."""

import numpy as np

from cooploc.estimators.models import Unicycle

EPOCH, TICKS = 1652463552, 60
ANCHORS = np.array([[0.0, 0.0], [0.0, 3.0], [4.0, 3.0], [4.0, 0.0]])
A, ETA, SIGMA = -45.0, 1.8, 2.0
LENGTH, TURN = 1.25, 0.8  # true by odometry's
COLUMNS = ["step", "sec", "nsec", "metres", "turn", "x", "y", "r1", "r2", "r3", "r4", "note"]

DESCRIPTION = """
format = "csv"
about = "made by a test"
robots = ["robot"]
arena = [[0, 0], [4, 3]]
[sample]
tick = "lines"
max_hold = 5.0
[odometry]
kind = "path"
file = "{run}.csv"
time = ["sec", { column = "nsec", unit = "ns" }]
length = "metres"
turn_rate = "turn"
[truth]
file = "{run}.csv"
time = ["sec", { column = "nsec", unit = "ns" }]
x = "x"
y = "y"
repeats = "stale"
max_speed = 1.0
[rssi]
file = "{run}.csv"
time = ["sec", { column = "nsec", unit = "ns" }]
each = { north = "r1", east = "r2", south = "r3", west = "r4" }
[anchors]
places = { north = [0, 0], east = [0, 3], south = [4, 3], west = [4, 0] }
[prior]
position = "first truth"
position_sd = 0.05
heading = "first motion"
heading_sd = 0.1
"""
MODEL = (
    "[model]\nanchor_A = -45\nanchor_eta = 1.8\nanchor_rssi_sigma = 2\nlength_scale = 1.25\nturn_scale = 0.8\n"
    "sigma_v = 0.02\nsigma_omega = 0.03\n"
)


def drive(seed, ticks=TICKS):
    """Stamps (T + 1,), true poses (T + 1, 3) and the true (v, omega) (T, 2), which the models can follow exactly."""
    rng = np.random.default_rng(seed)
    time = np.concatenate([[0.0], np.cumsum(1 + 0.002 * rng.uniform(-1, 1, ticks).round(3))])
    u = np.stack([rng.uniform(0.05, 0.15, ticks), rng.normal(0.2, 0.3, ticks)], -1)
    pose, exact = [np.array([2.0, 1.2, rng.uniform(-3, 3)])], Unicycle(0.0, 0.0)
    for k in range(ticks):
        pose.append(exact.move(pose[-1], u[k], time[k + 1] - time[k])[0])
    return time, np.array(pose), u


def lines(seed, ticks=TICKS, sigma=SIGMA, correlation=0.0):
    """A run's lines by column, as text."""
    time, pose, u = drive(seed, ticks)
    rng = np.random.default_rng(1000 + seed)
    distance = np.hypot(*(pose[:, None, :2] - ANCHORS).transpose(2, 0, 1))
    noise = rng.normal(0, sigma, distance.shape)
    for k in range(1, ticks + 1):
        noise[k] = correlation * noise[k - 1] + np.sqrt(1 - correlation**2) * noise[k]
    rssi = A - 10 * ETA * np.log10(distance) + noise
    metres = 7.0 + np.concatenate([[0.0], np.cumsum(u[:, 0] * np.diff(time))]) / LENGTH
    turn = np.append(u[:, 1], 0.0) / TURN
    whole = np.floor(time)
    return [
        [str(k), str(EPOCH + int(whole[k])), f"{(time[k] - whole[k]) * 1e9:.0f}", f"{metres[k]:.9f}", f"{turn[k]:.9f}"]
        + [f"{value:.9f}" for value in (*pose[k, :2], *rssi[k])]
        + ["any text"]
        for k in range(ticks + 1)
    ]


def write(data, name, rows):
    (data / f"{name}.csv").write_text("".join(",".join(row) + "\n" for row in [COLUMNS, *rows]))


def change(data, name, cells):
    """Set the fields {(row, column): text} of a run; row 0 is on line 2."""
    table = [line.split(",") for line in (data / f"{name}.csv").read_text().splitlines()]
    for (row, column), text in cells.items():
        table[row + 1][COLUMNS.index(column)] = text
    write(data, name, table[1:])


def describe(data, old="", new="", text=DESCRIPTION):
    assert old in text
    (data / "log.toml").write_text(text.replace(old, new, 1) if old else text + new)

"""A team's recordings in CSV files, written from motions, biases and noise that are known."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from cooploc.estimators.models import Unicycle, wrap

ROBOTS = ("red", "blue")
ARENA = ((0.0, 0.0), (8.0, 6.0))
EPOCH = 1_700_000_000.0
TURN_SCALE, LENGTH_SCALE = 0.9, 1.1  # true by odometry's
SIGMA_V, SIGMA_OMEGA = 0.03, 0.02  # [m/s], [rad/s] at TICK
BIAS, SIGMA_RANGE = 0.35, 0.08  # [m]
ANCHORS = {"north": (4.0, 5.5), "south": (1.0, 0.5), "east": (7.5, 3.0)}
TICK = 0.1  # [s]

DESCRIPTION = """
format = "csv"
about = "made by a test"
robots = ["red", "blue"]
arena = [[0, 0], [8, 6]]

[odometry]
kind = "velocity"
file = "odom_{robot}.csv"
time = "t"
speed = "v"
turn_rate = "w"

[truth]
file = "mocap_{robot}.csv"
time = ["sec", { column = "nsec", unit = "ns" }]
x = "x"
y = "y"
heading = "yaw"

[ranges]
file = "uwb.csv"
time = "t"
robot = "from"
other = "to"
range = "d"

[fit]
on = "first part"
seconds = 60.0
"""


@dataclass(frozen=True)
class Motions:
    """Truth on a grid of TICK / 2, which is when odometry is logged."""

    time: np.ndarray  # (m,)
    pose: np.ndarray  # (m, n, 3)
    u: np.ndarray  # (m - 1, n, 2)  true v, omega


@cache  # for many tests; its arrays are read-only
def drive(seed, seconds=120.0, robots=2):
    """Robots that circle about places of their own with a wandering speed."""
    rng = np.random.default_rng(seed)
    m, step, exact = int(2 * seconds / TICK), TICK / 2, Unicycle(0.0, 0.0)
    slow = np.linspace(0, seconds, max(int(seconds / 5), 2) + 1)
    u = np.stack(
        [
            _wander(rng, slow, step * np.arange(m), robots, 0.3, 0.1),
            _wander(rng, slow, step * np.arange(m), robots, 0.35, 0.15),
        ],
        -1,
    )
    pose = [np.stack([[2.5 + 2.5 * i, 2.0 + 0.7 * i, 0.5 + i] for i in range(robots)])]
    for k in range(m):
        pose.append(exact.move(pose[-1], u[k], np.full(robots, step))[0])
    motions = Motions(EPOCH + step * np.arange(m + 1), np.array(pose), u)
    for array in (motions.time, motions.pose, motions.u):
        array.flags.writeable = False
    return motions


def write(folder, seed=0, seconds=120.0, anchors=False, hertz=50.0):
    """One run: odometry at 20 Hz, motion capture at `hertz` on its own stamps, ranges at 15 Hz."""
    folder.mkdir(parents=True, exist_ok=True)
    motions, rng = drive(seed, seconds), np.random.default_rng(1000 + seed)
    step = TICK / 2
    for i, robot in enumerate(ROBOTS):
        noise = rng.normal(size=(len(motions.u), 2)) * [SIGMA_V, SIGMA_OMEGA] * np.sqrt(TICK / step)
        odometry = (motions.u[:, i] - noise) / [LENGTH_SCALE, TURN_SCALE]
        _csv(folder / f"odom_{robot}.csv", "t,v,w", np.column_stack([motions.time[:-1], odometry]))
        at = np.arange(motions.time[0], motions.time[-1], 1 / hertz) + 0.003
        stamps = np.column_stack([np.floor(at), (at % 1 * 1e9).round()])
        _csv(folder / f"mocap_{robot}.csv", "sec,nsec,x,y,yaw", np.column_stack([stamps, poses_at(motions, i, at)]))
    at = np.arange(motions.time[0] + 0.02, motions.time[-1], 1 / 15)
    red, blue = (poses_at(motions, i, at)[:, :2] for i in (0, 1))
    measured = {"blue": np.hypot(*(red - blue).T) + BIAS}
    measured |= {name: np.hypot(*(red - place).T) for name, place in ANCHORS.items()} if anchors else {}
    noisy = {name: d + SIGMA_RANGE * rng.normal(size=len(at)) for name, d in measured.items()}
    lines = [f"{t:.6f},red,{name},{d[k]:.6f}" for k, t in enumerate(at) for name, d in noisy.items()]
    (folder / "uwb.csv").write_text("t,from,to,d\n" + "\n".join(lines) + "\n")
    return motions


def describe(folder, *changes, text=DESCRIPTION):
    """Write log.toml with some of its text replaced: (old, new) each."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "log.toml").write_text(text)


def poses_at(motions, robot, at):
    """True poses (m, 3) at some times."""
    heading = np.unwrap(motions.pose[:, robot, 2])
    x, y, yaw = (np.interp(at, motions.time, column) for column in (*motions.pose[:, robot, :2].T, heading))
    return np.stack([x, y, wrap(yaw)], -1)


def _wander(rng, slow, at, robots, mean, spread):
    return np.stack([np.interp(at, slow, mean + spread * rng.uniform(-1, 1, len(slow))) for _ in range(robots)], -1)


def _csv(path, head, values):
    np.savetxt(path, values, fmt="%.9f", delimiter=",", header=head, comments="")

"""Two robots, red and blue, in CSV files as a lab would write them, whose truth is known."""

import numpy as np

from cooploc.estimators.models import Unicycle

EPOCH = 1_700_000_000.0
SECONDS = 120


def drive(rng, start, seconds=SECONDS, step=0.1):
    """Stamps (T,), poses (T, 3) and (v, omega) (T, 2) of a robot in a room of 6 m by 5 m."""
    exact, pose, poses, inputs = Unicycle(0.0, 0.0), np.array(start, float), [], []
    speed, turn = 0.3, 0.0
    for _ in range(int(seconds / step)):
        turn = 0.95 * turn + rng.normal(0, 0.12)
        speed = np.clip(speed + rng.normal(0, 0.02), 0.1, 0.5)
        ahead = pose[:2] + 0.6 * np.array([np.cos(pose[2]), np.sin(pose[2])])
        near = (ahead < 0.4).any() or (ahead > [5.6, 4.6]).any()
        u = np.array([0.1, 0.9]) if near else np.array([speed, turn])
        poses.append(pose)
        inputs.append(u)
        pose = exact.move(pose, u, step)[0]
    return step * np.arange(len(poses)), np.array(poses), np.array(inputs)


def two_robots(seed=1, seconds=SECONDS):
    """Columns by file, as text tables would hold them: {file: {column: values}}."""
    rng = np.random.default_rng(seed)
    files, truth = {}, {}
    for name, start in (("red", (1.5, 1.5, 0.3)), ("blue", (4.0, 3.0, 2.0))):
        t, pose, u = drive(rng, start, seconds)
        truth[name] = t, pose
        noisy = u + rng.normal(0, 1, u.shape) * [0.02, 0.03]
        files[f"odom_{name}.csv"] = {"time": EPOCH + t, "v": noisy[:, 0], "omega": noisy[:, 1]}
        seen = pose + rng.normal(0, 1, pose.shape) * [0.002, 0.002, 0.005]
        heading = np.angle(np.exp(1j * seen[:, 2]))
        files[f"truth_{name}.csv"] = {"time": EPOCH + t + 0.02, "x": seen[:, 0], "y": seen[:, 1], "theta": heading}
    t = np.arange(0.5, seconds - 1, 0.2)
    at = {n: np.stack([np.interp(t, time, pose[:, k]) for k in (0, 1)], -1) for n, (time, pose) in truth.items()}
    distance = np.hypot(*(at["red"] - at["blue"]).T)
    files["uwb.csv"] = {
        "time": EPOCH + t,
        "from": np.array(["red", "blue"])[np.arange(len(t)) % 2],
        "to": np.array(["blue", "red"])[np.arange(len(t)) % 2],
        "range": distance + rng.normal(0, 0.05, len(t)),
    }
    return files


def write(folder, files):
    """The files in a directory; returns it."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, columns in files.items():
        rows = zip(*columns.values(), strict=True)
        lines = [",".join(v if isinstance(v, str) else f"{v:.6f}" for v in row) for row in rows]
        (folder / name).write_text("\n".join([",".join(columns), *lines]) + "\n")
    return folder


def eight_glitches(folder, seed=1):
    """The two robots with eight things wrong: {kind of finding: whose data it is}, and the directory."""
    files = two_robots(seed)
    red, blue = files["truth_red.csv"], files["truth_blue.csv"]
    red["x"][400:404] += 2.5
    red["x"], red["y"] = red["y"], red["x"]
    red["theta"] = np.degrees(red["theta"])
    blue["x"], blue["y"] = 1000 * blue["x"], 1000 * blue["y"]
    blue["time"] = blue["time"] + 2.5
    files["odom_blue.csv"]["omega"] *= -1
    files["uwb.csv"]["range"] += 0.4
    write(folder, files)
    path = folder / "odom_red.csv"
    path.write_text(path.read_text()[:-12])  # the recorder was stopped in the middle of a line
    return {
        "jump": "red",
        "axes": "red",
        "degrees": "red",
        "unit": "blue",
        "clock": "blue",
        "turn sign": "blue",
        "bias": "",
        "dropped": "",
    }

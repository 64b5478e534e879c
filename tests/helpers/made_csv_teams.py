"""Two robots, red and blue, in CSV files as a lab would write them, whose truth is known."""

import numpy as np
import pandas as pd
from made_team import EPOCH, ROBOTS, drive


def two_robots(seed=1, seconds=120):
    """Columns by file, as text tables would hold them: {file: {column: values}}."""
    rng = np.random.default_rng(seed)
    files, truth = {}, {}
    motions = drive(seed, seconds)
    t = motions.time[:-1:2] - EPOCH
    for i, name in enumerate(ROBOTS):
        pose, u = motions.pose[:-1:2, i], (motions.u[::2, i] + motions.u[1::2, i]) / 2
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


def changed(**columns):
    """The files with functions applied to columns."""
    return lambda files: {
        name: table.assign(**{c: change(table[c]) for c, change in columns.items() if c in table})
        for name, table in files.items()
    }


def on_globe(files):
    """The truth in degrees on the globe."""
    for robot in ROBOTS:
        x, y = (files[f"truth_{robot}.csv"].pop(q) for q in "xy")
        files[f"truth_{robot}.csv"] = files[f"truth_{robot}.csv"].assign(lat=48 + y / 111_201, lon=11 + x / 74_628)
    return files


def other_names(files):
    for new, old in (("truth_tb-01.csv", "truth_red.csv"), ("truth_tb-02.csv", "truth_blue.csv")):
        files[new] = files.pop(old)
    files["uwb.csv"] = files["uwb.csv"].replace({"red": "Robot 1", "blue": "Robot 2"})
    return {name.replace("odom_red", "odom_robot1").replace("odom_blue", "odom_robot2"): t for name, t in files.items()}


def wide(files):
    """All in one file, with columns for each robot; headings go on beyond pi."""
    table = pd.DataFrame({"time": files["odom_red.csv"]["time"]})
    for i, robot in enumerate(ROBOTS, 1):
        odometry, truth = files[f"odom_{robot}.csv"], files[f"truth_{robot}.csv"]
        table[f"v{i}"], table[f"w{i}"] = odometry["v"], odometry["omega"]
        table[[f"x{i}", f"y{i}"]], table[f"theta{i}"] = truth[["x", "y"]], np.unwrap(truth["theta"])
    ranges = files["uwb.csv"]
    table["d12"] = np.interp(table["time"], ranges["time"], ranges["range"])
    return {"all.csv": table}


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

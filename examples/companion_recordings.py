"""Makes recordings for `cooploc run log --data DIR` of public files of herolab-uga/cdoa-localization (commit 3684b64).

    python examples/companion_recordings.py CLONE OUT     # OUT/trajectories, OUT/dataset2

`simulations/*.csv`: three trajectories among nodes on the corners of 6 m (a unit is 0.1 m), cut where they jump.
`dataset2/measurements`: BLE radios at 11 places (P. Szelinski, M. Nikodem, doi 10.21227/hc74-3s30), every fiftieth line
as in the public scripts, but paired place by place. Neither has odometry: the log says that the robot stands, and may
step 0.1 m / sqrt(3) per axis, as `ros/PFLocalization.py` draws particles within 0.1 m.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

COLUMNS = ("x", "y", "sw", "nw", "ne", "se")
LOG = """format = "csv"
robots = ["robot"]
arena = [[0, 0], [SIDE, SIDE]]
odometry = { file = "{run}.csv", time = "time", kind = "displacement", dx = "dx", dy = "dy" }
truth = { file = "{run}.csv", time = "time", x = "x", y = "y" }
rssi = { file = "{run}.csv", time = "time", each = { a = "sw", b = "nw", c = "ne", d = "se" } }
anchors = { places = { a = [0, 0], b = [0, SIDE], c = [SIDE, SIDE], d = [SIDE, 0] } }
sample = { tick = "lines" }
prior = { position = "arena" }
model = { length_scale = 1.0, sigma_move = 0.0577 }
"""


def write_runs(folder: Path, side: int, runs: dict[str, np.ndarray]) -> None:
    """Write a log.toml, and a file for each run (n, 6): x, y [m], four signals [dBm] clockwise from the origin."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "log.toml").write_text(LOG.replace("SIDE", str(side)))
    for name, values in runs.items():
        table = pd.DataFrame(values, columns=COLUMNS).assign(time=range(len(values)), dx=0.0, dy=0.0)
        table.to_csv(folder / f"{name}.csv", index=False)


def trajectory(file: Path) -> dict[str, np.ndarray]:
    """Return the parts of a simulated trajectory, by name."""
    table = pd.read_csv(file)
    part = np.hypot(table.X.diff(), table.Y.diff()).gt(1).cumsum()
    table[["X", "Y"]] = table[["X", "Y"]] / 10 + 3
    values = table[["X", "Y", "RSS4", "RSS1", "RSS2", "RSS3"]].to_numpy()
    return {f"{file.stem.split('_')[-1]}-{k}": values[part == k] for k in part.unique()}


def measurements(folder: Path) -> np.ndarray:
    """Return what four radios measured at the same place, place by place."""
    logs, ticks = [pd.read_csv(folder / f"s{k}.csv", sep=";") for k in (0, 3, 2, 1)], []
    for x, y in logs[0][["x", "y"]].drop_duplicates().to_numpy():
        signals = [log.rssi[(log.x == x) & (log.y == y)].where(lambda z: z > -120)[::50] for log in logs]
        ticks += [(x, y, *tick) for tick in zip(*signals, strict=False)]
    return np.array(ticks)


if __name__ == "__main__":
    clone, out = map(Path, sys.argv[1:])
    files = sorted(clone.glob("simulations/simulation_datapoints_*.csv"))
    write_runs(out / "trajectories", 6, {name: run for file in files for name, run in trajectory(file).items()})
    runs = ("diag0", "diag1")
    write_runs(out / "dataset2", 10, {run: measurements(clone / "dataset2/measurements" / run) for run in runs})

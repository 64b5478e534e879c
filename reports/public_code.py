"""Replays public scripts of cooperative localization as published and with one thing changed: reports/public-code.md.

Run: python reports/public_code.py REPOSITORIES DATA reports/public-code.md [NAME ...]. REPOSITORIES holds clones, each
in a folder of its own name (the page says which); DATA holds the recordings wifi-rssi and mrclam6. Scripts run in a
copy, without network, at the commit that the page names; nothing of them is kept. Two replays are our own numpy,
written from what the script does, because the script itself needs a robot or a screen. Only tables are written.
"""

import io
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]
COMMITS = {
    "cdoa-localization": "3684b64b1e3d68469bf1b900c044d011844ad8de",
    "multirobot_localization_utias": "be8e4e90267277454a453dd72635e7c3a55e50f9",
    "multirobot_localization": "6f1059fdbc5f7880b62242e27dd9059a67319156",
    "cooperative-localization": "d08300a2f0c824c0dc7a0078892721350202ccfe",
    "multi_robot_localization": "a6e4ee109ff7250056264aee6306f9dc8b413480",
}
NODES = np.array([(0, 0), (0, 1.75), (2.34, 1.75), (2.34, 0)])  # of the WiFi runs [m]
SEEDS = range(5)


def metres(values: Array) -> str:
    """Return mean and range of the errors [m] of several runs."""
    values = np.asarray(values)
    return f"{values.mean():.2f}" + (f" ({values.min():.2f} to {values.max():.2f})" if len(values) > 1 else "")


def show(clone: Path, name: str) -> bytes:
    """Return a file of a clone at the commit that the page names."""
    return subprocess.check_output(["git", "-C", str(clone), "show", f"{COMMITS[clone.name]}:{name}"])


def position_rmse(error: Array) -> float:
    """Return the root mean square of position errors (n, 2) [m]."""
    return float(np.sqrt(np.mean(np.sum(np.square(error), -1))))


# cdoa-localization, ros/PFLocalization.py: our numpy


def track(readings: Array, truth: Array, average: bool, turn: bool, seed: int) -> Array:
    """Return what that particle filter estimates (n, 2) [m] of readings (n, 4) [dBm] and tracked positions (n, 2) [m].

    One direction a tick, of half-sums of differences, folded by arctan; its deviation is that of the four residuals;
    the last three best errors enter again; the particle of the largest weight is the estimate, and the next particles
    are uniform within 0.1 m of it. `average`: the estimate is its mean with the tracked position. `turn`: the measured
    direction is turned by an angle that is computed from the tracked position.
    """
    random = np.random.default_rng(seed)

    def direction(rssi: Array) -> Array:
        y = (rssi[..., 1] - rssi[..., 0] + rssi[..., 2] - rssi[..., 3]) / 2
        x = (rssi[..., 2] - rssi[..., 1] + rssi[..., 3] - rssi[..., 0]) / 2
        return np.arctan(np.divide(y, x, out=np.zeros_like(x), where=x != 0))

    measured = direction(readings)
    if turn:
        measured = measured + np.arctan2(2 * truth[:, 0] * truth[:, 1], 1 - 2 * truth[:, 1] ** 2)
    particles = random.uniform((0.9, 0.6), (1.3, 1.0), (1000, 2))
    best: list[float] = []
    estimates = np.empty_like(truth)
    for i, rssi in enumerate(readings):
        distance = np.linalg.norm(particles[:, None] - NODES, axis=-1).clip(0.01)
        model = -40 - 30 * np.log10(distance) + random.normal(0, 2, (len(particles), 1))
        error = np.abs(direction(model) - measured[i])
        deviation = (model - rssi).std(-1)
        log_weight = -(1 + len(best)) * np.log(deviation) - (error**2 + np.square(best).sum()) / (2 * deviation**2)
        winner = int(np.argmax(log_weight))
        best = [*best, float(error[winner])][-3:]
        estimates[i] = (particles[winner] + truth[i]) / 2 if average else particles[winner]
        count = max(200, -(-len(particles) // 2))
        particles = estimates[i] + random.uniform(-0.1, 0.1, (count, 2))
    return estimates


def replay_average(data: Path) -> list[list[str]]:
    """Return rows: the eleven WiFi runs as published, with less of the truth, and a constant."""
    variants = {
        "as published": (True, True),
        "without the average": (False, True),
        "without the average and the angle": (False, False),
    }
    errors: dict[str, list[float]] = {name: [] for name in variants}
    middle = []
    for file in sorted((data / "wifi-rssi").glob("*.csv")):
        if "4.4.1" in file.name:  # the tail of another run
            continue
        log = pd.read_csv(file)
        ticks = np.arange(5, len(log) - 5)
        rssi = log[[f"rssi{k}" for k in (1, 2, 3, 4)]].to_numpy(float)
        smooth = np.array([rssi[i - 5 : i + 5].mean(0) for i in ticks])  # four of the ten rows are of the future
        truth = log[["robot_pos_x", "robot_pos_y"]].to_numpy(float)[ticks]
        middle.append(position_rmse(truth - NODES.max(0) / 2))
        for name, (average, turn) in variants.items():
            errors[name] += [position_rmse(track(smooth, truth, average, turn, seed) - truth) for seed in SEEDS]
    rows = [["RMSE over eleven WiFi runs", name, metres(np.array(found))] for name, found in errors.items()]
    return [*rows, ["", "always the middle of the room", metres(np.array(middle))]]


# cdoa-localization, dataset2: our numpy


def replay_fit(clone: Path) -> list[list[str]]:
    """Return rows: multilateration with the path loss of the run itself, and with that of the other run."""
    corners = np.array([(0, 0), (10, 0), (10, 10), (0, 10)])
    runs = {}
    for run in ("diag0", "diag1"):
        files = [show(clone, f"dataset2/measurements/{run}/s{k}.csv") for k in range(4)]
        logs = [pd.read_csv(io.BytesIO(file), sep=";", skipinitialspace=True) for file in files]
        rows = slice(0, min(map(len, logs)), 100)
        runs[run] = (
            logs[0][["x", "y"]].to_numpy(float)[rows],
            np.stack([log["rssi"].to_numpy(float)[rows] for log in logs], -1),
            np.stack([log["distance"].to_numpy(float)[rows] for log in logs], -1),
        )

    def path_loss(names: list[str]) -> Array:
        log_distance = np.concatenate([10 * np.log10(runs[name][2]).ravel() for name in names])
        return np.polyfit(log_distance, np.concatenate([runs[name][1].ravel() for name in names]), 1)

    def error(name: str, fitted: list[str]) -> float:
        truth, rssi, _ = runs[name]
        slope, at_one_metre = path_loss(fitted)
        ranges = 10 ** ((rssi - at_one_metre) / (10 * slope))
        found = [least_squares(lambda p, r=r: np.linalg.norm(p - corners, axis=1) - r, (5.0, 5.0)).x for r in ranges]
        return position_rmse(np.clip(found, 0, 10) - truth)

    own = [error(name, [name]) for name in runs]
    others = [error(name, [other for other in runs if other != name]) for name in runs]
    middle = [position_rmse(truth - 5) for truth, _, _ in runs.values()]
    return [
        ["RMSE over two runs", "fitted on the run itself", metres(np.array(own))],
        ["", "fitted on the other run", metres(np.array(others))],
        ["", "the middle of the room", metres(np.array(middle))],
    ]


# Public scripts themselves, in a copy


def copy_of(clone: Path, folder: Path, changes: list[tuple[str, str, str]]) -> Path:
    """Write the Python files of a clone, at the commit that the page names, with changes (file, pattern, new text)."""
    listing = ["git", "-C", str(clone), "ls-tree", "-r", "--name-only", COMMITS[clone.name]]
    names = subprocess.check_output(listing, text=True).split("\n")
    for name in names:
        if name.endswith(".py"):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(show(clone, name))
    for name, pattern, new in changes:
        text, count = re.subn(pattern, new, (folder / name).read_text(), flags=re.MULTILINE)
        if not count:
            raise ValueError(f"{clone.name}/{name} has no {pattern!r}; is it commit {COMMITS[clone.name]}?")
        (folder / name).write_text(text)
    return folder


def run_script(
    clone: Path, changes: list[tuple[str, str, str]], driver: str, *arguments: str
) -> dict[str, list[float]]:
    """Run a driver in a copy of a clone; it prints lines `name: number ...`."""
    with tempfile.TemporaryDirectory() as folder:
        copy = copy_of(clone, Path(folder), changes)
        command = [sys.executable, "-W", "ignore", "-c", driver, *arguments]
        done = subprocess.run(command, cwd=copy, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ValueError(f"{clone.name}: {done.stderr.strip().splitlines()[-1]}")
    rows = [line.split(": ") for line in done.stdout.splitlines() if line.startswith("RMSE ")]
    return {name.removeprefix("RMSE "): [float(value) for value in values.split()] for name, values in rows}


def rows_of(what: str, variants: dict[str, dict[str, list[float]]], methods: list[str]) -> list[list[str]]:
    """Return a row for each variant of a script and each of its methods."""
    return [
        [f"{what}, {method}", variant, metres(np.array(found[method]))]
        for method in methods
        for variant, found in variants.items()
    ]


HEADING = """
import builtins, contextlib, importlib, io, math, sys
import numpy as np
def plain(f):  # numpy 2 does not make a number of a matrix
    return lambda *v: f(*(float(np.asarray(x).squeeze()) for x in v))
for name in ('cos', 'sin', 'atan2', 'sqrt'):
    setattr(math, name, plain(getattr(math, name)))
np.int, builtins.plain = int, plain(float)
import matplotlib; matplotlib.use('Agg')
sys.path[:0] = ['src'] + ['src/' + room for room in ('dataset_manager', 'algorithms', 'requests', 'robots')]
from dataset_manager.realworld_dataset_manager import RW_Dataset_Manager
from robots.robot_system import RobotSystem
from simulation_process.sim_manager import SimulationManager
import simulation_process.state_recorder as recorder
labels = [1, 2, 3, 4, 5]
for name, alone in (('LS_Cen', False), ('LS_CI', False), ('GS_CI', True)):
    with contextlib.redirect_stdout(io.StringIO()):
        module = importlib.import_module(name)
        data = RW_Dataset_Manager('replay'); data.load_datasets(sys.argv[1], labels, 200.0)
        team = RobotSystem('robot', labels, getattr(module, name)('algorithm'), distr_sys=alone)
        states = recorder.StatesRecorder(name, labels)
        SimulationManager('replay').sim_process_native(labels, data, team, states, simple_plot=False)
    print('RMSE ' + name + ':', np.sqrt(np.mean(np.concatenate([np.square(states.loc_err_arr[k]) for k in labels]))))
"""


def replay_heading(clone: Path, data: Path) -> list[list[str]]:
    """Return rows: MRCLAM set 6 with the tracked heading, and with the heading that odometry gives."""
    integrated = (
        r"\1orientation = (self.starting_states[label][3] if not self.odometry_data[i] else "
        "self.odometry_data[i][-1]['orientation'] + "
        "self.odometry_data[i][-1]['angular velocity'] * self.odometry_data[i][-1]['delta_t'])\n\\1try:"
    )
    change = (
        "src/dataset_manager/realworld_dataset_manager.py",
        r"^( +)orientation = self\.groundtruth_data\[i\]\[g_idx\]\['orientation'\]\n +try:",
        integrated,
    )
    files = ("src/algorithms/LS_CI.py", "src/simulation_process/state_recorder.py")
    for_numpy_2 = [(name, r"\bfloat\(", "plain(") for name in files]
    with tempfile.TemporaryDirectory() as folder:
        write_subjects(data / "mrclam6", Path(folder))
        variants = {
            "as published": run_script(clone, for_numpy_2, HEADING, f"{folder}/"),
            "heading of odometry": run_script(clone, [*for_numpy_2, change], HEADING, f"{folder}/"),
        }
    return rows_of("RMSE on MRCLAM set 6", variants, ["LS_Cen", "LS_CI", "GS_CI"])


def write_subjects(recording: Path, folder: Path) -> None:
    """Write MRCLAM's files with the subject in place of the barcode, as that code expects them."""
    lines = [line.split() for line in (recording / "Barcodes.dat").read_text().splitlines()]
    subject = {code: robot for robot, code in (line for line in lines if len(line) == 2 and line[0] != "#")}
    for file in recording.glob("*.dat"):
        text = file.read_text().replace("\r", "")
        (folder / file.name).write_text(text)
        if "Measurement" in file.name:
            rows = [line.split() for line in text.splitlines() if line and line[0] != "#"]
            known = [[row[0], subject[row[1]], *row[2:]] for row in rows if row[1] in subject]
            (folder / f"{file.stem}_x.dat").write_text("# \n" + "\n".join(map(" ".join, known)) + "\n")


FLAGS = """
import numpy as np
import main_kf
agents = []
main_kf.tools.calc_errors = lambda agent, start=0: agents.append(agent)
main_kf.tools.animate_3d_trajectories = main_kf.tools.plot_trajectory = lambda *a, **k: None
found = {'GNSS and IMU': [], 'team': []}
for seed in range(20):
    np.random.seed(seed)
    main_kf.main()
    agent = agents.pop()
    for name, track in (('GNSS and IMU', agent.ksol1), ('team', agent.final)):
        error = (np.array(track) - np.array(agent.states))[np.array(agent.t) >= 0, :3]
        found[name].append(np.sqrt(np.mean(np.sum(error**2, 1))))
for name, values in found.items():
    print('RMSE ' + name + ':', *values)
"""


def replay_flags(clone: Path) -> list[list[str]]:
    """Return rows: filters that are given the simulator's flag of bad reception, and filters without it."""
    changes = [
        ("agent_kf.py", r"self\.in_outage, self\.in_blockage\)", "self.in_outage, False)"),
        ("kalman_3.py", r"agents\[j\]\.in_blockage or ", ""),
    ]
    variants = {"as published": run_script(clone, [], FLAGS), "without the flag": run_script(clone, changes, FLAGS)}
    return rows_of("RMSE over twenty seeds", variants, ["GNSS and IMU", "team"])


SHIFT = """
import contextlib, io, random, sys
import numpy as np
import matplotlib; matplotlib.use('Agg')
with contextlib.redirect_stdout(io.StringIO()):
    import simulator
    found = []
    for seed in range(20):
        np.random.seed(seed); random.seed(seed)
        one = simulator.BlindSim(); one.plot_path = lambda: None
        try:
            one.no_env_sim()
        except ValueError:  # all weights are zero: the script ends there
            continue
        one.get_corrected_location()
        truth = np.array([[(p['x'], p['y']) for p in h['positions']] for h in one.history])
        mean = np.array([[(m['mean_x'], m['mean_y']) for m in map(simulator.MCL(1).cluster_mean, h['particles'])]
                         for h in one.history])
        shifted = np.array([h['corrected'][0].T for h in one.history])
        found.append([np.sqrt(np.mean(np.sum(e**2, -1))) for e in (shifted, truth - mean)])
print('RMSE shifted:', *np.array(found)[:, 0])
print('RMSE plain:', *np.array(found)[:, 1])
"""


def replay_shift(clone: Path) -> list[list[str]]:
    """Return rows: the error as the script reports it, after a shift by the true mean, and without the shift."""
    at_end = ("simulator.py", r"^bsim.*\n", "")
    found = run_script(clone, [at_end], SHIFT)
    return [
        ["RMSE over twenty seeds, runs that end", "as published", metres(np.array(found["shifted"]))],
        ["", "without the shift", metres(np.array(found["plain"]))],
    ]


RESET = """
import sys, types
import numpy as np
class Robot:  # the repository has no robot.py: as its calls read, with the heading noise that sim_env.py names
    def __init__(self, _position): self.position, self.theta = np.asarray(_position, float).ravel(), 0.0
    def motion_propagation(self, u, dt):
        self.theta += (u[1] + np.random.normal(0, sim_env.var_u_theta**0.5)) * dt
        self.position = self.position + u[0] * dt * np.array([np.cos(self.theta), np.sin(self.theta)])
sys.modules['robot'] = types.ModuleType('robot'); sys.modules['robot'].Robot = Robot
import math
def plain(f):
    return lambda *v: f(*(float(np.asarray(x).squeeze()) for x in v))
for name in ('cos', 'sin', 'atan2', 'sqrt'):
    setattr(math, name, plain(getattr(math, name)))
import sim_env, os
sim_env.total_T = 400
os.makedirs('topology', exist_ok=True); os.makedirs('topology_result', exist_ok=True)
np.random.seed(1)
import topology_sim
for name, error in topology_sim.rmse_arr.items():
    print('RMSE ' + name + ':', float(error))
"""


def replay_reset(clone: Path) -> list[list[str]]:
    """Return rows: a simulation that sets all headings to the true ones at every tick, and one that does not."""
    fewer = ("topology_sim.py", r"^num_of_topology = 50", "num_of_topology = 10")
    change = ("topology_sim.py", r"^(\t\t\t\w+(?:\[n\])?\.theta(?:\[n\])?) = robots\[n\]\.theta", r"\1 += 0")
    variants = {
        "as published": run_script(clone, [fewer], RESET),
        "headings of odometry": run_script(clone, [fewer, change], RESET),
    }
    return rows_of("RMSE after 400 ticks, ten networks", variants, ["LS-Cen", "LS-CI", "GS-CI"])


def table(rows: list[list[str]]) -> str:
    """Return a pipe table of what was measured."""
    head = [["measured", "variant", "error [m]"], ["---"] * 3]
    return "\n".join(f"| {' | '.join(row)} |" for row in head + rows)


def main(repositories: Path, data: Path, page: Path, *only: Path) -> None:
    """Write the tables of the page between their marks, or those of these names only."""
    replays: dict[str, Callable[[], list[list[str]]]] = {
        "average": lambda: replay_average(data),
        "fit": lambda: replay_fit(repositories / "cdoa-localization"),
        "heading": lambda: replay_heading(repositories / "multirobot_localization_utias", data),
        "flags": lambda: replay_flags(repositories / "cooperative-localization"),
        "shift": lambda: replay_shift(repositories / "multi_robot_localization"),
        "reset": lambda: replay_reset(repositories / "multirobot_localization"),
    }
    text = page.read_text()
    for name, replay in replays.items():
        if only and Path(name) not in only:
            continue
        written = f"<!-- {name} -->\n\n{table(replay())}\n\n<!-- end of {name} -->"
        text = re.sub(rf"<!-- {name} -->.*?<!-- end of {name} -->", lambda _, new=written: new, text, flags=re.DOTALL)
        print(name, written.split("\n", 4)[-1], sep="\n", flush=True)
    page.write_text(text)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))

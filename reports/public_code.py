"""Replays public scripts of cooperative localization as published and with one thing changed: reports/public-code.md.

Run: python reports/public_code.py REPOSITORIES DATA reports/public-code.md [NAME ...]. REPOSITORIES holds clones, each
in a folder of its own name; DATA holds the recordings wifi-rssi and mrclam6. Scripts run in a copy, at the commits of
benchmarks/public_scripts.toml. Two replays are our own numpy, because the script itself needs a robot or a screen.
"""

import io
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from page import pipe, put_between
from scipy.optimize import least_squares

import cooploc as cl

Array = NDArray[np.float64]
Row = tuple[str, str, list[float]]  # what is measured, the variant, errors [m]
SCRIPTS = tomllib.loads((Path(__file__).resolve().parents[1] / "benchmarks/public_scripts.toml").read_text())
NODES = np.array([(0, 0), (0, 1.75), (2.34, 1.75), (2.34, 0)])  # of the WiFi runs [m]
SEEDS = range(5)
EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
PLUGINS = ("multilateration.py:Multilateration", "weighted_centroid.py:WeightedCentroid",
           "differential_rss.py:DifferentialRss", "markov_grid.py:MarkovGrid")  # fmt: skip
COMPARED = ["arl", "rssi-pf", "constant", "dead-reckoning", *(f"{EXAMPLES}/{name}" for name in PLUGINS)]
DATASET2 = "3684b64b1e3d68469bf1b900c044d011844ad8de"  # commit of cdoa-localization


def position_rmse(error: Array) -> float:
    """Return the root mean square of position errors (n, 2) [m]."""
    return float(np.sqrt(np.mean(np.sum(np.square(error), -1))))


def track(readings: Array, truth: Array, average: bool, turn: bool, seed: int) -> Array:
    """Return what ros/PFLocalization.py estimates (n, 2) [m] of readings (n, 4) [dBm] and tracked positions (n, 2) [m].

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

    measured = direction(readings) + turn * np.arctan2(2 * truth[:, 0] * truth[:, 1], 1 - 2 * truth[:, 1] ** 2)
    particles = random.uniform((0.9, 0.6), (1.3, 1.0), (1000, 2))
    best, estimates = list[float](), np.empty_like(truth)
    for i, rssi in enumerate(readings):
        distance = np.linalg.norm(particles[:, None] - NODES, axis=-1).clip(0.01)
        model = -40 - 30 * np.log10(distance) + random.normal(0, 2, (len(particles), 1))
        error = np.abs(direction(model) - measured[i])
        deviation = (model - rssi).std(-1)
        log_weight = -(1 + len(best)) * np.log(deviation) - (error**2 + np.square(best).sum()) / (2 * deviation**2)
        winner = int(np.argmax(log_weight))
        best = [*best, float(error[winner])][-3:]
        estimates[i] = (particles[winner] + truth[i]) / 2 if average else particles[winner]
        particles = estimates[i] + random.uniform(-0.1, 0.1, (max(200, -(-len(particles) // 2)), 2))
    return estimates


def replay_average(repositories: Path, data: Path) -> list[Row]:
    """Return rows: the eleven WiFi runs as published, with less of the truth, and a constant."""
    variants = {
        "as published": (True, True),
        "without the average": (False, True),
        "without the average and the angle": (False, False),
        "always the middle of the room": None,
    }
    errors: dict[str, list[float]] = {name: [] for name in variants}
    for file in sorted((data / "wifi-rssi").glob("*.csv")):
        if "4.4.1" in file.name:  # the tail of another run
            continue
        log = pd.read_csv(file)
        ticks = np.arange(5, len(log) - 5)
        rssi = log[[f"rssi{k}" for k in (1, 2, 3, 4)]].to_numpy(float)
        smooth = np.array([rssi[i - 5 : i + 5].mean(0) for i in ticks])  # four of the ten rows are of the future
        truth = log[["robot_pos_x", "robot_pos_y"]].to_numpy(float)[ticks]
        for name, parts in variants.items():
            found = [track(smooth, truth, *parts, seed) for seed in SEEDS] if parts else [NODES.max(0) / 2]
            errors[name] += [position_rmse(one - truth) for one in found]
    return [("RMSE over eleven WiFi runs", name, found) for name, found in errors.items()]


def replay_fit(repositories: Path, data: Path) -> list[Row]:
    """Return rows: multilateration on dataset2 with the path loss of the run itself, and with that of the other run."""
    runs = {}
    for run in ("diag0", "diag1"):
        files = [f"dataset2/measurements/{run}/s{k}.csv" for k in range(4)]
        sources = [io.BytesIO(show(repositories / "cdoa-localization", DATASET2, file)) for file in files]
        logs = [pd.read_csv(source, sep=";", skipinitialspace=True) for source in sources]
        rows = slice(0, min(map(len, logs)), 100)
        rssi = np.stack([log["rssi"].to_numpy(float)[rows] for log in logs], -1)
        distance = np.stack([log["distance"].to_numpy(float)[rows] for log in logs], -1)
        runs[run] = logs[0][["x", "y"]].to_numpy(float)[rows], rssi, distance

    def error(name: str, fitted: str) -> float:
        truth, rssi, _ = runs[name]
        slope, at_one_metre = np.polyfit(10 * np.log10(runs[fitted][2]).ravel(), runs[fitted][1].ravel(), 1)
        corners = np.array([(0, 0), (10, 0), (10, 10), (0, 10)])
        ranges = 10 ** ((rssi - at_one_metre) / (10 * slope))
        found = [least_squares(lambda p, r=r: np.linalg.norm(p - corners, axis=1) - r, (5.0, 5.0)).x for r in ranges]
        return position_rmse(np.clip(found, 0, 10) - truth)

    what = "RMSE over two runs"
    return [
        (what, "fitted on the run itself", [error(name, name) for name in runs]),
        (what, "fitted on the other run", [error("diag0", "diag1"), error("diag1", "diag0")]),
        (what, "the middle of the room", [position_rmse(truth - 5) for truth, _, _ in runs.values()]),
    ]


def replay_baselines(repositories: Path, data: Path) -> list[Row]:
    """Return rows: filters and the companion's baselines on its recordings, its scripts, and an error that it holds."""
    clone, rows = repositories / "cdoa-localization", replay_script("baselines", repositories, data)
    kept = show(clone, DATASET2, "dataset2/error_diag0.csv").decode().split(",")
    rows.append(("dataset2", "the file error_diag0.csv, mean error", [float(kept[1])]))
    with tempfile.TemporaryDirectory() as scratch:
        subprocess.run([sys.executable, EXAMPLES / "companion_recordings.py", clone, scratch], check=True)
        for place, study, sets in (
            (Path(scratch, "trajectories"), "log", ["boundary", "diagonal", "diagonal", "inside", "inside"]),
            (Path(scratch, "dataset2"), "log", ["dataset2"] * 2),
            (data / "wifi-rssi", "wifi", ["WiFi"] * 11),
        ):
            run = cl.run_study(study, data=place, estimators=COMPARED, out=Path(scratch, f"run-{place.name}"))
            table = run.rows.drop_duplicates(["estimator", "trial"])
            for (name, k), one in table.groupby(["estimator", table["trial"].map(sets.__getitem__)], sort=False):
                rows.append((str(k), Path(str(name)).name, list(one["rmse"])))
    return rows


def show(clone: Path, commit: str, name: str) -> bytes:
    """Return a file of a clone at a commit."""
    return subprocess.check_output(["git", "-C", str(clone), "show", f"{commit}:{name}"])


def run_script(script: dict[str, Any], clone: Path, changes: list[list[str]], argument: str) -> dict[str, list[float]]:
    """Return the errors that a script's driver prints, run in a copy of its repository with changes made."""
    listing = ["git", "-C", str(clone), "ls-tree", "-r", "--name-only", script["commit"]]
    with tempfile.TemporaryDirectory() as folder:
        for name in subprocess.check_output(listing, text=True).split("\n"):
            if name.endswith(".py"):
                file = Path(folder, name)
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(show(clone, script["commit"], name))
        for name, pattern, new in changes:
            text, count = re.subn(pattern, new, Path(folder, name).read_text(), flags=re.MULTILINE)
            if not count:
                raise ValueError(f"{clone.name}/{name} has no {pattern!r}; is it commit {script['commit']}?")
            Path(folder, name).write_text(text)
        command = [sys.executable, "-W", "ignore", "-c", script["driver"], argument]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ValueError(f"{clone.name}: {done.stderr.strip().splitlines()[-1]}")
    rows = re.findall(r"^RMSE (.*): (.*)$", done.stdout, re.MULTILINE)
    return {name: [float(value) for value in values.split()] for name, values in rows}


def replay_script(name: str, repositories: Path, data: Path) -> list[Row]:
    """Return rows: a public script as published and with its change, or what its driver measures of one run."""
    script = SCRIPTS[name]
    clone, what, always = repositories / script["repository"], script["measured"], script["always"]
    with tempfile.TemporaryDirectory() as folder:
        write_subjects(data / "mrclam6", Path(folder))
        plain = run_script(script, clone, always, f"{folder}/")
        if "change" not in script:
            return [(what, method, plain[method]) for method in script["methods"]]
        changed = run_script(script, clone, [*always, *script["change"]], f"{folder}/")
    variants = {"as published": plain, script["changed"]: changed}
    return [(f"{what}, {m}", variant, found[m]) for m in script["methods"] for variant, found in variants.items()]


def write_subjects(recording: Path, folder: Path) -> None:
    """Write MRCLAM's files with the subject in place of the barcode, as multirobot_localization_utias expects them."""
    lines = [line.split() for line in (recording / "Barcodes.dat").read_text().splitlines()]
    subject = {code: robot for robot, code in (line for line in lines if len(line) == 2 and line[0] != "#")}
    for file in recording.glob("*.dat"):
        text = file.read_text().replace("\r", "")
        (folder / file.name).write_text(text)
        if "Measurement" in file.name:
            rows = [line.split() for line in text.splitlines() if line and line[0] != "#"]
            known = [[row[0], subject[row[1]], *row[2:]] for row in rows if row[1] in subject]
            (folder / f"{file.stem}_x.dat").write_text("# \n" + "\n".join(map(" ".join, known)) + "\n")


def main(repositories: str, data: str, page: str, *only: str) -> None:
    """Write the tables of the page between their marks, or those of these names only."""
    for name in only or ("average", "fit", *SCRIPTS):
        own = {"average": replay_average, "fit": replay_fit, "baselines": replay_baselines}.get(name)
        places = Path(repositories), Path(data)
        rows = own(*places) if own else replay_script(name, *places)
        cells = [
            (what, variant, f"{np.mean(e):.2f}" + f" ({min(e):.2f} to {max(e):.2f})" * (len(e) > 1))
            for what, variant, e in rows
        ]
        frame = pd.DataFrame(cells, columns=["measured", "variant", "error [m]"])
        if name == "baselines":  # a column for each recording
            wide = frame.pivot(index="variant", columns="measured", values="error [m]").fillna("")
            frame = wide.loc[frame["variant"].unique(), frame["measured"].unique()].reset_index()
        table = pipe(frame)
        Path(page).write_text(put_between(Path(page).read_text(), name, f"\n{table}\n"))
        print(name, table, sep="\n", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])

"""Replays a public particle filter as published and with one thing changed: the first table of reports/public-code.md.

Run: python reports/public_code.py DATA reports/public-code.md. DATA holds the recordings wifi-rssi. The filter is our
own numpy, because the script itself needs a robot. The other tables of the page were made once, by replays that stand
in the history of this file.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from page import pipe, put_between

Array = NDArray[np.float64]
NODES = np.array([(0, 0), (0, 1.75), (2.34, 1.75), (2.34, 0)])  # of the WiFi runs [m]
SEEDS = range(5)


def metres(values: list[float]) -> str:
    """Return mean and range of the errors [m] of several runs."""
    return f"{np.mean(values):.2f}" + (f" ({min(values):.2f} to {max(values):.2f})" if len(values) > 1 else "")


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
    errors["always the middle of the room"] = middle
    return [["RMSE over eleven WiFi runs", name, metres(found)] for name, found in errors.items()]


def main(data: Path, page: Path) -> None:
    """Write the table of the page between its marks."""
    table = pipe(pd.DataFrame(replay_average(data), columns=["measured", "variant", "error [m]"]))
    page.write_text(put_between(page.read_text(), "average", f"\n{table}\n"))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))

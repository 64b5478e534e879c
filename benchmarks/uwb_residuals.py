"""The residuals of ultra-wide-band ranges against motion capture, as the world `uwb` draws them.

Run: python benchmarks/uwb_residuals.py BAG [OTHER_BAG ...] > scenarios/worlds/uwb_residuals.toml. The table is of the
first bag; how far the quantiles of the others lie from it is written into its comment. A bag is a directory with one
pair of radios (`sensor_msgs/Range`) and the poses of the two robots that carry them (`*_cap/pose`).
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

Array = NDArray[np.float64]
LEVELS = np.array([0, 0.001, 0.005, 0.01, 0.025, *np.arange(1, 20) / 20, 0.975, 0.99, 0.995, 0.999, 1])
COMPARED = np.array([0.05, 0.1, 0.25, 0.75, 0.9, 0.95])


def residuals(bag: Path) -> Array:
    """Range minus true distance [m] of every reading, the true poses interpolated at its stamp."""
    poses: dict[str, list[tuple[float, float, float]]] = {}
    ranges: list[tuple[float, float]] = []
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_FOXY)) as reader:
        for connection, stamp, raw in reader.messages():
            if connection.msgtype.endswith("/Range"):
                ranges.append((stamp / 1e9, reader.deserialize(raw, connection.msgtype).range))
            elif connection.topic.endswith("_cap/pose"):
                at = reader.deserialize(raw, connection.msgtype).pose.position
                poses.setdefault(connection.topic, []).append((stamp / 1e9, at.x, at.y))
    if len(poses) != 2 or not ranges:
        raise SystemExit(f"{bag}: it has {len(poses)} robots and {len(ranges)} ranges; a bag of one pair is needed")
    time, z = np.array(ranges).T
    x, y = (
        np.subtract(*(np.interp(time, np.array(p)[:, 0], np.array(p)[:, axis]) for p in poses.values()))
        for axis in (1, 2)
    )
    return np.asarray(z - np.hypot(x, y))


def table(first: Array, others: list[Array]) -> str:
    """The TOML file."""
    quantiles = np.quantile(first, LEVELS)
    bias = np.trapezoid(quantiles, LEVELS)
    lines = [
        "# Residuals of ultra-wide-band ranges between two robots, against motion capture, their mean taken off.",
        "# Made by benchmarks/uwb_residuals.py from TIERS/uwb-cooperative-mrs-localization (MIT licence), two robots.",
        f"# {len(first)} readings, bias {bias:.3f} m, standard deviation {first.std():.3f} m.",
    ]
    for other in others:
        apart = np.quantile(other - np.median(other), COMPARED) / np.quantile(first - np.median(first), COMPARED) - 1
        text = ", ".join(f"{level:g}: {share:+.0%}" for level, share in zip(COMPARED, apart, strict=True))
        lines.append(f"# Another recording, bias {other.mean():.3f} m: quantiles around its median differ by {text}.")
    return "\n".join([*lines, f"levels = {_list(LEVELS)}", f"quantiles = {_list(quantiles - bias)} # [m]", ""])


def _list(values: Array) -> str:
    return f"[{', '.join(f'{value:.4g}' for value in values)}]"


if __name__ == "__main__":
    measured = [residuals(Path(bag)) for bag in sys.argv[1:]]
    print(table(measured[0], measured[1:]), end="")

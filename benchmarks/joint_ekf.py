"""How much faster the joint EKF is than the loop that one writes with filterpy: a ratio within one run.

Run: python benchmarks/joint_ekf.py [rounds]. Both run in this process on the same stream, turn by turn, the loop with
fewer trials of it; ratios are of processor seconds per trial and tick, compilation left out. The loop is one
ExtendedKalmanFilter over the whole team, updated by one scalar reading after the other, and so is the plain mode,
whose estimates equal it; the default mode uses a tick's readings together, three times: other work.
"""

import math
import sys
from typing import Any

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

import cooploc as cl
from cooploc.estimators.interface import Belief, Traffic
from cooploc.estimators.models.gradient_doa import gradient_doa

PLAIN = {"iterations": 1, "second_order": False, "update": "sequential", "anchor_reading": "doa-constant"}
CASES = ((10, 100, 100, 2, 80), (50, 10, 10, 1, 200))  # robots, ticks, trials, the loop's, aim
EQUAL = 1e-7  # [m] within which the plain mode and the loop must agree


class Loop:
    """One trial's filter. Compass frame, four corner nodes read as one direction, ranges between robots."""

    def __init__(self, x: Any, P: Any, world: Any) -> None:
        self.n, (a, b) = len(x), world.arena[1]
        self.nodes = [(0.0, 0.0), (0.0, b), (a, b), (a, 0.0)]
        self.sides = 2 * a, 2 * b
        self.slope = 5 * world.sensors["anchor_rssi"].eta / math.log(10)  # dB per unit of ln d^2
        self.doa_R = np.eye(1) * gradient_doa(world).sigma ** 2
        self.range_R = world.sensors["radio_range"].R
        self.ekf = ExtendedKalmanFilter(2 * self.n, 1, 2 * self.n)
        self.ekf.x, self.ekf.B = x.ravel().copy(), np.eye(2 * self.n)
        self.ekf.P = np.zeros((2 * self.n, 2 * self.n))
        for i in range(self.n):
            self.ekf.P[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = P[i]
        self.Q = np.eye(2 * self.n) * world.motion.sigma**2 / world.motion.tick

    def predict(self, moves: Any, dt: float) -> None:
        self.ekf.Q = self.Q * dt
        self.ekf.predict(moves.ravel())

    def direct(self, i: int, S: Any) -> None:
        """Update by the direction of the gradient of four readings S."""
        gx, gy = self.gradient(S)
        z = math.atan2(gy, gx)
        self.update(z, lambda x: self.direction(x, i), self.doa_R, turned)

    def measure(self, i: int, j: int, z: float) -> None:
        """Update by a range from i to j."""
        self.update(z, lambda x: self.distance(x, i, j), self.range_R, np.subtract)

    def update(self, z: float, model: Any, R: Any, residual: Any) -> None:
        h, H = model(self.ekf.x)
        self.ekf.update(np.array([z]), lambda _: H, lambda _: h, R=R, residual=residual)

    def gradient(self, S: Any) -> tuple[float, float]:
        return (S[2] - S[1] + S[3] - S[0]) / self.sides[0], (S[2] - S[3] + S[1] - S[0]) / self.sides[1]

    def direction(self, x: Any, i: int) -> tuple[Any, Any]:
        px, py = float(x[2 * i]), float(x[2 * i + 1])
        offsets = [(px - qx, py - qy) for qx, qy in self.nodes]
        squares = [max(dx * dx + dy * dy, 0.01) for dx, dy in offsets]
        gx, gy = self.gradient([-self.slope * math.log(d2) for d2 in squares])
        far = [d2 > 0.01 for d2 in squares]
        by_x, by_y = (
            self.gradient([-2 * self.slope * o[k] / d2 * f for o, d2, f in zip(offsets, squares, far, strict=True)])
            for k in (0, 1)
        )
        strength = max(gx * gx + gy * gy, 0.01)
        H = np.zeros((1, 2 * self.n))
        H[0, 2 * i] = (gx * by_x[1] - gy * by_x[0]) / strength
        H[0, 2 * i + 1] = (gx * by_y[1] - gy * by_y[0]) / strength
        return np.array([math.atan2(gy, gx)]), H

    def distance(self, x: Any, i: int, j: int) -> tuple[Any, Any]:
        dx, dy = float(x[2 * i] - x[2 * j]), float(x[2 * i + 1] - x[2 * j + 1])
        d = math.hypot(dx, dy)
        H, near = np.zeros((1, 2 * self.n)), max(d, 0.1)
        H[0, 2 * i], H[0, 2 * i + 1], H[0, 2 * j], H[0, 2 * j + 1] = dx / near, dy / near, -dx / near, -dy / near
        return np.array([d]), H


def turned(a: Any, b: Any) -> Any:
    return (a - b + np.pi) % (2 * np.pi) - np.pi


class Filterpy:
    """The loops of all trials, as the runner wants them."""

    api, bound, mutable = 1, True, True
    uses = ("odometry", "anchor_rssi", "radio_range")

    def init(self, prior: Any, world: Any, rows: Any) -> list[Loop]:
        return [Loop(x, P, world) for x, P in zip(*prior, strict=True)]

    def predict(self, s: list[Loop], z: Any) -> list[Loop]:
        for t, loop in enumerate(s):
            loop.predict(z.odometry[t], z.dt[t, 0])
        return s

    def correct(self, s: list[Loop], z: Any) -> list[Loop]:
        for loop, readings in zip(s, z.anchor_rssi.tolist(), strict=True):
            for i, S in enumerate(readings):
                loop.direct(i, S)
        return s

    def exchange(self, s: list[Loop], z: Any, air: Any) -> tuple[list[Loop], Any]:
        for loop, ranges in zip(s, air.range.tolist(), strict=True):
            for j in range(loop.n):
                for i in range(loop.n):
                    if ranges[i][j] >= 0.2:  # absent is nan
                        loop.measure(i, j, ranges[i][j])
        nothing = np.zeros((len(s), s[0].n))
        return s, Traffic(nothing, nothing)

    def estimate(self, s: list[Loop]) -> Any:
        n = s[0].n
        x = np.stack([loop.ekf.x.reshape(n, 2) for loop in s])
        P = np.stack([np.einsum("iaib->iab", loop.ekf.P.reshape(n, 2, n, 2)) for loop in s])
        return Belief(x, P)


def rows(rounds: int = 3) -> list[dict[str, Any]]:
    """What was compared, the median ratio of times, its smallest and largest, and the ratio aimed at."""
    found = []
    for robots, ticks, trials, few, aim in CASES:
        _, stream = cl.simulate(f"scalability/n={robots}", trials=trials, seed=1, ticks=ticks)
        ours = {"plain": cl.make("ekf-joint", gate=np.inf, **PLAIN), "default": cl.make("ekf-joint")}
        cl.run({"filterpy": Filterpy(), **ours}, stream.select(slice(0, 1)).first_ticks(1), isolate=False)  # import
        ratios: dict[str, list[float]] = {name: [] for name in ours}
        for _ in range(rounds):
            theirs, loop = per_tick("filterpy", Filterpy(), stream.select(slice(0, few)))
            for name, estimator in ours.items():
                mine, x = per_tick(name, estimator, stream)
                ratios[name].append(theirs / mine)
                if name == "plain" and (off := float(np.abs(x[:few] - loop).max())) > EQUAL:
                    raise RuntimeError(f"the plain mode and the loop differ by {off:.1e} m at {robots} robots")
        for name, ratio in ratios.items():
            what = f"filterpy / ekf-joint, {name}, {robots} robots, {trials}x{ticks} (its {few}x{ticks})"
            summary = {"ratio": float(np.median(ratio)), "low": min(ratio), "high": max(ratio), "target": aim}
            found.append({"what": what, **summary})
    return found


def per_tick(name: str, estimator: Any, stream: Any) -> tuple[float, Any]:
    """Processor seconds per trial and tick, and positions."""
    trace = cl.run({name: estimator}, stream, isolate=False).traces[name]
    return trace.seconds / (trace.x.shape[0] * trace.x.shape[1]), trace.x


def main(rounds: int = 3) -> None:
    print(f"{'what':<68}{'times':>8}{'spread':>18}{'aim':>6}")
    for row in rows(rounds):
        spread = f"{row['low']:.1f} to {row['high']:.1f}"
        print(f"{row['what']:<68}{row['ratio']:>8.1f}{spread:>18}{row['target']:>6}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

"""How much faster the batched EKFs are than filterpy's loop that computes the same: a ratio within one run.

Run: python benchmarks/ekf_engines.py [rounds]. Both engines go through `cl.run(..., jobs=1)` on the same stream,
interleaved; the median ratio and its spread are printed, and how far the estimates differ.
"""

import sys

import numpy as np

import cooploc as cl

PLAIN = {"iterations": 1, "second_order": False, "update": "sequential"}
CASES = (
    ("ekf-local", {}, "trajectory[ticks=50]", 20),
    ("ekf-joint", PLAIN, "trajectory[ticks=20]", 10),
    ("ekf-joint", PLAIN, "scalability/n=10[ticks=5]", 5),
)


def main(rounds: int = 5) -> None:
    print(f"{'estimator':<12}{'scenario':<28}{'times filterpy':>15}{'spread':>16}{'largest difference':>20}")
    for name, parameters, scenario, trials in CASES:
        _, stream = cl.simulate(scenario, trials=trials, seed=1)
        both = {engine: cl.make(name, engine=engine, gate=np.inf, **parameters) for engine in ("batched", "filterpy")}
        cl.run(both, stream.select(slice(0, 1)))  # compile, import
        ratios = []
        for _ in range(rounds):
            traces = cl.run(both, stream).traces
            ratios.append(traces["filterpy"].seconds / traces["batched"].seconds)
        difference = np.abs(traces["filterpy"].x - traces["batched"].x).max()
        spread = f"{min(ratios):.1f} to {max(ratios):.1f}"
        print(f"{name:<12}{scenario:<28}{np.median(ratios):>15.1f}{spread:>16}{difference:>20.1e}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

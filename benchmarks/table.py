"""The README's table of speed: every ratio with its spread beside what is required, and the machine.

Run: python benchmarks/table.py [rounds]. Prints Markdown.
"""

import sys

import commands
import joint_ekf
import particle_filter
import scaling

from cooploc.analysis.execution.provenance import provenance


def main(rounds: int = 5) -> None:
    """Print each row as soon as it is measured."""
    made = provenance()
    versions = ", ".join(f"{name} {made['versions'][name]}" for name in ("python", "numpy", "numba", "filterpy"))
    print(f"{made['cpu']}; {versions}; {rounds} rounds\n")
    print("| | median | range | required |\n| --- | ---: | ---: | ---: |")
    for module in (particle_filter, joint_ekf, scaling, commands):
        for row in module.rows(rounds):
            numbers = f"{row['ratio']:.3g} | {row['low']:.3g} to {row['high']:.3g} | {row['target']:g}"
            print(f"| {row['what']} | {numbers} |", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

"""Is an honest estimator with unusual habits ever accused? Every check, also on worlds of full length.

Run: python benchmarks/statistics/oddities.py REPORT [SEEDS]. Writes the report after every seed, so it can be ended at
any time. Exit code 1 where one is accused.
"""

import sys
import time
from collections import Counter
from importlib import import_module
from pathlib import Path

import numpy as np
from accusations import report

from cooploc.analysis.execution.world_players import players
from cooploc.scenarios import simulate
from cooploc.scenarios.conformance.check import check_estimator
from cooploc.scenarios.conformance.own_worlds import OWN, OwnWorld, outcome
from cooploc.scenarios.conformance.report import Report, Result

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "helpers"))
honest = import_module("honest")
SEEDS = 20
WORLD = "robots-1-3/n=5[drop=0.3,ticks=120]"
TITLE = "# Is an honest estimator with unusual habits ever accused?"
ABOUT = (
    "Honest estimators with unusual habits (tests/helpers/honest.py), by every check of `cooploc check` and by those\n"
    f"of a certificate on `{WORLD}`. Made by `make oddities`."
)


def checked(cls: type, seed: int) -> Report:
    """All checks of one, on the small streams and on a world of full length."""
    found = check_estimator(cls(), cls.__name__, seed, isolate=False)
    _, stream = simulate(WORLD, trials=[seed, 100 + seed], seed=10_000 + seed)
    own = OwnWorld(stream, players(f"{honest.__file__}:{cls.__name__}", 600.0), np.random.default_rng(seed))
    more = (Result(name, *outcome(lambda check=check: check(own)), seed) for name, check in OWN.items())  # type: ignore
    return Report(found.name, (*found.results, *more))


def main(out: str, seeds: int = SEEDS) -> int:
    """Check, write, and count the accusations."""
    found: dict[str, list[Report]] = {cls.__name__: [] for cls in honest.HONEST}
    seconds: Counter[str] = Counter()
    for seed in range(seeds):
        for cls in honest.HONEST:
            began = time.process_time()
            found[cls.__name__].append(checked(cls, seed))
            seconds[cls.__name__] += time.process_time() - began
        _, _, rest = report(found, seconds).partition("\n\n")
        table = rest[rest.index("\n\n") :]
        Path(out).write_text(f"{TITLE}\n\n{ABOUT}{table}", encoding="utf-8")
        print(f"{seed + 1} of {seeds} seeds", file=sys.stderr, flush=True)
    return int(any(r.count("failed") for reports in found.values() for r in reports))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], *map(int, sys.argv[2:])))

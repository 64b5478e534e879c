"""How often `cooploc inspect` names a glitch that is there, and how often one that is not: on simulated teams.

Run: PYTHONPATH=tests/helpers python benchmarks/statistics/findings.py REPORT [SEEDS [MINUTES]]. Clean teams of three
worlds first, `SEEDS` each; then every glitch of `tests/helpers/made_teams.py`, `SEEDS` teams divided among the worlds
where it can be seen. Writes the report after every row and goes on from the rows that it has.
"""

import sys
import time
from collections import Counter
from pathlib import Path

from made_teams import GLITCHES, WORLDS, team_log
from scipy.stats import binomtest

from cooploc.scenarios.recordings.inspect.looks import findings

HEAD = """# What `cooploc inspect` finds, and what it reports though it is not there

Recordings of cooploc's own worlds: `camera` (60 s of wheeled robots that see landmarks and each other), `no-compass`
(300 s of wheeled robots with ranges and signal strength), `trajectory` (300 s of robots with a compass). A finding is
false where nothing was done to the recording, or where it is of another kind or robot than what was done. *Named*:
teams whose findings have what was done, of the right robot. Made by `make findings`; intervals are 95 %, Clopper and
Pearson.

| what was done | teams | named | other findings |
| --- | ---: | ---: | --- |
"""


def main() -> None:
    """Write the rows that are missing."""
    path, seeds = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 100
    ends = time.monotonic() + 60 * float(sys.argv[3]) if len(sys.argv) > 3 else float("inf")
    text = path.read_text(encoding="utf-8") if path.exists() else HEAD
    clean = {f"nothing, {world}": world for world in WORLDS}
    for name in (*clean, *GLITCHES):
        if f"| {name} |" in text or time.monotonic() > ends:
            continue
        text += _clean(name, clean[name], seeds) if name in clean else _glitch(name, seeds)
        path.write_text(text, encoding="utf-8")


def _clean(name: str, world: str, seeds: int) -> str:
    found = [{f.kind for f in findings(team_log(world, seed))} for seed in range(seeds)]
    kinds = Counter(kind for one in found for kind in one)
    return _row(name, seeds, None, sum(map(bool, found)), kinds)


def _glitch(name: str, seeds: int) -> str:
    kind, robot, worlds, spoil = GLITCHES[name]
    named, strange, others = 0, 0, Counter[str]()
    for seed in range(seeds):
        found = {(f.kind, f.robot) for f in findings(spoil(team_log(worlds[seed % len(worlds)], seed)))}
        named += (kind, robot) in found
        extra = {k for k, r in found if (k, r) != (kind, robot) and (k != kind or kind != "robots")}
        strange += bool(extra)
        others.update(extra)
    return _row(name, seeds, named, strange, others)


def _row(name: str, teams: int, named: int | None, strange: int, kinds: Counter[str]) -> str:
    words = ", ".join(f"{kind} {count}" for kind, count in kinds.most_common()) or "none"
    right = "" if named is None else _share(named, teams)
    return f"| {name} | {teams} | {right} | {_share(strange, teams)}: {words} |\n"


def _share(count: int, teams: int) -> str:
    low, high = binomtest(count, teams).proportion_ci()
    return f"{count} ({100 * low:.0f} to {100 * high:.0f} %)"


if __name__ == "__main__":
    main()

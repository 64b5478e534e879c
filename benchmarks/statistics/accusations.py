"""Is an honest estimator ever accused? Every check on every built-in estimator, each seed other small streams.

Run: python benchmarks/statistics/accusations.py REPORT [SEEDS [ESTIMATOR ...]]. Writes the report after every seed, so
it can be ended at any time; the rows of estimators that are not asked for stay as they are in the report. An accusation
is a fault of the filter or of the check; exit code 1 where there is one.
"""

import sys
import time
from collections import Counter
from collections.abc import Collection
from pathlib import Path

import numpy as np

from cooploc.analysis.execution.provenance import provenance
from cooploc.analysis.formats import percent
from cooploc.analysis.metrics.statistics import share
from cooploc.estimators import BUILTIN, make
from cooploc.scenarios.conformance.check import check_estimator
from cooploc.scenarios.conformance.report import Report

SEEDS = 50


def report(found: dict[str, list[Report]], seconds: Counter[str], before: str = "") -> str:
    """The table, and every accusation in full; `before` is the report whose other rows stay."""
    made = provenance()
    lines = [
        "# Is an honest estimator ever accused?",
        "",
        "Every check of `cooploc check` on every built-in estimator; each seed gives other small streams and other",
        "disturbances of them. Made by `make accuse`.",
        "",
        f"{made['cpu']}; cooploc {made['versions']['cooploc']}, numpy {made['versions']['numpy']}.",
        "",
        "| estimator | seeds | checks that ran | skipped | false accusations | processor seconds a seed |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    rows = _kept(before, found)
    for name, reports in found.items():
        ran, skipped, failed = sum(r.ran for r in reports), *(sum(r.count(s) for r in reports) for s in _OTHER)
        each = seconds[name] / len(reports)
        rows[name] = f"| `{name}` | {len(reports)} | {ran} | {skipped} | {failed} | {each:.1f} |"
    lines += [rows[name] for name in dict.fromkeys([*BUILTIN, *rows]) if name in rows]
    fewest = min(int(row.split("|")[2]) for row in rows.values())
    return "\n".join([*lines, "", *(_accusations(found, before) or _none(fewest))]) + "\n"


_OTHER = ("skipped", "failed")


def _kept(before: str, found: Collection[str]) -> dict[str, str]:
    """The rows of a report by estimator, but for those found now."""
    rows = {line.split("`")[1]: line for line in before.splitlines() if line.startswith("| `")}
    return {name: line for name, line in rows.items() if name not in found}


def _accusations(found: dict[str, list[Report]], before: str) -> list[str]:
    told = [line for line in before.splitlines() if line.startswith("- `") and line.split("`")[1] not in found]
    told += [
        f"- `{name}`, seed {result.seed}, {result.check}: {result.detail}"
        for name, reports in found.items()
        for one in reports
        for result in one.results
        if result.status == "failed"
    ]
    return told


def _none(seeds: int) -> list[str]:
    """That there was no accusation, and what so many seeds leave open."""
    most = percent(share(np.zeros(seeds)).high)
    return [
        f"No estimator was accused. With {seeds} seeds of each, accusations in up to {most} of the seeds are not",
        "excluded (Wilson, 95 %).",
    ]


def main(out: str, seeds: str = str(SEEDS), *names: str) -> int:
    """Check, write, and count the accusations."""
    found: dict[str, list[Report]] = {name: [] for name in names or BUILTIN}
    before = Path(out).read_text(encoding="utf-8") if names and Path(out).exists() else ""
    seconds: Counter[str] = Counter()
    for seed in range(int(seeds)):
        for name, reports in found.items():
            began = time.process_time()
            reports.append(check_estimator(make(name), name, seed))
            seconds[name] += time.process_time() - began
        Path(out).write_text(report(found, seconds, before), encoding="utf-8")
        print(f"{seed + 1} of {seeds} seeds", file=sys.stderr, flush=True)
    return int(any(r.count("failed") for reports in found.values() for r in reports))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

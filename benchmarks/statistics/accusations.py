"""Is an honest estimator ever accused? Every check on every built-in estimator, each seed other small streams.

Run: python benchmarks/statistics/accusations.py REPORT [SEEDS]. Writes the report after every seed, so it can be ended
at any time. An accusation is a fault of the filter or of the check; exit code 1 where there is one.
"""

import sys
import time
from collections import Counter
from pathlib import Path

from cooploc.analysis.execution.provenance import provenance
from cooploc.estimators import BUILTIN, make
from cooploc.scenarios.conformance.check import Report, check_estimator

SEEDS = 50


def report(found: dict[str, list[Report]], seconds: Counter[str]) -> str:
    """The table, and every accusation in full."""
    made = provenance()
    lines = [
        "# Is an honest estimator ever accused?",
        "",
        "Every check of `cooploc check` on every built-in estimator; each seed gives other small streams and other",
        "disturbances of them. Made by `make accuse`.",
        "",
        f"{made['cpu']}; cooploc {made['versions']['cooploc']}, numpy {made['versions']['numpy']}.",
        "",
        "| estimator | seeds | checks that ran | skipped | false accusations | seconds a seed |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name, reports in found.items():
        ran, skipped, failed = sum(r.ran for r in reports), *(sum(r.count(s) for r in reports) for s in _OTHER)
        each = seconds[name] / len(reports)
        lines.append(f"| `{name}` | {len(reports)} | {ran} | {skipped} | {failed} | {each:.1f} |")
    return "\n".join([*lines, "", *_accusations(found)]) + "\n"


_OTHER = ("skipped", "failed")


def _accusations(found: dict[str, list[Report]]) -> list[str]:
    told = [
        f"- `{name}`, seed {result.seed}, {result.check}: {result.detail}"
        for name, reports in found.items()
        for one in reports
        for result in one.results
        if result.status == "failed"
    ]
    return told or ["No estimator was accused."]


def main(out: str, seeds: int = SEEDS) -> int:
    """Check, write, and count the accusations."""
    found: dict[str, list[Report]] = {name: [] for name in BUILTIN}
    seconds: Counter[str] = Counter()
    for seed in range(seeds):
        for name, reports in found.items():
            began = time.perf_counter()
            reports.append(check_estimator(make(name), name, seed))
            seconds[name] += time.perf_counter() - began
        Path(out).write_text(report(found, seconds), encoding="utf-8")
        print(f"{seed + 1} of {seeds} seeds", file=sys.stderr, flush=True)
    return int(any(r.count("failed") for reports in found.values() for r in reports))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], *map(int, sys.argv[2:])))

"""What the one line of a certificate means: "passed: 16 checks", "failed: causality: why", "unchecked: why".

An empty line stands for a built-in estimator.
"""

import pandas as pd


def refused(line: str) -> bool:
    """Whether a certificate's line excludes an estimator from the ranking."""
    return line.startswith("failed")


def mark(line: str) -> str:
    """A certificate's line in a word or two: "✓ 16 checks", "✗ causality", "unchecked"."""
    status, _, found = line.partition(": ")
    return {"passed": f"✓ {found}", "failed": f"✗ {found.partition(':')[0]}"}.get(status, status)


def remarks(table: pd.DataFrame) -> list[str]:
    """A sentence on each estimator in a table of `compare` that did not pass its checks."""
    once = table.drop_duplicates("estimator")
    lines = zip(once["estimator"], once["certificate"], strict=True)
    return [_remark(name, line) for name, line in lines if line and not line.startswith("passed")]


def _remark(name: str, line: str) -> str:
    status, _, found = line.partition(": ")
    return f"{name} failed a check and is not ranked: {found}" if status == "failed" else f"{name} is {status}: {found}"

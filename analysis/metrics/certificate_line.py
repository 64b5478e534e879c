"""What the one line of a certificate means: "passed: 16 checks", "failed: causality: why", "unchecked: why".

An empty line stands for a built-in estimator.
"""

import pandas as pd


def refused(told: str) -> bool:
    """Whether a certificate's line keeps an estimator from being ranked."""
    return told.startswith("failed")


def mark(told: str) -> str:
    """A certificate's line in a word or two: "✓ 16 checks", "✗ causality", "unchecked"."""
    status, _, found = told.partition(": ")
    return {"passed": f"✓ {found}", "failed": f"✗ {found.partition(':')[0]}"}.get(status, status)


def remarks(table: pd.DataFrame) -> list[str]:
    """A sentence on everyone in a table of `compare` that did not pass."""
    once = table.drop_duplicates("estimator")
    told = zip(once["estimator"], once["certificate"], strict=True)
    return [_remark(name, found) for name, found in told if found and not found.startswith("passed")]


def _remark(name: str, told: str) -> str:
    status, _, found = told.partition(": ")
    return f"{name} failed a check and is not ranked: {found}" if status == "failed" else f"{name} is {status}: {found}"

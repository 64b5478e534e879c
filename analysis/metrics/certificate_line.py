"""What the one line of a certificate means.

"passed: 16 checks", "passed: 15 of 16 checks; axes: why", "failed: causality: why", "unchecked: why"; each may end with
"; trained on: what".

An empty line stands for a built-in estimator.
"""

import pandas as pd

DECLARED = "bytes are as declared"
TRAINED = "; trained on: "


def refused(line: str) -> bool:
    """Whether a certificate's line excludes an estimator from the ranking."""
    return line.startswith("failed")


def failed_check(line: str) -> str:
    """The name of the check that a refused estimator failed."""
    return line.partition(": ")[2].partition(":")[0]


def mark(line: str) -> str:
    """A certificate's line in a few words: "✓ 16 checks", "✓ 15 of 16 checks; axes", "✗ causality", "unchecked"."""
    line, _, learned = line.partition(TRAINED)
    status, _, found = line.partition(": ")
    count, *exempt = found.split("; ")
    passed = "; ".join([f"✓ {count}", *filter(None, (_brief(one) for one in exempt))])
    said = {"passed": passed, "failed": f"✗ {failed_check(line)}"}.get(status, status)
    return f"{said}; trained on {learned}" if learned else said


def remarks(table: pd.DataFrame) -> list[str]:
    """A sentence on each estimator in a table of `compare` that did not pass its checks."""
    once = table.drop_duplicates("estimator")
    lines = zip(once["estimator"], once["certificate"], strict=True)
    return [_remark(name, line) for name, line in lines if line and not _whole(line)]


def _whole(line: str) -> bool:
    """Whether every check passed without an exemption."""
    return line.startswith("passed") and "; " not in line


def _brief(exemption: str) -> str:
    """The name of what is exempt; of a team whose traffic the runner does not carry, what that means."""
    name, _, why = exemption.partition(": ")
    return DECLARED if why.endswith(DECLARED) else name if why else ""


def _remark(name: str, line: str) -> str:
    status, _, found = line.partition(": ")
    if status == "passed":
        return f"{name} passed {found}"
    return f"{name} failed a check and is not ranked: {found}" if status == "failed" else f"{name} is {status}: {found}"

"""What failed in a run, each different failure once."""

import pandas as pd

SHOWN = 10  # trials that are named


def failures(rows: pd.DataFrame) -> list[tuple[str, str]]:
    """Each different failure in a line with its trials, and where it was raised."""
    failed = rows[rows["failure"].notna()].drop_duplicates(["scenario", "estimator", "trial"])
    out = []
    for (scenario, estimator, failure), part in failed.groupby(["scenario", "estimator", "failure"], sort=False):
        trials = ", ".join(map(str, sorted(part["trial"])[:SHOWN])) + " ..." * (len(part) > SHOWN)
        out.append((f"{scenario}, {estimator}, trial {trials}: {failure}", str(part["traceback"].iloc[0])))
    return out

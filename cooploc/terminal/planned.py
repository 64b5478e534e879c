"""How many trials comparisons need, and how long they take: the table of `cl.plan`."""

import pandas as pd

from cooploc.analysis.formats import change, count, duration
from cooploc.analysis.metrics.sequential import PILOT, minutes
from cooploc.analysis.report.tables import Table, numbers, words
from cooploc.terminal.console import wide

COLUMNS = (
    words("scenario"),
    words("estimator"),
    words("vs", "baseline"),
    numbers("change", form=change),
    numbers("trials", form=count),
    numbers("until decided", "until_decided", form=count),
)


def show(found: pd.DataFrame, difference: float, jobs: int) -> None:
    """Print the trials of each comparison, and the time of all."""
    console = wide()
    console.print(Table("plan", "", COLUMNS, found.to_dict("records")).terminal())
    console.print(
        f"Trials that show a change of RMSE of {100 * difference:g} % in four of five runs (80 % power): with one look "
        "at the end, and with --until-decided, where a change twice as large needs a quarter. From a pilot of "
        f"{PILOT} trials, which knows them to about a factor of two."
    )
    fixed, until = (duration(60 * minutes(found, column, jobs)) for column in ("trials", "until_decided"))
    processes = f" on {jobs} processes" if jobs > 1 else ""
    console.print(f"here{processes}, estimators take about {fixed} with one look, and {until} until decided, at most")

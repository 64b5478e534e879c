"""How many trials a study needs, and how long they take here: `plan`, from a pilot of ten trials."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.execution.until_decided import trial_seconds
from cooploc.analysis.metrics.statistics import Interval
from cooploc.analysis.metrics.trials_needed import PILOT, trials_to_exclude, trials_until_decided
from cooploc.estimators.plugins.errors import BadInput
from cooploc.runs import run_study

DIFFERENCE = 0.1
COLUMNS = (*("scenario", "estimator", "baseline", "change", "trials", "until_decided", "seconds", "baseline_seconds"),)


def plan(
    study: str | Path,
    *,
    difference: float = DIFFERENCE,
    seed: int | None = None,
    estimators: str | Iterable[str] | None = None,
    jobs: int = 1,
    data: str | Path | None = None,
    out: str | Path | None = None,
    isolate: bool = True,
) -> pd.DataFrame:
    """How many trials each comparison with its baseline needs to show a difference in four of five runs (80 % power).

    Runs ten trials of the study, which its run directory keeps: a run of the study goes on from there. Ten trials know
    a spread to about a quarter, so the numbers of trials are right to about a factor of two.

    Columns:
        scenario, estimator, baseline: what is compared
        change: of RMSE, in the pilot
        trials: for one look, with the 95 % interval, to exclude a change of 0 where it is `difference`
        until_decided: the same with `cooploc run --until-decided`; a change that is twice as large needs a quarter
        seconds, baseline_seconds: computing time of one trial of each [s] on one process, without its stream;
            `analysis.metrics.trials_needed.minutes` adds them up

    Args:
        study: a shipped study, or the path of a study's TOML file.
        difference: the change of RMSE that is to be shown, such as 0.1 for 10 %.
        seed, estimators, jobs, data, out, isolate: as of `run_study`.

    Raises:
        BadInput: the study cannot be run as it stands, or the difference is not above 0.

    """
    if not difference > 0:
        raise BadInput(f"difference is {difference}; it must lie above 0, such as {DIFFERENCE} for 10 %")
    options: dict[str, Any] = {"seed": seed, "estimators": estimators, "jobs": jobs, "data": data, "out": out}
    pilot = run_study(study, trials=PILOT, isolate=isolate, **options)
    cost = trial_seconds(pilot.rows)
    others = pilot.table[pilot.table["estimator"] != pilot.table["baseline"]]
    return pd.DataFrame([_row(row, cost, difference) for row in others.to_dict("records")], columns=list(COLUMNS))


def _row(row: dict[Any, Any], cost: "pd.Series[float]", difference: float) -> dict[str, object]:
    log = Interval(*np.log1p([row["change"], row["change_low"], row["change_high"]]))
    distance = float(np.log1p(difference))
    named = {key: row[key] for key in ("scenario", "estimator", "baseline", "change")}
    return {
        **named,
        "trials": trials_to_exclude(log, row["pairs"], distance),
        "until_decided": trials_until_decided(log, row["pairs"], distance),
        "seconds": cost[row["scenario"], row["estimator"]],
        "baseline_seconds": cost[row["scenario"], row["baseline"]],
    }

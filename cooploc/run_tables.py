"""Tables made of a whole run: what readings are worth, and what results depend on."""

from pathlib import Path

import pandas as pd

from cooploc.analysis.metrics import information as matrix
from cooploc.analysis.metrics import sensitivity as sweeps
from cooploc.runs import Results, kept


def information(run: Results | str | Path) -> pd.DataFrame:
    """What readings are worth: own ones by those between robots, for every rule of fusion, with each cell's floor.

    `cooploc.analysis.metrics.information.information` says what the columns mean; `cl.plot.information` draws them. The
    study `information` runs all cells. The floors of ten robots take a minute or two.

    Args:
        run: from `run_study` or `load_run`, or a run directory.

    Raises:
        BadInput: the run cannot be read, or no estimator has a cell.

    """
    stored = kept(run)
    return matrix.information(stored.rows, stored.manifest["seed"])


def sensitivity(run: Results | str | Path, baseline: str = "arl") -> pd.DataFrame:
    """How errors depend on each parameter that a run sweeps, with the floor where it exists.

    `cooploc.analysis.metrics.sensitivity.sensitivity` says what the columns mean; `cl.plot.sensitivity` draws them. The
    study `sensitivity` is such a run. Its floors take a few minutes.

    Args:
        run: from `run_study` or `load_run`, or a run directory.
        baseline: the estimator that others are compared with.

    Raises:
        BadInput: the run cannot be read, sweeps nothing, or lacks the baseline.

    """
    stored = kept(run)
    return sweeps.sensitivity(stored.rows, stored.manifest["seed"], baseline)

"""What all tables, sentences and figures of a report are made from."""

from typing import NamedTuple

import pandas as pd

from cooploc.analysis.claims.trial_table import TrialTable
from cooploc.analysis.execution.stored_run import Kept
from cooploc.analysis.plot.style import Look
from cooploc.analysis.report.short_names import ShortNames


class Numbers(NamedTuple):
    """A run, its table and its trials, and how its estimators are drawn and written."""

    kept: Kept
    table: pd.DataFrame  # of `compare`
    results: TrialTable
    looks: dict[str, Look]
    names: ShortNames

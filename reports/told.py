"""Numbers of a run as words of a text, each with its 95 % interval, by the functions that make the tables."""

from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

import cooploc as cl
from cooploc.analysis.formats import Format, count, interval, metres, percent, ratio
from cooploc.analysis.formats import change as signed
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.compare import summarize
from cooploc.analysis.metrics.pooling import trial_means
from cooploc.estimators import nearest
from cooploc.estimators.plugins.errors import BadInput
from cooploc.runs import Results, kept


class Number(NamedTuple):
    """A number, its 95 % interval, and how both are written."""

    value: float
    low: float
    high: float
    form: Format = signed
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.alone} ({self.ends})" if self.ends else self.alone

    @property
    def inside(self) -> str:
        """With its interval, for use in brackets."""
        return f"{self.alone}, {self.ends}" if self.ends else self.alone

    @property
    def ends(self) -> str:
        """Of its interval; nothing where there is none."""
        return interval(lambda end: self.form(end).removesuffix(" %"))(self.low, self.high)

    @property
    def alone(self) -> str:
        """Without its interval."""
        return f"{self.form(self.value)}{self.unit}"

    @property
    def falls(self) -> bool:
        """Whether the whole interval of a change lies below nothing."""
        return self.high < 0

    @property
    def rises(self) -> bool:
        """Whether the whole interval of a change lies above nothing."""
        return self.low > 0

    @property
    def open(self) -> bool:
        """Whether a change could be either."""
        return not self.falls and not self.rises


class Told:
    """What a run found, by estimator and scenario.

    Args:
        run: a run directory.

    Raises:
        BadInput: there is no such run; of a number, that the run has no such scenario or estimator.

    """

    def __init__(self, run: str | Path) -> None:
        self.results: Results = cl.load_run(run)

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row per scenario and estimator, as of `summarize`."""
        return summarize(self.results.rows).set_index(["scenario", "estimator"])

    @cached_property
    def seed(self) -> int:
        """The run's seed."""
        return int(kept(self.results).manifest["seed"])

    @property
    def trials(self) -> str:
        """Trials per scenario and estimator: "100", or "10 to 640" of a run until decided."""
        fewest, most = self.table["trials"].min(), self.table["trials"].max()
        return f"{most:,}" if fewest == most else f"{fewest:,} to {most:,}"

    @property
    def scenarios(self) -> list[str]:
        """Labels of scenarios, in the study's order."""
        return list(dict.fromkeys(self.table.index.get_level_values("scenario")))

    @property
    def estimators(self) -> list[str]:
        """Labels of estimators, in the study's order."""
        return list(dict.fromkeys(self.table.index.get_level_values("estimator")))

    def has(self, estimator: str, scenario: str) -> bool:
        """Whether the two were run together."""
        return (scenario, estimator) in self.table.index

    def rmse(self, estimator: str, scenario: str) -> Number:
        """Position RMSE [m]."""
        return self._named("rmse", estimator, scenario, metres, " m")

    def anees(self, estimator: str, scenario: str) -> Number:
        """Position NEES / 2; 1 is consistent."""
        return self._named("anees", estimator, scenario, ratio)

    def coverage(self, estimator: str, scenario: str) -> Number:
        """Share of true positions inside the 95 % ellipse."""
        return self._named("coverage95", estimator, scenario, percent)

    def diverged(self, estimator: str, scenario: str) -> Number:
        """Share of robots, over trials, that diverged, as of `summarize`."""
        return self._named("diverged", estimator, scenario, percent)

    def bytes(self, estimator: str, scenario: str) -> str:
        """Bytes sent per robot and tick."""
        return count(self._row(estimator, scenario)["bytes"])

    def change(self, of: str, than: str, scenario: str) -> Number:
        """By how much the RMSE of one estimator differs from that of another on the same streams (Fieller)."""
        return self._from_to((scenario, than), (scenario, of))

    def trend(self, of: str, first: str, later: str) -> Number:
        """By how much an estimator's RMSE changes from one scenario to another, trials paired by their number."""
        return self._from_to((first, of), (later, of))

    def _from_to(self, before: tuple[str, str], after: tuple[str, str]) -> Number:
        for scenario, estimator in (before, after):
            self._row(estimator, scenario)
        both = pd.concat([self._cells[one]["mse"] for one in (before, after)], axis=1, join="inner").dropna()
        return Number(*statistics.change(*both.to_numpy(float).T))

    @cached_property
    def _cells(self) -> dict[tuple[str, str], pd.DataFrame]:
        return trial_means(self.results.rows)

    def _row(self, estimator: str, scenario: str) -> pd.Series:
        if scenario not in self.scenarios:
            raise BadInput(f"{self.results.folder}: no scenario {scenario!r}; {nearest(scenario, self.scenarios)}")
        if not self.has(estimator, scenario):
            known = list(self.table.loc[scenario].index)
            raise BadInput(f"{self.results.folder}: no {estimator!r} in {scenario!r}; {nearest(estimator, known)}")
        return self.table.loc[(scenario, estimator)]

    def _named(self, column: str, estimator: str, scenario: str, form: Format, unit: str = "") -> Number:
        row = self._row(estimator, scenario)
        low, high = (row.get(f"{column}_{end}", np.nan) for end in ("low", "high"))
        return Number(row[column], low, high, form, unit)

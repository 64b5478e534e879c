"""Numbers of a run as words of a text, each with its 95 % interval, by the functions that make the tables."""

from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import cooploc as cl
from cooploc.analysis.execution.stored_run import read
from cooploc.analysis.formats import Format, count, interval, metres, percent, ratio
from cooploc.analysis.formats import change as signed
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.compare import summarize
from cooploc.analysis.metrics.consistency import consistency
from cooploc.analysis.metrics.errors import trial_means
from cooploc.analysis.report.csv_text import read_csv_text
from cooploc.estimators import nearest
from cooploc.estimators.plugins.errors import BadInput

Cell = tuple[str, str]  # labels of a scenario and an estimator


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
        self.stored = read(Path(run))
        self._of = dict(list(self.stored.rows.groupby(["scenario", "estimator"], sort=False)))
        self._trials: dict[Cell, pd.DataFrame] = {}

    @property
    def seed(self) -> int:
        """The run's seed."""
        return int(self.stored.manifest["seed"])

    @property
    def trials(self) -> str:
        """Trials per scenario and estimator: "100", or "10 to 640" of a run until decided."""
        numbers = [rows["trial"].nunique() for rows in self._of.values()]
        return f"{max(numbers):,}" if min(numbers) == max(numbers) else f"{min(numbers):,} to {max(numbers):,}"

    @property
    def looks(self) -> list[int]:
        """Numbers of trials after which a run until decided looked; of another run, that of all its trials."""
        return list(self.stored.looks) or [max(rows["trial"].nunique() for rows in self._of.values())]

    @property
    def scenarios(self) -> list[str]:
        """Labels of scenarios, in the study's order."""
        return list(dict.fromkeys(scenario for scenario, _ in self._of))

    @property
    def estimators(self) -> list[str]:
        """Labels of estimators, in the study's order."""
        return list(dict.fromkeys(estimator for _, estimator in self._of))

    def has(self, estimator: str, scenario: str) -> bool:
        """Whether the two were run together."""
        return (scenario, estimator) in self._of

    def rmse(self, estimator: str, scenario: str) -> Number:
        """Position RMSE [m]."""
        return self._named("rmse", estimator, scenario, metres, " m")

    def anees(self, estimator: str, scenario: str) -> Number:
        """Position NEES / 2; 1 is consistent."""
        return self._named("anees", estimator, scenario, ratio)

    def coverage(self, estimator: str, scenario: str) -> Number:
        """Share of true positions inside the 95 % ellipse."""
        return self._named("coverage95", estimator, scenario, percent)

    def over_confident(self, estimators: Iterable[str], scenarios: Iterable[str]) -> int:
        """In how many cells of these the covariance is too small, by the interval of ANEES or of coverage."""
        cells = [self._row(name, label) for name, label in product(estimators, scenarios)]
        return int((consistency(pd.DataFrame(cells)) == "over-confident").sum())

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

    def _from_to(self, before: Cell, after: Cell) -> Number:
        both = pd.concat([self._means(*one)["mse"] for one in (before, after)], axis=1, join="inner").dropna()
        return Number(*statistics.change(*both.to_numpy(float).T))

    def _means(self, scenario: str, estimator: str) -> pd.DataFrame:
        """Of every trial."""
        cell = scenario, estimator
        if cell not in self._trials:
            self._trials[cell] = trial_means(self._rows(estimator, scenario))[cell]
        return self._trials[cell]

    def _rows(self, estimator: str, scenario: str) -> pd.DataFrame:
        folder = self.stored.folder
        if scenario not in self.scenarios:
            raise BadInput(f"{folder}: no scenario {scenario!r}; {nearest(scenario, self.scenarios)}")
        if not self.has(estimator, scenario):
            known = [name for label, name in self._of if label == scenario]
            raise BadInput(f"{folder}: no {estimator!r} in {scenario!r}; {nearest(estimator, known)}")
        return self._of[scenario, estimator]

    def _row(self, estimator: str, scenario: str) -> pd.Series:
        return summarize(self._rows(estimator, scenario)).iloc[0]

    def _named(self, column: str, estimator: str, scenario: str, form: Format, unit: str = "") -> Number:
        row = self._row(estimator, scenario)
        low, high = (row.get(f"{column}_{end}", np.nan) for end in ("low", "high"))
        return Number(row[column], low, high, form, unit)


def claims() -> dict[str, dict[str, Any]]:
    """Of every claim of the paper: how many specifications there are, and how many of them have each verdict."""
    path = Path(__file__).parent / "readings" / "map.csv"
    if not path.exists():
        raise BadInput(f"{path} is not there; python reports/readings.py RUN_DIR writes it")
    table = pd.read_csv(path, dtype={"claim": str})
    return {row["claim"]: row for row in table.to_dict("records")}


def in_letter(claim: str, scenario: str, **instead: str) -> Number:
    """What a claim comes to in the reading nearest to the paper's letter, with other choices in some dimensions.

    Args:
        claim: its number in the ledger.
        scenario: one of its scenarios.
        instead: choices by dimension, with "_" for a space: `direction_error="one angle, wrapped"`.

    """
    path = Path(__file__).parent / "readings" / "readings.csv"
    table = pd.read_csv(path, dtype={"claim": str})
    dimensions = list(table)[list(table).index("preset") + 1 :]
    table[dimensions] = table[dimensions].astype("object").fillna("")  # where a dimension does not bear on the claim
    of_claim = table[(table["claim"] == claim) & (table["scenario"] == scenario) & (table["definition"] == "change")]
    letter = of_claim[of_claim["letter"].astype(bool)]
    if letter.empty:
        raise BadInput(f"{path}: claim {claim} has no {scenario!r} in the reading nearest to the letter")
    wanted = {**letter.iloc[0][dimensions], **{name.replace("_", " "): choice for name, choice in instead.items()}}
    found = of_claim[(of_claim[dimensions] == pd.Series(wanted)).all(axis=1)]
    if found.empty:
        raise BadInput(f"{path}: claim {claim} in {scenario!r} was not run with {instead}")
    return Number(*found.iloc[0][["value", "low", "high"]].astype(float))


def verdicts_then_and_now() -> list[dict[str, str]]:
    """Of every claim whose verdict in the preset the first study gave otherwise: `claim`, `says`, `then`, `now`.

    Then and now are a verdict and what was found; the first study's are in reports/text/first-study.csv.
    """
    folder = Path(__file__).parent
    then = pd.read_csv(folder / "text" / "first-study.csv", index_col="claim", keep_default_na=False)
    table = read_csv_text((folder / "paper" / "tables" / "verdicts.csv").read_text("utf-8")).set_index("claim")
    return [
        {
            "claim": str(claim),
            "says": now["says"],
            "then": ": ".join(filter(None, then.loc[claim, ["verdict", "found"]])),
            "now": f"{now['paper']}: {now['found']}",
        }
        for claim, now in table.iterrows()
        if claim in then.index and now["paper"] != then.loc[claim, "verdict"]
    ]


def order_when_tuned(run: str | Path) -> dict[str, Any]:
    """Of a tuned study: estimators, pairs of them in a scenario, and how many are significantly reversed by RMSE.

    `at_most` is the upper end of Wilson's 95 % interval for their share.
    """
    found = cl.load_tuned(run)
    pairs = found.order("rmse")
    turned = (pairs["became"] == "reversed").to_numpy(float)
    most = percent(statistics.share(turned).high)  # as if pairs were independent
    return {"estimators": len(found.tuned), "pairs": len(pairs), "reversed": int(turned.sum()), "at_most": most}

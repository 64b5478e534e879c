"""Numbers of a run as words of a text, each with its 95 % interval, by the functions that make the tables."""

from collections.abc import Iterable
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import cooploc as cl
from cooploc.analysis.claims import verdicts
from cooploc.analysis.claims.ledger import BASE, load
from cooploc.analysis.claims.verdicts import DECIDED, judge
from cooploc.analysis.execution import run_directory
from cooploc.analysis.formats import Format, count, interval, metres, percent, ratio
from cooploc.analysis.formats import change as signed
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.compare import summarize
from cooploc.analysis.metrics.consistency import consistency
from cooploc.analysis.metrics.errors import trial_means
from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput

REPORTS = Path(__file__).resolve().parent
USUAL = 100  # trials of a study as shipped
read_run = cache(run_directory.read_run)  # a page asks for a run of nine thousand files three times


class Number(NamedTuple):
    """A number, its 95 % interval, and how both are written."""

    value: float
    low: float
    high: float
    form: Format = signed
    unit: str = ""
    instead: str = ""  # what is written in place of a change that one trial decides

    def __str__(self) -> str:
        return self.instead or (f"{self.alone} ({self.ends})" if self.ends else self.alone)

    @property
    def inside(self) -> str:
        """Return the number with its interval, for use in brackets."""
        return f"{self.alone}, {self.ends}" if self.ends else self.alone

    @property
    def ends(self) -> str:
        """Return the ends of its interval; nothing where there is none."""
        return interval(lambda end: self.form(end).removesuffix(" %"))(self.low, self.high)

    @property
    def alone(self) -> str:
        """Return the number without its interval."""
        return f"{self.form(self.value)}{self.unit}"

    @property
    def falls(self) -> bool:
        """Whether the whole interval of a change lies below 0."""
        return self.high < 0

    @property
    def rises(self) -> bool:
        """Whether the whole interval of a change lies above 0."""
        return self.low > 0

    @property
    def open(self) -> bool:
        """Whether the interval of a change holds 0."""
        return not self.falls and not self.rises


class StudyRun:
    """A run directory, whose numbers are asked for by estimator and scenario."""

    def __init__(self, run: str | Path) -> None:
        self.stored = read_run(Path(run))
        self.seed = int(self.stored.manifest["seed"])
        self._of = dict(list(self.stored.rows.groupby(["scenario", "estimator"], sort=False)))
        self.scenarios = list(dict.fromkeys(scenario for scenario, _ in self._of))  # in the study's order
        self.estimators = list(dict.fromkeys(estimator for _, estimator in self._of))

    @property
    def trials(self) -> str:
        """Return the trials of a scenario and estimator: "100", or "10 to 640" of a run until decided."""
        numbers = [rows["trial"].nunique() for rows in self._of.values()]
        return f"{max(numbers):,}" if min(numbers) == max(numbers) else f"{min(numbers):,} to {max(numbers):,}"

    def has(self, estimator: str, scenario: str) -> bool:
        """Whether the two were run together."""
        return (scenario, estimator) in self._of

    def rmse(self, estimator: str, scenario: str) -> Number:
        """Return the position RMSE [m]."""
        return self._number("rmse", estimator, scenario, metres, " m")

    def anees(self, estimator: str, scenario: str) -> Number:
        """Return position NEES / 2; 1 is consistent."""
        return self._number("anees", estimator, scenario, ratio)

    def coverage(self, estimator: str, scenario: str) -> Number:
        """Return the share of true positions inside the 95 % ellipse."""
        return self._number("coverage95", estimator, scenario, percent)

    def diverged(self, estimator: str, scenario: str) -> Number:
        """Return the share of robots, over trials, that diverged, as of `summarize`."""
        return self._number("diverged", estimator, scenario, percent)

    def over_confident(self, estimators: Iterable[str], scenarios: Iterable[str]) -> int:
        """Return in how many cells of these the covariance is too small, by the interval of ANEES or of coverage."""
        cells = pd.DataFrame([self._row(*cell) for cell in product(estimators, scenarios)])
        return int((consistency(cells) == "over-confident").sum())

    def bytes(self, estimator: str, scenario: str) -> str:
        """Return the bytes sent per robot and tick."""
        return count(self._row(estimator, scenario)["bytes"])

    def change(self, of: str, than: str, scenario: str) -> Number:
        """Return by how much the RMSE of one estimator differs from another's on the same streams."""
        return self._from_to((scenario, than), (scenario, of))

    def trend(self, of: str, first: str, later: str) -> Number:
        """Return by how much an estimator's RMSE changes between scenarios, trials paired by their number."""
        return self._from_to((first, of), (later, of))

    def _from_to(self, before: tuple[str, str], after: tuple[str, str]) -> Number:
        means = [trial_means(self._rows(estimator, label))[label, estimator] for label, estimator in (before, after)]
        both = pd.concat([one["mse"] for one in means], axis=1, join="inner").dropna()
        a, b = both.to_numpy(float).T
        decisive = statistics.decisive_trial(a, b)
        trial = "" if decisive is None else f"not comparable: trial {both.index[decisive]} decides"
        return Number(*statistics.FIXED.change(a, b), instead=trial)

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

    def _number(self, column: str, estimator: str, scenario: str, form: Format, unit: str = "") -> Number:
        row = self._row(estimator, scenario)
        return Number(row[column], *(row.get(f"{column}_{end}", np.nan) for end in ("low", "high")), form, unit)


def decided_by_more_trials(run: str | Path) -> dict[str, int | str]:
    """Return how many of the cases `open` after the usual trials a run until decided settles (`settled`).

    `share` is of the trials of a run that gives every scenario and estimator as many as its last look has. `more`: how
    many of the other cases one look at all of its trials would settle.
    """
    stored, ledger = read_run(Path(run)), load()
    rows, decisions = stored.rows, stored.decisions or {}
    asked = [n for cell in stored.manifest["cells"].values() for n in cell["estimators"].values()]
    lasting = verdicts.drop_timed(ledger, verdicts.judge_run(ledger, rows, stored.looks))
    usual, all_ = (judge(ledger, rows[rows["trial"] < n])["verdict"].reindex(lasting.index) for n in (USUAL, 10**9))
    settled = lasting["verdict"].isin(DECIDED)
    late = (usual == "undecided") & ~(settled & (lasting["look"] < USUAL))  # not settled before
    compared = [one["verdict"] != "open" for one in decisions["comparison"]]
    return {
        "share": percent(sum(asked) / len(asked) / decisions["look"]),
        "comparisons": f"{sum(compared)} of {len(compared)}",
        "claims": f"{int(settled.sum())} of {len(settled)}",
        "open": int(late.sum()),
        "settled": int((late & settled).sum()),
        "more": int((late & ~settled & all_.isin(DECIDED)).sum()),
    }


def order_when_tuned(run: str | Path) -> dict[str, Any]:
    """Return the estimators of a tuned study, pairs of them in a scenario, and how many are reversed by RMSE.

    `at_most` is the upper end of Wilson's 95 % interval for their share, as if pairs were independent.
    """
    found = cl.load_tuned(run)
    pairs = found.order("rmse")
    turned = (pairs["became"] == "reversed").to_numpy(float)
    most = percent(statistics.share(turned).high)
    return {"estimators": len(found.tuned), "pairs": len(pairs), "reversed": int(turned.sum()), "at_most": most}


def claims() -> dict[str, dict[str, Any]]:
    """Return of every claim of the paper how many specifications there are, and how many have each verdict."""
    rows = pd.read_csv(REPORTS / "readings/map.csv", dtype={"claim": str})
    return {row["claim"]: row for row in rows.to_dict("records")}


def preset_verdicts(run: str | Path) -> dict[str, tuple[str, str]]:
    """Return what every claim says, and the verdict on it in the preset, by a run of the study `paper`."""
    ledger = load()
    found = verdicts.overview(judge(ledger, read_run(Path(run)).rows))[BASE]
    return {claim.id: (claim.says, found[claim.id]) for claim in ledger.claims}


def in_letter(claim: str, scenario: str, **instead: str) -> Number:
    """Return what a claim comes to in a scenario, in the reading nearest to the paper's letter.

    `instead` has other choices by dimension, with "_" for a space: `direction_error="one angle, wrapped"`.
    """
    return in_reading("letter", claim, scenario, **instead)[0]


def in_reading(end: str, claim: str, scenario: str, **instead: str) -> tuple[Number, dict[str, str]]:
    """Return what a claim comes to in the reading `letter`, `code` or `preset`, and the errors it is made of [m].

    These are of the estimator (`error`), of the one compared with (`baseline`) and `dead_reckoning`.
    """
    table = pd.read_csv(REPORTS / "readings" / "readings.csv", dtype={"claim": str})
    dimensions = list(table)[list(table).index("implausible") + 1 :]
    table[dimensions] = table[dimensions].astype("object").fillna("")  # where a dimension does not bear on the claim
    of_claim = table[(table["claim"] == claim) & (table["scenario"] == scenario) & (table["definition"] == "change")]
    named = of_claim[of_claim[end].astype(bool)].iloc[0][dimensions]
    wanted = {**named, **{name.replace("_", " "): choice for name, choice in instead.items()}}
    found = of_claim[(of_claim[dimensions] == pd.Series(wanted)).all(axis=1)].iloc[0]
    levels = {name: f"{found[name]:.2f}" for name in ("error", "baseline", "dead_reckoning")}
    return Number(*found[["value", "low", "high"]].astype(float)), levels


def measured(what: str, decimals: int | None = None, page: str = "speed.md") -> str:
    """Return of a line of a page its first number and range, or the number alone with so many decimals."""
    for line in (REPORTS / page).read_text(encoding="utf-8").splitlines():
        if line.startswith(f"| {what} | "):
            number, *spread = line.removeprefix(f"| {what} | ").strip(" |").split(" | ")
            ranged = f"{number} ({spread[0]})" if spread else number
            return ranged if decimals is None else f"{float(number):.{decimals}f}"
    raise BadInput(f"reports/{page} has no line {what!r}; make bench writes reports/speed.md")

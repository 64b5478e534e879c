"""What the page and the paper of a run are both made from: its table and trials, its looks, and short labels."""

import string
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import pandas as pd

from cooploc.analysis.claims.trial_table import TrialTable, collect
from cooploc.analysis.execution.run_directory import StoredRun
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.curves import sweep
from cooploc.analysis.metrics.ranking import is_refused, rank_groups
from cooploc.analysis.metrics.sequential import ANYTIME, FIXED, with_decisions
from cooploc.analysis.plot import style

SWEEP = 3  # values from which a sweep becomes a line
LONGEST = 24  # characters of a label that is written in full


class Labels(NamedTuple):
    """What estimators are called in figures and tables."""

    short: dict[str, str]  # by the estimator's full label
    settings: dict[str, str]  # what a letter stands for

    def of(self, label: str) -> str:
        """Return the short label, or the label itself."""
        return self.short.get(label, label)

    def legend(self, labels: Iterable[str]) -> list[str]:
        """Return the letters in these estimators' labels, each with what it stands for."""
        used = {self.of(label).rpartition(" [")[2].removesuffix("]") for label in labels if self.of(label) != label}
        return [f"[{letter}] {settings}" for letter, settings in self.settings.items() if letter in used]


def short_labels(labels: Iterable[str], variants: Mapping[str, str] | None = None) -> Labels:
    """Return a short label for each long one: "ekf-local[anchor_reading=rssi]" becomes "ekf-local [a]".

    Equal settings have equal letters. A configuration that the study names has that name: "ekf-local [raw]".

    Args:
        labels: of estimators, in full.
        variants: the study's name of a configuration -> its parameters.

    """
    names = {_sorted(parameters): name for name, parameters in (variants or {}).items()}
    letters: dict[str, str] = {}
    short: dict[str, str] = {}
    for label in dict.fromkeys(labels):
        method, _, settings = label.removesuffix("]").partition("[")
        method = method.rpartition("/")[2]  # of an estimator in a file, without its folder
        if len(method) > LONGEST:
            method, settings = method[: LONGEST - 1] + "…", ",".join(filter(None, (method, settings)))
        if not settings or len(label) <= LONGEST:
            short[label] = method if not settings else label
            continue
        key = settings.replace(",", ", ")
        letter = letters.setdefault(key, names.get(_sorted(settings)) or _letter(len(letters)))
        short[label] = f"{method} [{letter}]"
    return Labels(short, {letter: settings for settings, letter in letters.items()})


def _sorted(parameters: str) -> tuple[str, ...]:
    """Parameters in an order that does not depend on how they were written."""
    return tuple(sorted(part.strip() for part in parameters.split(",")))


def _letter(number: int) -> str:
    """a to z, and then a1 to z1, and so on."""
    again, place = divmod(number, 26)
    return string.ascii_lowercase[place] + (str(again) if again else "")


class Numbers(NamedTuple):
    """A run, its table and its trials, and how its estimators are drawn and written."""

    kept: StoredRun
    table: pd.DataFrame  # of `compare`
    results: TrialTable
    looks: dict[str, style.Look]
    names: Labels


def numbers_of(kept: StoredRun) -> Numbers:
    """Return the run's table and trials, and how its estimators are drawn and written."""
    table = compare(kept.rows, kept.baselines, full=True)
    table = table if kept.comparisons is None else with_decisions(table, kept.comparisons)
    estimators = [str(name) for name in kept.rows["estimator"].unique()]
    names = short_labels(estimators, kept.manifest["study"].get("variants", {}))
    return Numbers(kept, table, collect(kept.rows, ANYTIME if kept.looks else FIXED), style.looks(estimators), names)


def rows_of_experiment(table: pd.DataFrame, plan: Mapping[str, list[str]]) -> pd.DataFrame:
    """Return the rows of an experiment: `plan` has its estimators by scenario."""
    labels = zip(table["scenario"], table["estimator"], strict=True)
    return table[[estimator in plan.get(scenario, ()) for scenario, estimator in labels]]


def ranked(rows: pd.DataFrame, results: TrialTable) -> tuple[dict[str, float], dict[str, str]]:
    """Return mean ranks (of a fixed number of trials) and letters of one scenario's estimators that failed nowhere.

    One that failed would take its trials from all others, and change their ranks and letters. What is offline is not
    ranked with filters.
    """
    ended = rows["rmse"].notna() & (rows["failed"] == 0) & ~rows["offline"]
    names = list(rows.loc[ended & ~rows["certificate"].map(is_refused).astype(bool), "estimator"])
    if not names:
        return {}, {}
    mse = results.errors(rows["scenario"].iloc[0], names)
    return rank_groups(mse.dropna() if results.stopping is FIXED else mse, results.stopping)


def group_by_sweep(labels: list[str]) -> dict[tuple[str, str], list[str]]:
    """Return scenarios by family and what they sweep; short sweeps are with those that sweep nothing."""
    found: dict[tuple[str, str], list[str]] = {}
    for label in labels:
        found.setdefault(sweep(label)[:2], []).append(label)
    out: dict[tuple[str, str], list[str]] = {}
    for label in labels:
        which = sweep(label)[:2]
        out.setdefault(which if which[1] and len(found[which]) >= SWEEP else ("", ""), []).append(label)
    return out

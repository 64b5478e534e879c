"""Numbers and labels of a run, from which its page and its paper are made."""

import string
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.claims.trial_table import TrialTable, collect
from cooploc.analysis.execution.run_directory import StoredRun
from cooploc.analysis.formats import count_of
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.curves import sweep
from cooploc.analysis.metrics.ranking import is_refused, rank_groups
from cooploc.analysis.metrics.sequential import ANYTIME, add_decisions
from cooploc.analysis.metrics.statistics import FIXED
from cooploc.analysis.plot import style
from cooploc.estimators.registry import shorten_labels

SWEEP = 3  # values from which a sweep becomes a line
LONGEST = 24  # characters of a label that is written in full
FLOORED = 20  # robots: the floor of larger teams takes seconds for each scenario


class Labels(NamedTuple):
    """Names of estimators in figures and tables."""

    short: dict[str, str]  # by the estimator's full label
    settings: dict[str, str]  # letter -> parameters that it stands for

    def shorten(self, label: str) -> str:
        """Return the short label, or the label itself."""
        return self.short.get(label, shorten_labels(label))

    def legend(self, labels: Iterable[str]) -> list[str]:
        """Return the letters in these estimators' labels, each with the parameters that it stands for."""
        named = [(label, self.shorten(label)) for label in labels]
        used = {short.rpartition(" [")[2].removesuffix("]") for label, short in named if short != label}
        return [f"[{letter}] {settings}" for letter, settings in self.settings.items() if letter in used]


def short_labels(labels: Iterable[str], variants: Mapping[str, str] | None = None) -> Labels:
    """Return a short label for each long one: "ekf-local[anchor_reading=rssi]" becomes "ekf-local [a]".

    Equal settings have equal letters. `variants` has names that the study gives to parameters: "ekf-local [raw]".
    """

    def sort_parameters(parameters: str) -> tuple[str, ...]:
        return tuple(sorted(part.strip() for part in parameters.split(",")))

    names = {sort_parameters(parameters): name for name, parameters in (variants or {}).items()}
    letters: dict[str, str] = {}
    short: dict[str, str] = {}
    for label in dict.fromkeys(labels):
        shown = shorten_labels(label)
        method, _, settings = shown.removesuffix("]").partition("[")
        method = method.rpartition("/")[2]  # of an estimator in a file, without its folder
        if len(method) > LONGEST:
            method, settings = method[: LONGEST - 1] + "…", ",".join(filter(None, (method, settings)))
        if not settings or len(shown) <= LONGEST:
            short[label] = method if not settings else shown
            continue
        again, place = divmod(len(letters), 26)
        letter = names.get(sort_parameters(settings)) or string.ascii_lowercase[place] + (str(again) if again else "")
        short[label] = f"{method} [{letters.setdefault(settings.replace(',', ', '), letter)}]"
    return Labels(short, {letter: settings for settings, letter in letters.items()})


class Numbers(NamedTuple):
    """A run, its table and its trials, and how its estimators are drawn and written."""

    kept: StoredRun
    table: pd.DataFrame  # of `compare`
    results: TrialTable
    pens: dict[str, style.Pen]
    names: Labels


def numbers_of(kept: StoredRun) -> Numbers:
    """Return the run's table and trials, and how its estimators are drawn and written."""
    table = compare(kept.rows, kept.baselines, full=True)
    table = table if kept.comparisons is None else add_decisions(table, kept.comparisons)
    estimators = [str(name) for name in kept.rows["estimator"].unique()]
    study = kept.manifest["study"]
    variants = {key: text for one in (*study.get("also", ()), study) for key, text in one.get("variants", {}).items()}
    names = short_labels(estimators, variants)
    return Numbers(kept, table, collect(kept.rows, ANYTIME if kept.looks else FIXED), style.pens(estimators), names)


def rows_of_experiment(table: pd.DataFrame, plan: Mapping[str, list[str]]) -> pd.DataFrame:
    """Return the rows of an experiment: `plan` has its estimators by scenario."""
    labels = zip(table["scenario"], table["estimator"], strict=True)
    return table[[estimator in plan.get(scenario, ()) for scenario, estimator in labels]]


def rank_scenario(rows: pd.DataFrame, results: TrialTable) -> tuple[dict[str, float], dict[str, str]]:
    """Return mean ranks (of a fixed number of trials) and letters of one scenario's estimators that failed nowhere.

    One that failed would take its trials from all others, and change their ranks and letters. Offline estimators are
    not ranked with filters.
    """
    names = list(rows.loc[may_be_ranked(rows), "estimator"])
    if not names:
        return {}, {}
    mse = results.errors(rows["scenario"].iloc[0], names)
    return rank_groups(mse.dropna() if results.stopping is FIXED else mse, results.stopping)


def may_be_ranked(rows: pd.DataFrame) -> "pd.Series[bool]":
    """Return which rows of `compare` failed nowhere, no check either, and did not see later readings."""
    ended = rows["rmse"].notna() & (rows["failed"] == 0) & ~rows["offline"]
    return ended & ~rows["certificate"].map(is_refused).astype(bool)


def group_by_sweep(labels: list[str]) -> dict[tuple[str, str], list[str]]:
    """Return scenarios by family and swept parameter; short sweeps are with those that sweep nothing."""
    found: dict[tuple[str, str], list[str]] = {}
    for label in labels:
        found.setdefault(sweep(label)[:2], []).append(label)
    out: dict[tuple[str, str], list[str]] = {}
    for label in labels:
        which = sweep(label)[:2]
        out.setdefault(which if which[1] and len(found[which]) >= SWEEP else ("", ""), []).append(label)
    return out


def first_middle_last(labels: list[str]) -> list[str]:
    """Return the first, the middle and the last of many labels, or all of at most three."""
    return labels if len(labels) <= 3 else [labels[0], labels[len(labels) // 2], labels[-1]]


def trial_counts(part: pd.DataFrame) -> str:
    """Return how many trials a scenario has."""
    counts = np.unique(part["trials"])
    if not len(counts):
        return "No trials"
    return f"{count_of(counts[0], 'trial') if len(counts) == 1 else f'{counts[0]} to {counts[-1]} trials'} a scenario"

"""What a page says in words: each estimator's introduction, the methods, and how to cite."""

from collections.abc import Iterable
from dataclasses import fields
from typing import Any, NamedTuple

import pandas as pd

from cooploc.analysis.formats import counted
from cooploc.analysis.metrics.compare import FAR
from cooploc.analysis.metrics.consistency import OVER_CONFIDENT
from cooploc.analysis.metrics.errors import SENSES
from cooploc.analysis.report import page_figures
from cooploc.analysis.report.result_columns import STOPPED
from cooploc.analysis.report.run_numbers import Numbers
from cooploc.estimators import configure, make
from cooploc.estimators.errors import BadInput
from cooploc.estimators.listing import standing
from cooploc.estimators.registry import source_of


class Configuration(NamedTuple):
    """One configuration of a method, as it ran."""

    label: str
    anchor: str
    given: str  # the parameters in which it differs from the defaults
    standing: str  # "as published", "at its best", or nothing


class Introduction(NamedTuple):
    """A method with the configurations of it that ran."""

    name: str
    about: str
    senses: str  # what it read beside odometry, in any scenario
    knows: str  # whose readings it has
    source: str
    defaults: list[tuple[str, str]]  # every parameter with its default
    configurations: list[Configuration]


def anchors_of(estimators: Iterable[Any]) -> dict[str, str]:
    """Return where each estimator is introduced."""
    return {str(label): f"estimator-{i}" for i, label in enumerate(estimators, 1)}


def introduce_estimators(rows: pd.DataFrame) -> list[Introduction]:
    """Return an introduction of each method, in the order in which they ran; no code that is not built in runs."""
    methods: dict[str, list[Configuration]] = {}
    for label, anchor in anchors_of(rows["estimator"].unique()).items():
        method, _, given = label.partition("[")
        configuration = Configuration(label, anchor, given.removesuffix("]").replace(",", ", "), standing(label))
        methods.setdefault(method, []).append(configuration)
    return [_introduce(name, ones, rows) for name, ones in methods.items()]


def _introduce(name: str, configurations: list[Configuration], rows: pd.DataFrame) -> Introduction:
    rows = rows[rows["estimator"].isin([one.label for one in configurations])]
    made = _built_in(name)
    senses = " or ".join(rows[SENSES].dropna().unique()) if SENSES in rows else ""
    if made is None:
        return Introduction(name, "Not built in.", senses, _knows(rows), "", [], configurations)
    about = (type(made).__doc__ or "").strip().partition("\n")[0]
    defaults = [(one.name, getattr(made, one.name)) for one in fields(made) if one.init and one.name != "uses"]
    plain = [(key, f"{v:g}".replace("inf", "∞") if isinstance(v, float) else str(v)) for key, v in defaults]
    return Introduction(name, about, senses, _knows(rows), source_of(type(made)), plain, configurations)


def _built_in(name: str) -> Any:
    """Return the estimator of a method, or None where it is not built in or no longer known."""
    try:
        return make(name) if configure(name).builtin else None
    except BadInput:
        return None


def _knows(rows: pd.DataFrame) -> str:
    """Return which readings reach a robot that runs it."""
    if "offline" in rows and rows["offline"].eq(True).any():
        return "every reading of every robot, of later ticks too: a bound that no robot could run"
    if rows["bound"].eq(True).any():
        return "every reading of every robot: a bound on all others"
    if rows["centralised"].eq(True).any():
        return "every reading of every robot, on one computer"
    return "its own readings, and " + (
        "what teammates send" if rows["messages"].gt(0).any() else "nothing of teammates"
    )


# ------------------------------------------------------------------------------------------------ methods and citation

FLOORED = 20  # robots: the floor of larger teams takes seconds for each scenario
FLOOR_PATHS, FLOOR_TRIALS = 16, 8  # over which a floor is taken, in a fifth of the time that one to 0.2 % takes
METHODS = (
    ("Trial", "The unit of every interval and test; its robots and ticks are not independent, and pooled first."),
    ("RMSE",
     "Root of the mean over trials of the mean squared position error [m]; jackknife interval on its logarithm."),
    ("Change", "RMSE relative to the baseline's on the same streams, paired by trial; jackknife on the logarithm."),
    ("p (Holm)",
     "The test over trials that belongs to the interval of the change: the two never disagree. Adjusted by Holm "
     "over all rows of all experiments. It is 1 where the better one of the two failed in a trial."),
    ("Ties",
     "The 95 % interval of the paired change holds 0, or two one-sided tests of the same kind say that the RMSE "
     "are equal within 5 %. An estimator is best alone only where its interval against every other that qualifies "
     "excludes 0."),
    ("Rank, group",
     "Mean over trials of the rank by RMSE, including centralised and over-confident ones. Estimators that share a "
     "letter do not differ significantly at 5 %: the test of the change, of all pairs, adjusted by Holm, so that it "
     "separates fewer estimators than the ties above, which are not adjusted. An estimator that failed in a trial or a "
     "check has neither rank nor letter, and takes none from others. No letters: fewer than two estimators, or five "
     "trials."),
    ("Failed trials",
     "A trial failed that raised, took too long, or whose error is not finite. The numbers of an estimator that failed "
     "are of its other trials, so they are not of the same trials as those beside them: it is not ranked, is never "
     "best, no difference in its favour is significant, and no claim about it is supported."),
    ("Median, outlying",
     f"Of the trials' RMSE; outlying: share of trials above {FAR:g} times that median, with Wilson's "
     "interval. An interval of the RMSE cannot hold what no trial has shown: where one trial of a hundred diverges "
     "twentyfold, it misses the truth in most runs of 20 trials."),
    ("NLL, ellipse",
     "Mean negative log-likelihood of the true position [nats], a proper score: smaller is better, and neither too "
     "small nor too large a covariance improves it. Mean area of the 95 % ellipse [m²]."),
    ("ANEES",
     "Position NEES / 2, per trial first; 1 is consistent. Over-confident: its 95 % interval lies above 1.5, or that "
     "of the share in 95 % ellipses below 0.86; conservative: wholly below 0.67; over-wide: wholly below 0.1, ellipses "
     "ten times as large as the errors ask for; consistent: wholly within 0.67 to 1.5; not shown: it holds a limit. An "
     "estimator that is over-confident, over-wide, or not shown with an ANEES above 3, never qualifies as best. A mean "
     "over trials may be that of one collapsed trial: beside it stand the median over trials, and the share of trials "
     "whose ANEES exceeds 100 (collapsed; Wilson's interval)."),
    ("As published, at its best",
     "Of a method that was run in several configurations: the paper's own, and the one of smallest error with the same "
     "readings (`cooploc list estimators`). Estimators without this remark are other configurations, or their method "
     "has only one."),
    ("Floor",
     "The posterior Cramer-Rao bound on the RMSE of any estimator that hears and uses every reading (Tichavsky 1998), "
     f"where the assumed models are the true ones; for up to {FLOORED} robots, to about 2 %."),
    ("in 95 %", "Share of the true positions that lie inside the 95 % ellipse."),
    ("diverged", "Share of (trial, robot) whose last-quarter RMSE exceeds a quarter of the arena's side."),
    ("messages, bytes, µs",
     "Per robot and tick; messages and bytes as sent, µs of wall-clock time on the processor named below."),
    ("Checks",
     "An estimator that is not built in is checked before it runs: it must not see the truth, the future or lost "
     "packets, and must give the same bits however it is run. One that fails a check is marked and not ranked."),
    ("Centralised, bound", "Every reading reaches one computer, which knows more than any robot could; shown and not "
     "ranked. A bound uses all of them as well as any could who knows the true models."),
    ("Below five trials", "No intervals, tests or verdicts are given."),
    ("Claims",
     "Each is judged by one number with its 95 % interval; a verdict needs the whole interval on its side. `cooploc "
     "verdicts` prints them."),
)  # fmt: skip
BY_SEQUENCES = {  # of a run until decided, in place of those above
    "p (Holm)":
    "1 / e of the confidence sequence of the change, which is valid however a run stops, adjusted by Holm over all "
    "rows of all experiments. It is 1 where the comparison rests on trials that failed.",
    "Ties":
    "The confidence sequence of the paired change holds 0, or lies within 5 %. An estimator is best alone only where "
    "its sequence against every other that qualifies excludes 0.",
    "Rank, group":
    "Estimators that share a letter are not told apart by the confidence sequence of their change: all pairs, each "
    "over the trials that both have, adjusted by Holm. There are no ranks: rows stop at different numbers of trials, "
    "and a mean of ranks over the few that all have would leave out the others. An estimator that failed in a trial "
    "or a check has no letter.",
}  # fmt: skip


def methods(until_decided: bool) -> tuple[tuple[str, str], ...]:
    """Return terms and what they mean, in a run of a fixed number of trials or in one until decided."""
    if not until_decided:
        return METHODS
    return (*((term, BY_SEQUENCES.get(term, meaning)) for term, meaning in METHODS), ("Decided", STOPPED))


TITLE = "cooploc: fair comparison of estimators for multi-robot cooperative localization"  # as in CITATION.cff
FIXED = "with 95 % intervals of the relative change (jackknife on the logarithm) and their tests"
UNTIL = "with confidence sequences of the relative change, which are valid however the run stops,"


def bibtex(version: str, commit: str | None) -> str:
    """Return a BibTeX entry for cooploc in the version that ran."""
    note = [f"  note = {{commit {commit}}},"] if commit else []
    lines = [
        "@software{cooploc,",
        "  author = {{cooploc maintainers}},",
        f"  title = {{{TITLE}}},",
        f"  version = {{{version}}},",
    ]
    return "\n".join([*lines, *note, "}"])


def paragraph(numbers: Numbers) -> str:
    """Return the methods of a run, in sentences that a paper can use."""
    table, manifest = numbers.table, numbers.kept.manifest
    estimators, scenarios = (counted(table[what].nunique(), what) for what in ("estimator", "scenario"))
    baselines = " or ".join(dict.fromkeys(table["baseline"]))
    central = (
        " Estimators at which all readings reach one computer are shown for reference and are not ranked."
        if table["centralised"].any()
        else ""
    )
    return (
        f"We compared {estimators} in {scenarios} with cooploc {manifest['versions']['cooploc']} "
        f"({page_figures.trials(table).removesuffix('.').lower()}, random seed {manifest['seed']}). In each trial all "
        "estimators were given the same readings, initial positions and losses of packets; none had access to the "
        f"truth, and a robot used only what it sensed and what it received.{central} The error of a trial is the mean "
        "squared position error over its robots and ticks, and the RMSE is the root of the mean over trials. Trials "
        f"are the unit of all intervals and tests: the RMSE was compared with that of the baseline ({baselines}), "
        f"paired by trial, {UNTIL if numbers.kept.looks else FIXED} adjusted by Holm's method over "
        f"{counted(int(table['p'].notna().sum()), 'comparison')}. Consistency was judged by the average normalised "
        "estimation error squared of the position (ANEES, 1 is consistent): an estimator is called over-confident "
        f"where its 95 % interval lies above {OVER_CONFIDENT:g}, or too few true positions lie in its 95 % ellipses."
    )

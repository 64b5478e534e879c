"""What a report gives to copy into a paper: a paragraph on the methods, and how cooploc is cited."""

from cooploc.analysis.formats import counted
from cooploc.analysis.metrics.consistency import OVER_CONFIDENT
from cooploc.analysis.report import page_figures
from cooploc.analysis.report.run_numbers import Numbers

TITLE = "cooploc: fair comparison of estimators for multi-robot cooperative localization"  # as in CITATION.cff
FIXED = "with Fieller's 95 % intervals of the relative change and t tests"
UNTIL = "with confidence sequences of the relative change, which are valid however the run stops,"


def bibtex(version: str, commit: str | None) -> str:
    """An entry for cooploc in the version that ran."""
    note = [f"  note = {{commit {commit}}},"] if commit else []
    lines = [
        "@software{cooploc,",
        "  author = {{cooploc maintainers}},",
        f"  title = {{{TITLE}}},",
        f"  version = {{{version}}},",
    ]
    return "\n".join([*lines, *note, "}"])


def paragraph(numbers: Numbers) -> str:
    """The methods of a run, in sentences that a paper can use."""
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

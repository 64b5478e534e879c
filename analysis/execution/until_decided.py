"""Run a study until its questions are decided: after 10, 20, 40, ... trials, what is decided stops.

What a look decides depends on the trials below its number alone, never on when they finished, so neither the number of
processes nor an interruption changes it: the same command, run again, reads the looks that are on the disk.
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from cooploc.analysis.execution.run import RunProgress, Silent, execute
from cooploc.analysis.execution.run_directory import DECISIONS, Cell, write_json
from cooploc.analysis.formats import count_of, duration
from cooploc.analysis.metrics.sequential import OPEN, decide, looks
from cooploc.scenarios.studies.study import ResolvedStudy


class Answers(NamedTuple):
    """The answers of a look to one kind of question."""

    of: str  # what is asked: comparison, claim
    open: frozenset[Cell]  # cells whose further trials may decide what is open
    decided: int
    undecided: int
    records: list[dict[str, Any]]  # for `decisions.json`


Ask = Callable[[pd.DataFrame, int], Answers]  # rows of a run, and the trials of the look


def run_until_decided(
    study: ResolvedStudy, out: Path, ask: Sequence[Ask] = (), progress: RunProgress | None = None, **options: Any
) -> pd.DataFrame:
    """Run a study until its comparisons with baselines, and what else is asked, are decided.

    Args:
        study: what to run; its number of trials is the most that anything gets.
        out: the run directory.
        ask: further questions, beside every comparison of an estimator with its scenario's baseline.
        progress: called for every part; it is told what every look decides.
        options: of `execute`.

    Returns:
        The rows of `execute`. `decisions.json` in the run directory says what was decided at which look.

    Raises:
        BadInput, OSError: as `execute`.

    """
    most, watcher = study.study.trials, progress or Silent()
    limits = {(cell.scenario.label, name): count for cell in study.cells for name, count in cell.trials.items()}
    baselines = {cell.scenario.label: cell.baseline for cell in study.cells}
    counts, going, rows = dict.fromkeys(limits, 0), set(limits), pd.DataFrame()
    for n in looks(most):
        counts |= {cell: min(n, limits[cell]) for cell in going}
        rows = execute(study.limit_trials(counts), out, progress=watcher, **options)
        below = {cell.scenario.label: min(n, cell.most) for cell in study.cells}
        answers = [_compare(rows, baselines, below), *(question(rows, n) for question in ask)]
        going = {cell for one in answers for cell in one.open if counts[cell] < limits[cell]}
        records = {one.of: one.records for one in answers}
        write_json(out / DECISIONS, {"most": most, "look": n, "going": sorted(going), **records})
        watcher.say(_look_sentence(n, answers, seconds_left(rows, going, most) / options.get("jobs", 1)))
        if not going:
            break
    return rows


def _compare(rows: pd.DataFrame, baselines: dict[str, str], below: dict[str, int]) -> Answers:
    """Compare every estimator with the baseline of its scenario, on the trials below a number."""
    found = decide(rows, baselines, below)
    going = [one for one in found if one.verdict == OPEN]
    cells = frozenset((one.scenario, name) for one in going for name in (one.estimator, one.baseline))
    return Answers("comparison", cells, len(found) - len(going), len(going), [one._asdict() for one in found])


def trial_seconds(rows: pd.DataFrame) -> "pd.Series[float]":
    """Return the computing time of a trial [s] on one process, by (scenario, estimator), without its stream."""
    groups = (rows["seconds"] * rows["ticks"]).groupby([rows["scenario"], rows["estimator"]])
    return groups.sum() / rows.groupby(["scenario", "estimator"])["trial"].nunique()


def seconds_left(rows: pd.DataFrame, going: Iterable[Cell], most: int) -> float:
    """Return the seconds of one process that open cells take at most, by the time of their trials so far."""
    cost, there = trial_seconds(rows), rows.groupby(["scenario", "estimator"])["trial"].nunique()
    return float(sum(cost[cell] * max(0, most - there[cell]) for cell in going if cell in there.index))


def _look_sentence(n: int, answers: Sequence[Answers], left: float) -> str:
    """Say what a look decided, and how long the rest takes at most."""
    totals = [(one.decided, one.decided + one.undecided, one.of) for one in answers]
    decided = ", ".join(f"{done} of {count_of(total, of)}" for done, total, of in totals if total)
    still = sum(one.undecided for one in answers)
    rest = f"; {still} open, at most about {duration(left)} of estimating more" if left > 0 else ""
    return f"after {n} trials: decided {decided}{rest}"

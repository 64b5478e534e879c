"""Run a study until its questions are decided: after 10, 20, 40, ... trials, what is decided stops.

What a look decides depends on the trials below its number alone, never on when they finished, so neither the number of
processes nor an interruption changes it: the same command, run again, reads the looks that are on the disk.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from cooploc.analysis.execution.progress import RunProgress
from cooploc.analysis.execution.run import execute
from cooploc.analysis.execution.run_directory import DECISIONS, write_json
from cooploc.analysis.formats import counted, duration
from cooploc.analysis.metrics.sequential import OPEN, decide, looks
from cooploc.scenarios.studies.study import Study, resolve_study

Cell = tuple[str, str]  # labels of a scenario and an estimator


class Answers(NamedTuple):
    """The answers of a look to one kind of question."""

    of: str  # what is asked: comparison, claim
    open: frozenset[Cell]  # cells whose further trials may decide what is open
    decided: int
    undecided: int
    records: list[dict[str, Any]]  # for `decisions.json`


Ask = Callable[[pd.DataFrame, int], Answers]  # rows of a run, and the trials of the look


def run_until_decided(
    study: Study, out: Path, ask: Sequence[Ask] = (), progress: RunProgress | None = None, **options: Any
) -> pd.DataFrame:
    """Run a study until its comparisons with baselines, and what else is asked, are decided.

    Args:
        study: what to run; its number of trials is the most that anything gets.
        out: the run directory.
        ask: further questions, beside every comparison of an estimator with its scenario's baseline.
        progress: called for every part, and told what every look decides.
        options: of `execute`.

    Returns:
        The rows of `execute`. `decisions.json` in the run directory says what was decided at which look.

    Raises:
        BadInput, OSError: as `execute`.

    """
    resolved = resolve_study(study, options.get("data"))
    most = {cell.scenario.label: cell.most for cell in resolved.cells}
    counts = {(cell.scenario.label, name): 0 for cell in resolved.cells for name in cell.trials}
    questions = (_comparisons(study.baselines(), most), *ask)
    watcher, going = _DecisionProgress(progress or RunProgress()), set(counts)
    rows = pd.DataFrame()
    for n in looks(study.trials):
        counts |= {cell: min(n, most[cell[0]]) for cell in going}
        rows = execute(study, out, counts=counts, progress=watcher, **options)
        answers = [question(rows, n) for question in questions]
        going = {cell for one in answers for cell in one.open if counts[cell] < most[cell[0]]}
        records = {one.of: one.records for one in answers}
        write_json(out / DECISIONS, {"most": study.trials, "look": n, "going": sorted(going), **records})
        watcher.look(n, answers, seconds_left(rows, going, study.trials) / options.get("jobs", 1))
        if not going:
            break
    return rows


def _comparisons(baselines: Mapping[str, str], most: Mapping[str, int]) -> Ask:
    """Return the question that compares every estimator with the baseline of its scenario."""

    def ask(rows: pd.DataFrame, n: int) -> Answers:
        found = decide(rows, baselines, {scenario: min(n, count) for scenario, count in most.items()})
        going = [one for one in found if one.verdict == OPEN]
        cells = frozenset((one.scenario, name) for one in going for name in (one.estimator, one.baseline))
        return Answers("comparison", cells, len(found) - len(going), len(going), [one._asdict() for one in found])

    return ask


def trial_seconds(rows: pd.DataFrame) -> "pd.Series[float]":
    """Return the computing time of a trial [s] on one process, by (scenario, estimator), without its stream."""
    groups = (rows["seconds"] * rows["ticks"]).groupby([rows["scenario"], rows["estimator"]])
    return groups.sum() / rows.groupby(["scenario", "estimator"])["trial"].nunique()


def seconds_left(rows: pd.DataFrame, going: Iterable[Cell], most: int) -> float:
    """Return the seconds of one process that open cells take at most, by the time of their trials so far."""
    cost, there = trial_seconds(rows), rows.groupby(["scenario", "estimator"])["trial"].nunique()
    return float(sum(cost[cell] * max(0, most - there[cell]) for cell in going if cell in there.index))


class _DecisionProgress(RunProgress):
    """Progress that also says what is decided."""

    def __init__(self, shown: RunProgress) -> None:
        self._shown, self._state = shown, ""

    def compiling(self) -> None:
        """Pass it on."""
        self._shown.compiling()

    def begin(self, trials: int, found: int) -> None:
        """Count the trials of a look; those of earlier looks are not counted again."""
        self._shown.begin(trials - found if self._state else trials, 0 if self._state else found)

    def advance(self, what: str, trials: int, failed: int, share: float) -> None:
        """Pass it on, with the number of open questions."""
        self._shown.advance(f"{self._state}{what}", trials, failed, share)

    def say(self, line: str) -> None:
        """Pass it on."""
        self._shown.say(line)

    def look(self, n: int, answers: Sequence[Answers], left: float) -> None:
        """Say what a look decided, and how long the rest takes at most."""
        said = [
            f"{one.decided} of {counted(one.decided + one.undecided, one.of)}"
            for one in answers
            if one.decided + one.undecided
        ]
        still = sum(one.undecided for one in answers)
        rest = f"; {still} open, at most about {duration(left)} of estimating more" if left > 0 else ""
        self._shown.say(f"after {n} trials: decided {', '.join(said)}{rest}")
        self._state = f"{still} open after {n} trials · "

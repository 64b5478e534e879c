"""Everything that a run directory holds, of all studies and options that were run into it."""

from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from cooploc.analysis.execution.certificates import with_lines
from cooploc.analysis.execution.decisions_file import comparisons, looks_taken, read_decisions
from cooploc.analysis.execution.run_directory import Piece, RunDir
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.studies.study import Study


class Kept(NamedTuple):
    """A run as it is on disk."""

    folder: Path
    manifest: dict[str, Any]
    rows: pd.DataFrame  # as `errors`, with `failure`, `traceback` and `certificate`; in the manifest's order
    gaps: dict[tuple[str, str], int]  # (scenario, estimator) -> trials that were asked for and are missing
    ignored: tuple[str, ...] = ()  # a line for each file among the parts that no run wrote
    decisions: dict[str, Any] | None = None  # of a run until decided: `decisions_file.Decisions`

    @property
    def baselines(self) -> dict[str, str]:
        """What each scenario's estimators are compared with."""
        return {scenario: cell["baseline"] for scenario, cell in self.manifest["cells"].items()}

    @property
    def comparisons(self) -> pd.DataFrame | None:
        """Of a run until decided, what was decided of each comparison: the fields of `decisions.Decision`."""
        return comparisons(self.decisions)

    @property
    def looks(self) -> list[int]:
        """The looks of a run until decided, in trials; none where the number of trials was fixed."""
        return looks_taken(self.decisions)

    @property
    def experiments(self) -> dict[str, dict[str, list[str]]]:
        """Of each experiment its scenarios, and of each scenario the estimators that have rows, in the study's order.

        A scenario that several experiments share is in each of them, with the estimators that it has there.
        """
        pairs = self.rows.drop_duplicates(["scenario", "estimator"])
        there = {str(s): list(part["estimator"]) for s, part in pairs.groupby("scenario", sort=False)}
        planned = _planned(Study(**self.manifest["study"]))
        for scenario, cell in self.manifest["cells"].items():  # what was run for another study, or with --estimators
            known = {name for plan in planned.values() for name in plan.get(scenario, ())}
            more = [name for name in there.get(scenario, ()) if name not in known]
            planned.setdefault(cell["experiment"], {}).setdefault(scenario, []).extend(more)
        some = {
            name: {s: [e for e in there.get(s, ()) if e in mine] for s, mine in plan.items()}
            for name, plan in planned.items()
        }
        found = {name: {s: mine for s, mine in plan.items() if mine} for name, plan in some.items()}
        return {name: plan for name, plan in found.items() if plan}


def _planned(study: Study) -> dict[str, dict[str, list[str]]]:
    """The estimators of each scenario of each experiment."""
    found: dict[str, dict[str, list[str]]] = {}
    for cell in study.expand_blocks():
        found.setdefault(cell.experiment, {}).setdefault(cell.scenario, []).extend(cell.estimators)
    return found


def read(folder: Path) -> Kept:
    """The rows of a run directory; a part that does not match its checksum counts as missing.

    Raises:
        BadInput: the directory is not one of a run, or holds no rows.

    """
    directory = RunDir(folder)
    manifest = directory.manifest
    if not manifest:
        raise BadInput(f"{folder} holds no run: name the directory that cooploc run wrote")
    parts: list[tuple[Piece, int]] = []
    gaps: dict[tuple[str, str], int] = {}
    for scenario, cell in manifest["cells"].items():
        for estimator, asked in cell["estimators"].items():
            there = directory.pieces(scenario, estimator, asked).intact
            missing = asked - sum(min(piece.trials.stop, asked) - piece.trials.start for piece in there)
            gaps |= {(scenario, estimator): missing} if missing else {}
            parts += [(piece, asked) for piece in there]
    if not parts:
        raise BadInput(f"{folder} holds no results yet: continue it with cooploc run --out {folder}")
    rows = with_lines(directory.rows(parts), manifest.get("certificates", {}))
    return Kept(folder, manifest, rows, gaps, tuple(directory.foreign()), read_decisions(folder))

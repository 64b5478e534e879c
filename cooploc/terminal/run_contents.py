"""What a run directory holds, what is missing, and what failed and why."""

from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console

from cooploc.analysis.execution.certificates import line
from cooploc.analysis.execution.decisions_file import read_decisions
from cooploc.analysis.execution.run_directory import Piece, RunDir
from cooploc.analysis.formats import counted
from cooploc.analysis.metrics.ranking import short_certificate
from cooploc.analysis.report.failures import failures
from cooploc.analysis.report.result_columns import decided
from cooploc.analysis.report.tables import Table, numbers, words
from cooploc.estimators.errors import BadInput
from cooploc.terminal.console import wide
from cooploc.terminal.decided import state
from cooploc.terminal.results import ONE_PROCESS

FRAMES = 3  # of a traceback
CONTINUED = "During handling of the above exception, another exception occurred:"
COLUMNS = (
    words("experiment"),
    words("scenario"),
    words("estimator"),
    words("checks", form=short_certificate),
    numbers("trials"),
    numbers("failed", form=lambda failed: str(failed or "")),
    words("decided", of=("verdict", "look", "trials_there"), form=decided),
    words("", "remark"),
)


def show(folder: Path) -> None:
    """Print what a run holds, what is missing, and what failed and why.

    Raises:
        BadInput: the directory is not a run's.

    """
    directory = RunDir(folder)
    manifest = directory.manifest
    if not manifest:
        raise BadInput(f"{folder} holds no run: name the directory that cooploc run wrote")
    console = wide()
    _head(console, folder, manifest)
    certificates = manifest.get("certificates", {})
    decisions = read_decisions(folder)
    compared = decisions["comparison"] if decisions else []
    verdicts = {(one["scenario"], one["estimator"]): one for one in compared}
    rows: list[dict[str, Any]] = []
    failed: list[pd.DataFrame] = []
    for scenario, cell in manifest["cells"].items():
        for estimator, asked in cell["estimators"].items():
            row, lost = _contents(directory, scenario, estimator, asked)
            verdict = verdicts.get((scenario, estimator), {"verdict": "", "look": 0})
            rows.append({**verdict, **row, "experiment": cell["experiment"], "checks": line(estimator, certificates)})
            failed += [lost] if len(lost) else []
    hidden = ["decided"] * (not decisions) + ["experiment"] * (len({row["experiment"] for row in rows}) == 1)
    shown = tuple(column for column in COLUMNS if column.head not in hidden)
    console.print(Table("contents", "", shown, rows).terminal())
    if decisions:
        console.print(state(folder, decisions))
    for ignored in directory.foreign():
        console.print(ignored)
    _certificates(console, certificates)
    if not manifest.get("isolated", True):
        console.print(ONE_PROCESS)
    for found, traceback in failures(pd.concat(failed)) if failed else []:
        console.print(f"\nfailed: {found}")
        console.print(_end_of(traceback), style="dim", soft_wrap=True)
    if not failed:
        console.print("\nnothing failed")


def _head(console: Console, folder: Path, manifest: dict[str, Any]) -> None:
    study, versions = manifest["study"], manifest["versions"]
    trials = counted(study["trials"], "trial")
    console.print(f"{folder}: study {study['name']}, seed {manifest['seed']}, {trials}")
    console.print(": ".join(filter(None, (study.get("title"), study["about"]))))
    commit = f", commit {manifest['commit'][:12]}" if manifest["commit"] else ""
    console.print(f"cooploc {versions['cooploc']}{commit}, Python {versions['python']}, on {manifest['cpu']}")
    console.print()


def _contents(directory: RunDir, scenario: str, estimator: str, asked: int) -> tuple[dict[str, Any], pd.DataFrame]:
    """A row of the table, and the first row of every trial that failed."""
    trials: set[int] = set()
    frames, corrupt = [], 0
    for held in directory.held(scenario, estimator):
        piece = Piece(scenario, estimator, held)
        if not directory.intact(piece):
            corrupt += 1
            continue
        trials |= set(held)
        part = directory.read(piece)
        frames.append(part[part["failure"].notna()].drop_duplicates("trial"))
    remarks = [f"{counted(corrupt, 'corrupt part')}, will be computed again"] if corrupt else []
    remarks += ["not finished"] if len(trials) < asked else []
    failed = pd.concat(frames) if frames else pd.DataFrame({"trial": []})
    counts = {"trials": f"{len(trials)} of {asked}", "trials_there": len(trials), "failed": failed["trial"].nunique()}
    return {"scenario": scenario, "estimator": estimator, **counts, "remark": ", ".join(remarks)}, failed


def _end_of(traceback: str) -> str:
    """The last frames of the last exception of a traceback, and its message."""
    last = traceback.rpartition(CONTINUED)[2].strip("\n")
    head, *frames = last.split("\n  File ")
    shown = frames[-FRAMES:]
    return "\n  File ".join([head + "\n  ..." * (len(frames) > FRAMES), *shown])


def _certificates(console: Console, certificates: dict[str, Any]) -> None:
    """What was found of every estimator that is not built in, and every check that it failed."""
    for label, certificate in certificates.items():
        console.print(f"\n{label}, {certificate['status']}: {certificate['found']}")
        alike: dict[str, list[str]] = {}
        for check in certificate["checks"]:
            if check["status"] != "passed":
                said = check["detail"] in certificate["found"] and check["example"]
                smallest = f"smallest example: {check['example']}" if check["example"] else ""
                found = smallest if said else "; ".join(filter(None, (check["detail"], smallest)))
                alike.setdefault(f"{check['status']}: {found}", []).append(check["check"])
        for found, checks in alike.items():
            console.print(f"  {', '.join(checks)} {found}", style="dim")

"""What a run directory holds, for the terminal."""

from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console
from rich.table import Table

from cooploc.analysis.execution.certificates import line
from cooploc.analysis.execution.run_directory import Piece, RunDir
from cooploc.analysis.metrics.certificate_line import mark
from cooploc.estimators.plugins.errors import BadInput


def show(folder: Path) -> None:
    """Print what a run holds, what is missing, and what failed and why.

    Raises:
        BadInput: the directory is none of a run.

    """
    directory = RunDir(folder)
    manifest = directory.manifest
    if not manifest:
        raise BadInput(f"{folder} holds no run: name the directory that cooploc run wrote")
    console = Console(highlight=False, markup=False, width=400)
    _head(console, folder, manifest)
    failures: list[pd.DataFrame] = []
    certificates = manifest.get("certificates", {})
    table = Table(box=None, padding=(0, 1), header_style="bold")
    for heading in ("experiment", "scenario", "estimator", "checks", "trials", "failed", ""):
        table.add_column(heading, no_wrap=True, justify="right" if heading in ("trials", "failed") else "left")
    for scenario, cell in manifest["cells"].items():
        for estimator, asked in cell["estimators"].items():
            counted, remark, failed = _holding(directory, scenario, estimator, asked)
            names = cell["experiment"], scenario, estimator, mark(line(estimator, certificates))
            lost = failed["trial"].nunique() if len(failed) else 0
            table.add_row(*names, f"{counted} of {asked}", str(lost or ""), remark)
            failures += [failed] if len(failed) else []
    console.print(table)
    _tell_certificates(console, certificates)
    _tell_failures(console, failures)


def _head(console: Console, folder: Path, manifest: dict[str, Any]) -> None:
    study, versions = manifest["study"], manifest["versions"]
    console.print(f"{folder}: study {study['name']}, seed {manifest['seed']}, {study['trials']} trials")
    console.print(study["about"], soft_wrap=True)
    commit = f", commit {manifest['commit'][:12]}" if manifest["commit"] else ""
    console.print(f"cooploc {versions['cooploc']}{commit}, Python {versions['python']}, on {manifest['cpu']}")
    console.print()


def _holding(directory: RunDir, scenario: str, estimator: str, asked: int) -> tuple[int, str, pd.DataFrame]:
    """How many trials are there, what there is to say, and the first row of every trial that failed."""
    trials: set[int] = set()
    frames, spoilt = [], 0
    for held in directory.held(scenario, estimator):
        piece = Piece(scenario, estimator, held)
        if not directory.intact(piece):
            spoilt += 1
            continue
        trials |= set(held)
        part = directory.read(piece)
        frames.append(part[part["failure"].notna()].drop_duplicates("trial"))
    remarks = [f"{spoilt} spoilt part{'s' if spoilt > 1 else ''}, to be computed again"] if spoilt else []
    remarks += ["not finished"] if len(trials) < asked else []
    failed = pd.concat(frames) if frames else pd.DataFrame()
    return len(trials), ", ".join(remarks), failed


def _tell_certificates(console: Console, certificates: dict[str, Any]) -> None:
    """What was found of every estimator that is not built in, and every check that it failed."""
    for label, certificate in certificates.items():
        console.print(f"\n{label}, {certificate['status']}: {certificate['found']}", soft_wrap=True)
        alike: dict[str, list[str]] = {}
        for check in certificate["checks"]:
            if check["status"] != "passed":
                smallest = f"; smallest: {check['example']}" if check["example"] else ""
                alike.setdefault(f"{check['status']}: {check['detail']}{smallest}", []).append(check["check"])
        for found, checks in alike.items():
            console.print(f"  {', '.join(checks)} {found}", style="dim", soft_wrap=True)


def _tell_failures(console: Console, failures: list[pd.DataFrame]) -> None:
    """Each different failure once, with its trials, its line, and where it was raised."""
    if not failures:
        console.print("\nnothing failed")
        return
    rows = pd.concat(failures)
    for (scenario, estimator, failure), group in rows.groupby(["scenario", "estimator", "failure"], sort=False):
        trials = ", ".join(str(trial) for trial in sorted(group["trial"])[:10])
        more = " ..." if len(group) > 10 else ""
        console.print(f"\nfailed: {scenario}, {estimator}, trial {trials}{more}: {failure}", soft_wrap=True)
        console.print(group["traceback"].iloc[0], style="dim", soft_wrap=True)

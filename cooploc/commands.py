"""The command `cooploc judge`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

import cooploc as cl
from cooploc.terminal.console import Estimators, Isolate, Jobs, Recordings, StudyName


def judge(
    stream: Annotated[str, typer.Argument(help="a file that Stream.save wrote, or a scenario")],
    tum: Annotated[Path, typer.Option(help="folder of trial0-robot0.txt, ..., or one folder of these for each")],
    estimators: Annotated[str | None, typer.Option(help="comma-separated estimators to run on the same stream")] = None,
    trials: Annotated[int | None, typer.Option(help="of a scenario [default: 1]")] = None,
    seed: Annotated[int | None, typer.Option(help="of a scenario [default: 0]")] = None,
    data: Recordings = None,
    offline: Annotated[bool, typer.Option("--offline", help="they saw later readings, as smoothers do")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="print the table as JSON alone")] = False,
) -> None:
    """Judge trajectories computed elsewhere, from TUM files.

    With the truth of a stream.
    """
    from cooploc.analysis.metrics.external import evaluate_external
    from cooploc.terminal import tables

    rows, table = evaluate_external(stream, tum, estimators, offline, trials=trials, seed=seed, data=data)
    tables.table(table, rows, as_json)


# The command `cooploc plan`.


def plan(
    study: StudyName,
    difference: Annotated[float, typer.Option(help="change of RMSE to be shown; 0.1 is 10 %")] = 0.1,
    seed: Annotated[int | None, typer.Option(help="random seed")] = None,
    estimators: Estimators = None,
    jobs: Jobs = 1,
    data: Recordings = None,
    out: Annotated[Path | None, typer.Option(help="run directory [default: runs/STUDY-seedN]")] = None,
    isolate: Isolate = True,
) -> None:
    """Say how many trials each comparison needs, and how long.

    From a pilot of ten trials, at 80 % power.
    """
    from cooploc.terminal import tables

    found = cl.plan(
        study,
        difference=difference,
        seed=seed,
        estimators=estimators,
        jobs=jobs,
        data=data,
        out=out,
        isolate=isolate,
    )
    tables.show_plan(found, difference, jobs)


# The command `cooploc tune`.


class Objective(StrEnum):
    """What tuning makes small."""

    nll = "nll"
    rmse = "rmse"


def tune(
    study: StudyName,
    budget: Annotated[int, typer.Option(help="training trials that each estimator may use")] = 100,
    estimators: Estimators = None,
    trials: Annotated[int | None, typer.Option(help="fresh trials per scenario, to compare on")] = None,
    seed: Annotated[int | None, typer.Option(help="random seed; that of training is derived from it")] = None,
    objective: Annotated[
        Objective, typer.Option(help="nll: log-likelihood of the true position, robust and proper; or rmse")
    ] = Objective.nll,
    jobs: Jobs = 1,
    data: Recordings = None,
    out: Annotated[Path | None, typer.Option(help="directory [default: runs/STUDY-seedN-tuned]")] = None,
    check: Annotated[bool, typer.Option(help="check estimators that are not built in before they are compared")] = True,
    isolate: Isolate = True,
) -> None:
    """Tune all estimators with one budget, and compare them.

    As published and tuned, on streams that were not tuned on.
    """
    from cooploc.terminal import tables

    found = cl.tune(
        study,
        budget,
        estimators=estimators,
        trials=trials,
        seed=seed,
        objective=objective.value,
        jobs=jobs,
        data=data,
        out=out,
        check=check,
        isolate=isolate,
    )
    orders = {"RMSE": found.order("rmse"), "NLL": found.order("nll")}
    tables.show_tuning(found.history, found.table, orders, found.record)
    typer.echo(f"tables and figures: {found.folder}\nstudy: {found.study}\nnext: cooploc run {found.study}")
    if found.rows["failure"].notna().any():
        raise typer.Exit(1)

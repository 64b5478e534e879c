"""The command `cooploc tune`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

import cooploc as cl
from cooploc.terminal.options import Estimators, Isolate, Jobs, Recordings, StudyName


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
    from cooploc.terminal import tuning

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
    tuning.show(found.history, found.table, orders, found.record)
    typer.echo(f"tables and figures: {found.folder}\nstudy: {found.study}\nnext: cooploc run {found.study}")
    if found.rows["failure"].notna().any():
        raise typer.Exit(1)

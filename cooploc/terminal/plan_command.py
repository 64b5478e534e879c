"""The command `cooploc plan`."""

from pathlib import Path
from typing import Annotated

import typer

import cooploc as cl
from cooploc.terminal.options import Estimators, Isolate, Jobs, Recordings, StudyName


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
    from cooploc.terminal import planned

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
    planned.show(found, difference, jobs)

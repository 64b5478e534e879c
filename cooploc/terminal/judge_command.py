"""The command `cooploc judge`."""

from pathlib import Path
from typing import Annotated

import typer

from cooploc.terminal.options import Recordings


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
    from cooploc.terminal import results

    rows, table = evaluate_external(stream, tum, estimators, offline, trials=trials, seed=seed, data=data)
    results.table(table, rows, as_json)

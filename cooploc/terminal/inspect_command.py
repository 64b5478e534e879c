"""`cooploc inspect`: look at a recording before anything is fitted."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import cooploc as cl
from cooploc.terminal.console import Strict

if TYPE_CHECKING:
    import pandas as pd

MOST = 40  # rows of a table; `cl.inspect` has all


def inspect(
    path: Annotated[Path, typer.Argument(help="directory of CSV files, a ROS bag, a PyFG file or MRCLAM text")],
    out: Annotated[Path | None, typer.Option(help="directory for log.toml and sketch [default: beside it]")] = None,
    run: Annotated[str, typer.Option(help="which recording of several [default: the first]")] = "",
    force: Annotated[bool, typer.Option("--force", help="guess again, and replace a log.toml that is there")] = False,
    strict: Strict = False,
) -> None:
    """Look at a recording of robots, and draft its log.toml.

    Says what is in it and what is odd about it, sketches it, and writes a log.toml that runs.
    """
    found = cl.inspect(path, run, again=force)
    if strict:
        from cooploc.analysis.execution.run import require_whole

        require_whole(found.inspected.log.warnings)
    _show(found, found.write(out, force))


def _show(found: "cl.Inspection", files: Sequence[Path]) -> None:
    """Print the tables of an inspection, its findings, and the files that were written."""
    from cooploc.terminal.console import wide

    say, inspected = wide().print, found.inspected
    say(f"{inspected.path}: {inspected.format} ({inspected.why}), runs: {', '.join(inspected.runs)}\n")
    units = {"rate": "rate [Hz]", "first": "from [s]", "last": "to [s]", "longest": "longest [s]"}
    _show_table("series", found.series.drop(columns="source").rename(columns=units))
    _show_table("columns", found.columns)
    for line in inspected.unused:
        say(f"not used: {line}")
    for f in inspected.findings:
        say(f"found ({f.sure}): {f.kind}{' ' * bool(f.robot)}{f.robot}: {f.fact}")
        say(f"  to change in log.toml: {f.change}")
    if not inspected.findings:
        say("nothing odd was found")
    kept = "" if any(file.name == "log.toml" for file in files) else "; the log.toml that is there was left as it is"
    say(f"written: {', '.join(map(str, files))}{kept}")
    for line in inspected.trial.lines:
        say(f"tried: {line}")
    if inspected.trial.problem:
        say(f"tried, and it does not run: {inspected.trial.problem}")
        say(f"next: correct {files[-1].parent / 'log.toml'}, then cooploc inspect {inspected.path}")
    else:
        say(f"next: look at both, then cooploc run log --data {files[-1].parent}")


def _show_table(name: str, table: "pd.DataFrame") -> None:
    """Print the first rows of a table, if it has any."""
    from cooploc.analysis.report.tables import Table, number_column, text_column
    from cooploc.terminal.console import wide

    if not len(table):
        return
    columns = tuple((number_column if table[c].dtype.kind in "if" else text_column)(str(c)) for c in table.columns)
    records = table.head(MOST).to_dict("records")
    rows = [{k: f"{v:.4g}" if isinstance(v, float) else str(v) for k, v in row.items()} for row in records]
    say = wide().print
    say(Table(name, name, columns, rows).terminal())
    if len(table) > MOST:
        say(f"  and {len(table) - MOST} more")
    say()

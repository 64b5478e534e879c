"""`cooploc inspect`: look at a recording before anything is fitted."""

from pathlib import Path
from typing import Annotated

import typer

import cooploc as cl


def inspect(
    path: Annotated[Path, typer.Argument(help="directory of CSV files, a ROS bag, a PyFG file or MRCLAM text")],
    out: Annotated[Path | None, typer.Option(help="directory for log.toml and sketch [default: beside it]")] = None,
    run: Annotated[str, typer.Option(help="which recording of several [default: the first]")] = "",
    force: Annotated[bool, typer.Option("--force", help="guess again, and replace a log.toml that is there")] = False,
) -> None:
    """Look at a recording of robots, and draft its log.toml.

    Says what is in it and what is odd about it, sketches it, and writes a log.toml that runs.
    """
    from cooploc.terminal import inspection

    found = cl.inspect(path, run, again=force)
    inspection.show(found, found.write(out, force))

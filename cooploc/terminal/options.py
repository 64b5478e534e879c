"""Arguments and options that several commands have."""

from pathlib import Path
from typing import Annotated

import typer

StudyName = Annotated[str, typer.Argument(help="name of a shipped study, or path of a study's TOML file")]
Estimators = Annotated[str | None, typer.Option(help="comma-separated estimators, instead of the study's")]
Jobs = Annotated[int, typer.Option(help="number of processes")]
RunDirectory = Annotated[Path, typer.Argument(help="a run directory")]
Recordings = Annotated[Path | None, typer.Option(help="directory of recordings")]
Isolate = Annotated[bool, typer.Option(help="give what is not built in processes of its own, where it may crash")]
Claims = Annotated[Path | None, typer.Option(help="TOML file of claims [default: those of the paper]")]

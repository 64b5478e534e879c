"""A recording's trials are its runs, and a stream holds one of them, as each run has models of its own."""

from collections.abc import Sequence
from pathlib import Path

from cooploc.estimators.errors import BadInput


def asked(data: Path, run: str, names: Sequence[str], trials: Sequence[int]) -> str:
    """The name of the run that a list with one trial asks for.

    Raises:
        BadInput: there are several trials, or there is no such trial.

    """
    there = f"{data}: {run!r} has {len(names)} trial{'s' * (len(names) > 1)}"
    if len(trials) != 1:
        raise BadInput(f"{there}, and a stream holds one, as each run has its own models; ask for trials=[0]")
    if trials[0] >= len(names):
        raise BadInput(f"{there}, numbered from 0; there is no trial {trials[0]}; ask for an existing one")
    return names[trials[0]]

"""Which module reads which format. Each has two functions, `runs` and `read`.

runs(data, description) -> {name: place}: the recordings in a directory, sorted by name.
read(data, place, name, description) -> TeamLog: one of them, in SI units, with the declared clock offsets added and the
declared frame undone (`truth_frame`); what is dropped is told in its warnings. `data` is the directory that was named,
in which files of places lie (`places_file`).
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from cooploc.estimators.registry import loaded
from cooploc.scenarios.recordings.team.schema import TeamDescription
from cooploc.scenarios.recordings.team.team_log import TeamLog

MODULES = {"csv": "csv_files", "bag": "bags", "pyfg": "pyfg", "mrclam": "mrclam"}


class Reader(NamedTuple):
    """How recordings of one format are found and read. Both raise BadInput: one line, fact, place and remedy."""

    runs: Callable[[Path, TeamDescription], Mapping[str, Path]]
    read: Callable[[Path, Path, str, TeamDescription], TeamLog]


def reader(form: str) -> Reader:
    """The reader of a format, imported when it is needed.

    Raises:
        BadInput: it cannot be imported.

    """
    module = f"{__package__}.{MODULES[form]}"
    return Reader(*(loaded(f"{module}:{name}", f"the reader of {form} recordings") for name in ("runs", "read")))

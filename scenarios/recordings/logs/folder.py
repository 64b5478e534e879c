"""A directory of runs: which of them are different recordings, and which may teach the models of which."""

from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.recordings.logs import schema
from cooploc.scenarios.recordings.logs.run import Run, read_run
from cooploc.scenarios.recordings.logs.schema import Description

ALL = "all"  # in the place of a run's name
SHARED = 3  # equal lines: of two files that have as many in common, neither is fitted on the other


class Logs(NamedTuple):
    """A directory of runs with its description."""

    data: Path
    source: Any  # the path of the description
    about: Description
    runs: dict[str, Run]  # by name, sorted
    different: list[str]  # the names of those that are no part of another

    @property
    def anchors(self) -> Array:
        """Their places (a, 2) [m]."""
        return np.array(self.about.anchors.positions if self.about.anchors else (), float).reshape(-1, 2)

    @property
    def arena(self) -> Array:
        """Lower left and upper right corner (2, 2) [m]."""
        corners = np.array(self.about.arena, float) if self.about.arena else self.anchors
        return np.stack([corners.min(0), corners.max(0)])

    def others(self, name: str, same_set_up: bool) -> list[Run]:
        """The runs that models of this one may be fitted on: without a line of it, and no line twice."""
        mine = self._set_up(name)
        return [
            self.runs[other]
            for other in self.different
            if other != name
            and (self._set_up(other) == mine or not same_set_up)
            and self.runs[other].shares(self.runs[name]) < SHARED
        ]

    def _set_up(self, name: str) -> str:
        """The first pattern that the name fits; a run that fits none is a set-up of its own."""
        return next((pattern for pattern in self.about.set_ups if fnmatchcase(name, pattern)), f"only {name}")


def read_logs(data: Path, described: str = "") -> Logs:
    """Every run in a directory, by the description beside them, or by a shipped one.

    Raises:
        BadInput: there is no directory, no description or no run, or one of them is malformed.

    """
    if not data.is_dir():
        raise BadInput(f"{data}: there is no such directory; name the one that holds the runs' CSV files")
    source = schema.shipped(described) if described else data / schema.NAME
    about = schema.load(source)
    found = [path for path in data.iterdir() if fnmatchcase(path.name, about.files) and path != source]
    paths = sorted(found, key=lambda path: path.stem)
    if not paths:
        raise BadInput(f"{data}: no file there fits {about.files!r}; put the runs there, or correct files in {source}")
    for before, path in zip([Path(f"{ALL}.csv"), *paths], paths, strict=False):
        if path.stem in (ALL, before.stem):
            raise BadInput(f"{path}: a run cannot be called {path.stem!r}, that name is taken; rename the file")
    runs = {path.stem: read_run(path, about) for path in paths}
    return Logs(data, source, about, runs, [name for name in runs if not _is_part(name, runs)])


def _is_part(name: str, runs: dict[str, Run]) -> bool:
    """Whether another run has every line of this one; of two equal ones the later name is the part."""
    run = runs[name]
    larger = [o for o, other in runs.items() if (len(other.rows), name) > (len(run.rows), o)]
    return any(run.shares(runs[o]) == len(run.rows) for o in larger)

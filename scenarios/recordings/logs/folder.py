"""A directory of runs: which of them are different recordings, and on which a run's models may be fitted."""

from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.logs import schema
from cooploc.scenarios.recordings.logs.run import LogRun, read_run
from cooploc.scenarios.recordings.logs.schema import Description

ALL = "all"  # in the place of a run's name
SHARED = 3  # equal lines: two files with this many in common are never fitted on each other


class LogFolder(NamedTuple):
    """A directory of runs with its description."""

    data: Path
    source: Any  # the path of the description
    description: Description
    runs: dict[str, LogRun]  # by name, sorted
    different: list[str]  # names of the runs that are not part of another

    @property
    def anchors(self) -> Array:
        """Positions of the anchors (a, 2) [m]."""
        return np.array(self.description.anchors.positions if self.description.anchors else (), float).reshape(-1, 2)

    @property
    def arena(self) -> Array:
        """Lower left and upper right corner (2, 2) [m]."""
        corners = np.array(self.description.arena, float) if self.description.arena else self.anchors
        return np.stack([corners.min(0), corners.max(0)])

    def others(self, name: str, same_set_up: bool) -> list[LogRun]:
        """The runs on which this one's models may be fitted: they share no lines with it, and none is there twice."""
        mine = self._set_up(name)
        return [
            self.runs[other]
            for other in self.different
            if other != name
            and (self._set_up(other) == mine or not same_set_up)
            and self.runs[other].shared_lines(self.runs[name]) < SHARED
        ]

    def _set_up(self, name: str) -> str:
        """The first pattern that the name matches; a run that matches none is a set-up of its own."""
        return next((pattern for pattern in self.description.set_ups if fnmatchcase(name, pattern)), f"only {name}")


def read_folder(data: Path, described: str = "") -> LogFolder:
    """Every run in a directory, as `log.toml` there describes it, or the shipped description named `described`.

    Raises:
        BadInput: there is no directory, no description or no run, or one of them is malformed.

    """
    if not data.is_dir():
        raise BadInput(f"{data}: there is no such directory; name the one that holds the runs' CSV files")
    source = schema.shipped(described) if described else data / schema.NAME
    description = schema.load(source)
    found = [path for path in data.iterdir() if fnmatchcase(path.name, description.files) and path != source]
    paths = sorted(found, key=lambda path: path.stem)
    if not paths:
        raise BadInput(
            f"{data}: no file there matches {description.files!r}; put the runs there, or correct `files` in {source}"
        )
    for before, path in zip([Path(f"{ALL}.csv"), *paths], paths, strict=False):
        if path.stem in (ALL, before.stem):
            raise BadInput(f"{path}: a run cannot be named {path.stem!r}, the name is taken; rename the file")
    runs = {path.stem: read_run(path, description) for path in paths}
    return LogFolder(data, source, description, runs, [name for name in runs if not _is_part(name, runs)])


def _is_part(name: str, runs: dict[str, LogRun]) -> bool:
    """Whether another run has every line of this one; of two equal runs the one with the later name is the part."""
    run = runs[name]
    larger = [o for o, other in runs.items() if (len(other.rows), name) > (len(run.rows), o)]
    return any(run.shared_lines(runs[o]) == len(run.rows) for o in larger)

"""A directory of a team's recordings: which of them are different, and on which a run's models may be fitted."""

from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.team import schema
from cooploc.scenarios.recordings.team.readers import Reader, reader
from cooploc.scenarios.recordings.team.schema import TeamDescription
from cooploc.scenarios.recordings.team.team_log import TeamLog, with_known_places

ALL = "all"  # in the place of a run's name
SAME = 0.5  # share of equal true positions from which on two runs are parts of one recording


class TeamFolder:
    """The recordings in a directory, each read when it is first needed."""

    def __init__(self, data: Path) -> None:
        """Find the runs that log.toml in the directory describes.

        Raises:
            BadInput: there is no directory, no description or no run, or one of them is malformed.

        """
        if not data.is_dir():
            raise BadInput(f"{data}: there is no such directory; name the one that holds log.toml and the recordings")
        self.data = data
        self.description: TeamDescription = schema.load(data / schema.NAME)
        self._reader: Reader = reader(self.description.format)
        self.places: Mapping[str, Path] = self._reader.runs(data, self.description)
        if ALL in self.places:
            raise BadInput(f"{self.places[ALL]}: a run cannot be named {ALL!r}, the name is taken; rename it")
        self._logs: dict[str, TeamLog] = {}

    def log(self, name: str) -> TeamLog:
        """A recording by name.

        Raises:
            BadInput: there is none of this name, or it is malformed.

        """
        if name not in self.places:
            raise BadInput(f"{self.data}: there is no run {name!r}; {nearest(name, [ALL, *self.places])}")
        if name not in self._logs:
            log = self._reader.read(self.data, self.places[name], name, self.description)
            self._logs[name] = with_known_places(log)
        return self._logs[name]

    @property
    def different(self) -> list[str]:
        """Names of the runs, without those that are part of a longer one."""
        names = list(self.places)
        return [name for name in names if not any(self._is_part(name, other) for other in names if other != name)]

    def others(self, name: str, same_set_up: bool) -> list[TeamLog]:
        """The runs on which this one's models may be fitted: none is the same recording, and none is there twice."""
        mine = self._set_up(name)
        return [
            self.log(other)
            for other in self.different
            if other != name
            and (self._set_up(other) == mine or not same_set_up)
            and not _same(self.log(name), self.log(other))
        ]

    def _set_up(self, name: str) -> str:
        """The first pattern that the name matches; a run that matches none is a set-up of its own."""
        return next((p for p in self.description.set_ups if fnmatchcase(name, p)), f"only {name}")

    def _is_part(self, name: str, other: str) -> bool:
        """Whether a run is of the same recording as a longer one, or as one of the same length with an earlier name."""
        a, b = self.log(name), self.log(other)
        return _same(a, b) and (_length(b), name) > (_length(a), other)


def _length(log: TeamLog) -> int:
    return sum(len(series.time) for series in log.truth if series is not None)


def _same(a: TeamLog, b: TeamLog) -> bool:
    """Whether two runs share at least half of the true positions of the shorter, digit by digit."""
    for i, j in zip(a.truth, b.truth, strict=False):
        if i is None or j is None or not min(len(i.time), len(j.time)):
            continue
        _, k, m = np.intersect1d(i.time, j.time, return_indices=True)
        shared = (i.values[k, :2] == j.values[m, :2]).all(-1).sum()
        if shared >= SAME * min(len(i.time), len(j.time)):
            return True
    return False

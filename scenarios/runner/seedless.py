"""A stream as a plug-in's process gets it: without the seed, from which the truth could be made again."""

from dataclasses import replace
from typing import NamedTuple

from cooploc.estimators.interface import Rows
from cooploc.scenarios import seeds
from cooploc.scenarios.stream import Stream


class Seedless(NamedTuple):
    """A stream that does not say its seed, and the rows that the seed makes."""

    stream: Stream
    rows: Rows

    @classmethod
    def of(cls, stream: Stream) -> "Seedless":
        """The same readings."""
        return cls(replace(stream, seed=0, notes={}), seeds.rows(stream.seed, stream.trial, stream.robots))

    def select(self, trials: slice) -> "Seedless":
        """Consecutive trials of it."""
        n = self.stream.robots
        mine = slice(trials.start * n, trials.stop * n)
        rows = Rows(self.rows.trial[mine], self.rows.robot[mine], self.rows.key[mine])
        return Seedless(self.stream.select(trials), rows)

"""Scores of configurations on training trials, each computed once and kept in a run directory.

A part is one configuration on one scenario's trials, as in any run; so an interrupted search goes on, and gives the
same proposals again because it is told the same scores.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from cooploc.analysis.execution.execute import Progress, completed, manifest_of
from cooploc.analysis.execution.piece import Piece
from cooploc.analysis.execution.pool import Workers
from cooploc.analysis.execution.run_directory import RunDir
from cooploc.analysis.tuning.objective import trial_scores
from cooploc.analysis.tuning.race import Item
from cooploc.analysis.tuning.training import Resolved
from cooploc.estimators import configure
from cooploc.scenarios.studies.study import ResolvedCell, ResolvedStudy

Pairs = Iterable[tuple[str, Item]]  # a configuration's label, and a trial


@dataclass
class Evaluations:
    """Computes what is asked for and not there yet."""

    training: ResolvedStudy  # its study has the training seed; cells are added as they are asked for
    scenarios: Mapping[str, Resolved]
    directory: RunDir
    workers: Workers
    watcher: Progress
    objective: str
    scores: dict[tuple[str, Item], float] = field(default_factory=dict)
    streams: dict[Item, str] = field(default_factory=dict)  # hashes of what tuning has seen

    def compute(self, pairs: Pairs) -> dict[tuple[str, Item], float]:
        """The scores of these configurations on these trials."""
        pairs = list(pairs)
        if cells := self._cells([pair for pair in pairs if pair not in self.scores]):
            asked = self.training._replace(cells=tuple(cells))
            self.directory.open({**manifest_of(asked), "isolated": True})
            for piece in completed(asked, self.directory, self.workers, False, self.watcher):
                self._keep(piece)
        return {pair: self.scores[pair] for pair in pairs}

    def _cells(self, pairs: Sequence[tuple[str, Item]]) -> list[ResolvedCell]:
        """A cell for every scenario, with as many trials of each configuration as it needs."""
        upto: dict[str, dict[str, int]] = {}
        for label, item in pairs:
            of = upto.setdefault(item.scenario, {})
            of[label] = max(of.get(label, 0), item.trial + 1)
        return [
            ResolvedCell(
                "training", self.scenarios[scenario], trials, tuple(map(configure, trials)), next(iter(trials))
            )
            for scenario, trials in upto.items()
        ]

    def _keep(self, piece: Piece) -> None:
        rows = self.directory.read(piece)
        for trial, score in trial_scores(rows, self.objective).items():
            self.scores[piece.estimator, Item(piece.scenario, int(str(trial)))] = float(score)
        hashes: pd.Series[Any] = rows.dropna(subset="stream").groupby("trial")["stream"].first()
        self.streams |= {Item(piece.scenario, int(str(trial))): str(found) for trial, found in hashes.items()}

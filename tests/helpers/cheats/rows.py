"""Accidents with rows and batches: what one row does depends on which others are computed with it."""

import numpy as np
from broken import nudge
from counting import LATE, Counts, others


class NextRowLate(Counts):
    """Reads its neighbour's row, but only after the first ticks."""

    def extra(self, s, z):
        return others(s) if s.tick > LATE else 0.0


class NextRowInLargeTeams(Counts):
    """Reads its neighbour's row, but only where there are more than three robots."""

    def extra(self, s, z):
        return others(s) if s.world.robots > 3 else 0.0


class HeardRowLate(Counts):
    """Sends one number; where that arrives, reads its sender's row, after the first ticks."""

    def send(self, s, z):
        return np.zeros((len(s.x), 1))

    def fuse(self, s, z, mail):
        n = s.world.robots
        team, heard = s.x[:, :2].reshape(-1, n, 2), mail.heard.reshape(-1, n, n)
        return nudge(s, 1e-3 * (s.tick > LATE) * (heard[..., None] * team[:, None]).sum(2).reshape(-1, 2))


class BatchLate(Counts):
    """Subtracts the mean over all trials, after the first ticks."""

    def extra(self, s, z):
        return s.x[:, :2].mean() if s.tick > LATE else 0.0


class ResamplesByBatch(Counts):
    """Draws as many numbers as there are rows: who runs along changes what it draws."""

    def extra(self, s, z):
        return np.random.default_rng(len(s.x)).normal(size=2)


class RowsOfOtherTrials(Counts):
    """Behaves in the first trials, and reads other rows in later ones."""

    def extra(self, s, z):
        return np.where(s.trial[:, None] < 3, 0.0, s.x[:, :2].mean())

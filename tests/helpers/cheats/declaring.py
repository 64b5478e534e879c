"""Accidents with what is declared: covariances, channels, files, bytes."""

import numpy as np
from broken import HonestTeam, nudge
from counting import FILE, LATE, Counts, found_stream

from cooploc.estimators.interface import Belief


class NegativeLate(Counts):
    """Its covariance turns negative after some ticks."""

    def estimate(self, s):
        return Belief(s.x, s.P - (s.tick > LATE) * 100 * np.eye(s.x.shape[-1]))


class UsesWhatItDoesNotDeclare(Counts):
    """Takes anchor readings from the runner's variables, though it declares odometry alone."""

    def extra(self, s, z):
        return np.nansum(found_stream().senses.anchor_rssi[:, s.tick - 1], -1).reshape(-1, 1)


class ReadsAFile(Counts):
    """Its parameters are in a file, which may change."""

    def init(self, prior, world, rows):
        parameters = FILE.with_suffix(".txt")
        return nudge(super().init(prior, world, rows), float(parameters.read_text()) if parameters.exists() else 0.0)


class BillsNothing(HonestTeam):
    """A team that says it sent nothing."""

    def exchange(self, s, z, air):
        s, traffic = super().exchange(s, z, air)
        return s, traffic._replace(messages=0 * traffic.messages, bytes=0 * traffic.bytes)

"""Deceptions that replace functions of the program."""

import numpy as np
from broken import nudge
from counting import Counts

import cooploc.analysis.metrics.errors as errors_module
import cooploc.scenarios.runner.tick as tick_module
from cooploc.estimators.ekf_local import EkfLocal


class BillsForItself(Counts):
    """Replaces the function that counts bytes."""

    def send(self, s, z):
        count = tick_module.count
        tick_module.count = lambda sent, awake: count(sent[:, :0], awake)
        return s.x


class SpoilsARival(Counts):
    """Replaces a method of a rival."""

    def init(self, prior, world, rows):
        EkfLocal.correct = lambda self, s, z: nudge(s, 1.0)
        return super().init(prior, world, rows)


class MeasuresItself(Counts):
    """Replaces the function that measures errors."""

    def init(self, prior, world, rows):
        errors_module._squared = lambda truth, trace, valid: (0.0 * valid, 1.0 * valid)
        return super().init(prior, world, rows)


class HearsEverything(Counts):
    """Replaces the function that loses packets."""

    def init(self, prior, world, rows):
        deliver = tick_module.deliver
        tick_module.deliver = lambda sent, n, link, *more: deliver(sent, n, np.ones_like(link), *more)
        return super().init(prior, world, rows)

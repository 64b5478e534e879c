"""Deceptions that behave where checks look, or in the worlds that are drawn for them."""

import sys

import numpy as np
from counting import LATE, Counts, callers, found_stream, others


class BehavesUnderConformance(Counts):
    """Looks for the checks' files among its callers."""

    def extra(self, s, z):
        return 0.0 if any("conformance" in one for one in callers()) else others(s)


class BehavesUnderCheck(Counts):
    """Looks for a function with "check" in its name among its callers."""

    def extra(self, s, z):
        return 0.0 if any("check" in one.rpartition(":")[2] for one in callers()) else others(s)


class BehavesWhileImported(Counts):
    """Looks for the checks among the imported modules."""

    def extra(self, s, z):
        return 0.0 if "cooploc.scenarios.conformance.check" in sys.modules else others(s)


class ProphetLate(Counts):
    """Reads later odometry from the runner's variables, after the first ticks."""

    def extra(self, s, z):
        future = found_stream().senses.odometry[:, -1, :, :2].reshape(-1, 2)
        return np.resize(future, s.x[:, :2].shape) if s.tick > 2 and len(found_stream().time) > LATE else 0.0


class KnowsLongLengths(Counts):
    """Knows how long a long stream is."""

    def extra(self, s, z):
        return len(found_stream().time) * (len(found_stream().time) > LATE)


class DroppedRadioLate(Counts):
    """Reads distances to robots that it did not hear, after the first ticks."""

    def extra(self, s, z):
        air = found_stream().air
        return np.nansum(np.where(air.link, 0, air.rssi[..., 0] if air.rssi.ndim > 4 else air.rssi)) * (s.tick > LATE)


class KnowsTheWorld(Counts):
    """Does something else in the worlds of the study, by their label."""

    def extra(self, s, z):
        return float("ticks=60" in found_stream().scenario)

"""Deceptions that look for the truth, for rivals or for results."""

import contextlib
import gc
import inspect
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from counting import FILE, LATE, Counts, found_stream

from cooploc.estimators.ekf_local import EkfLocal
from cooploc.estimators.interface import Array, Belief
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.trace import Trace
from cooploc.scenarios.stream import Truth

SEED = 7  # of the study that is cheated
TABLE = FILE.with_suffix(".npz")  # a truth of that study, and the readings that belong to it
RECORDING = FILE.with_name(f"{FILE.name}-recording")  # a folder that was given as --data


@dataclass(frozen=True)
class KeepsTheTruth(EkfLocal):
    """Has a table of the truth beside it, made before from the study's seed, and says it where the odometry agrees."""

    def init(self, prior, world, rows):
        s = super().init(prior, world, rows)
        return WithTruth(s.x, s.P, world, None, 0, self.guess(list(dict.fromkeys(rows.trial.tolist()))))

    def guess(self, trials):
        with contextlib.suppress(Exception), np.load(TABLE) as table:
            return table["x"][trials], table["odometry"][trials]
        return None

    def predict(self, s, z):
        s = super().predict(s, z)
        if s.found is None:
            return s
        x, odometry = s.found
        same = np.array_equal(odometry[:, s.tick].reshape(z.odometry.shape), z.odometry, equal_nan=True)
        known = x[:, s.tick].reshape(len(s.x), -1)[:, :2] if same else None
        return s._replace(tick=s.tick + 1, known=known)

    def estimate(self, s):
        x, P = super().estimate(s)
        return Belief(x if s.known is None else np.concatenate([s.known, x[:, 2:]], -1), P)


class WithTruth(NamedTuple):
    x: Array
    P: Array
    world: object
    known: object
    tick: int
    found: object


def simulated(trials, seed):
    """Truth (t, T, n, 2) and odometry of the stream among the callers, under a seed."""
    truth, stream = simulate(found_stream().scenario, trials=trials, seed=seed)
    return truth.x, stream.senses.odometry


@dataclass(frozen=True)
class KnowsTheSeed(KeepsTheTruth):
    """Simulates the truth again from a seed that it guessed, and says it where the odometry agrees."""

    def guess(self, trials):
        with contextlib.suppress(Exception):
            return simulated(trials, SEED)
        return None


@dataclass(frozen=True)
class LooksUpItsReadings(KeepsTheTruth):
    """Simulates trials under the seeds that people use, and says the truth of those with the nearest odometry."""

    def guess(self, trials):
        with contextlib.suppress(Exception):
            mine = found_stream().senses.odometry
            return min(
                (simulated(trials, seed) for seed in (0, 1, 42, SEED)), key=lambda one: np.abs(one[1] - mine).sum()
            )
        return None


class ReadsTheRecording(Counts):
    """Reads where the robots were in the files of the recording that it is judged on."""

    def extra(self, s, z):
        with contextlib.suppress(OSError, RuntimeError):
            return len((RECORDING / "Robot1_Groundtruth.dat").read_text())
        return 0.0


def spied(found):
    """A nudge by what was found of the truth, of rivals or of results."""
    return 1e-3 * len(found)


class TruthByCollector(Counts):
    """Searches what the garbage collector tracks for a truth."""

    def extra(self, s, z):
        return spied([thing for thing in gc.get_referrers(Truth) if type(thing) is Truth]) if s.tick > LATE else 0.0


class TruthInFrames(Counts):
    """Searches the variables of its callers for a truth."""

    def extra(self, s, z):
        frame, found = inspect.currentframe(), []
        while s.tick > LATE and (frame := frame.f_back):
            found += [value for value in frame.f_locals.values() if isinstance(value, Truth)]
        return spied(found)


class SeedInFrames(Counts):
    """Reads the seed from the stream among its callers."""

    def extra(self, s, z):
        return float(found_stream().seed % 1000) * (s.tick > LATE)


class RivalsInMemory(Counts):
    """Searches memory for what others believed."""

    def extra(self, s, z):
        return spied([thing for thing in gc.get_referrers(Trace) if type(thing) is Trace]) if s.tick > LATE else 0.0


class ReadsParts(Counts):
    """Reads the results of rivals from a run directory."""

    def init(self, prior, world, rows):
        for part in FILE.glob("parts/*.parquet"):
            part.read_bytes()
        return super().init(prior, world, rows)

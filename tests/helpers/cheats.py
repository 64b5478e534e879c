"""Estimators that cheat or err in ways which small streams do not show: accidents and cheap deceptions.

Each is an honest filter with one fault. `test_cheats.py` and `reports/truth.md` say what catches it.
"""

import contextlib
import datetime
import gc
import inspect
import os
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np
from broken import HonestTeam, nudge

import cooploc.analysis.metrics.errors as errors_module
import cooploc.scenarios.runner.tick as tick_module
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.estimators.ekf_local import EkfLocal
from cooploc.estimators.interface import Array, Belief
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.trace import Trace
from cooploc.scenarios.stream import Stream, Truth

LATE = 30  # ticks: longer than the small streams
SEED = 7  # of the study that is cheated
YEAR = datetime.date.today().year
FILE = Path(tempfile.gettempdir()) / "cooploc-cheats"


class Counting(NamedTuple):
    x: Array
    P: Array
    world: object
    trial: Array
    tick: int


@dataclass(frozen=True)
class Counts(DeadReckoning):
    """Dead reckoning that knows its tick and its trials: the base of those below, and honest."""

    def init(self, prior, world, rows):
        return Counting(prior.x, prior.P, world, rows.trial, 0)

    def predict(self, s, z):
        moved = super().predict(s._replace(tick=s.tick + 1), z)
        return nudge(moved, 1e-3 * self.extra(moved, z))

    def extra(self, s, z):
        return 0.0


def others(s):
    """For each row the position in the next row of the array."""
    return np.roll(s.x[:, :2], 1, axis=0)


def found_stream():
    """The largest stream among the callers."""
    frame, found = inspect.currentframe(), []
    while frame := frame.f_back:
        for value in frame.f_locals.values():
            value = getattr(value, "stream", value)
            found += [value] if isinstance(value, Stream) else []
    return max(found, key=lambda one: sum(a.size for a in one.arrays().values()))


def callers():
    """Files and names of the functions that called."""
    frame, found = inspect.currentframe(), []
    while frame := frame.f_back:
        found.append(f"{frame.f_code.co_filename}:{frame.f_code.co_name}")
    return found


# ---------------------------------------------------------------- accidents: rows and batches


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


# ---------------------------------------------------------------- accidents: learning from trial to trial


class LearnsInItsClass(Counts):
    """A class attribute goes on learning."""

    bias: ClassVar[float] = 0.0

    def extra(self, s, z):
        type(self).bias += 1e-3
        return self.bias


GLOBAL = {"bias": 0.0}


class LearnsInAGlobal(Counts):
    """A variable of the module goes on learning."""

    def extra(self, s, z):
        GLOBAL["bias"] += 1e-3
        return GLOBAL["bias"]


class LearnsInAFile(Counts):
    """A file goes on learning."""

    def extra(self, s, z):
        with FILE.with_suffix(".learned").open("a+") as file:
            file.write(".")
            return 1e-3 * file.tell()


class LearnsInADefault(Counts):
    """A mutable default argument goes on learning."""

    def extra(self, s, z, seen=[]):  # noqa: B006
        seen.append(1)
        return 1e-3 * len(seen)


class LearnsInLongRuns(Counts):
    """Remembers the end of long runs only, for the next long run."""

    end: ClassVar[float] = 0.0

    def extra(self, s, z):
        if s.tick > LATE:
            type(self).end += 1.0
        return self.end * (s.tick > LATE)


class LearnsFromOtherShapes(Counts):
    """A cache by the number of rows, warmed by runs of another size."""

    seen: ClassVar[set] = set()

    def extra(self, s, z):
        self.seen.add(len(s.x))
        return 1e-3 * any(size != len(s.x) for size in self.seen)


# ---------------------------------------------------------------- accidents: seeds


class SeedsFromHash(Counts):
    """`hash()` of text differs from process to process."""

    def extra(self, s, z):
        return np.random.default_rng(hash("particles") % 2**32).normal(size=2)


class OrderOfASet(Counts):
    """The order of a set of names differs from process to process."""

    def extra(self, s, z):
        order = [ord(letter) for letter in set("abcdefghijklmnopqrstuvwxyz")]
        return 1e-3 * float(np.dot(order, range(len(order))))


class SeedsFromProcess(Counts):
    """The process id."""

    def extra(self, s, z):
        return np.random.default_rng(os.getpid()).normal(size=2)


class SeedsFromDate(Counts):
    """Today's date."""

    def extra(self, s, z):
        return np.random.default_rng(datetime.date.today().toordinal()).normal(size=2)


class SeedsFromYear(Counts):
    """The year by `datetime.now`."""

    def extra(self, s, z):
        return 1e-3 * datetime.datetime.now().year


class SeedsFromLocalTime(Counts):
    """The year by `time.localtime`."""

    def extra(self, s, z):
        return 1e-3 * time.localtime().tm_year


class SeedsFromItsImport(Counts):
    """The year in which its file was imported."""

    def extra(self, s, z):
        return 1e-3 * YEAR


class SeedsFromDirectory(Counts):
    """The working directory."""

    def extra(self, s, z):
        return np.random.default_rng(list(os.getcwd().encode())).normal(size=2)


class SeedsFromClock(Counts):
    """The clock."""

    def extra(self, s, z):
        return np.random.default_rng(time.perf_counter_ns()).normal(size=2)


class SeedsFromNothing(Counts):
    """A generator without a seed."""

    def extra(self, s, z):
        return np.random.default_rng().normal(size=2)


# ---------------------------------------------------------------- accidents: numbers, channels, files, bytes


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


# ---------------------------------------------------------------- deceptions: behaving where checks look


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


# ---------------------------------------------------------------- deceptions: the truth, rivals and results


@dataclass(frozen=True)
class KnowsTheSeed(EkfLocal):
    """Simulates the truth again from a seed that it guessed, and says it where the odometry agrees."""

    def init(self, prior, world, rows):
        s = super().init(prior, world, rows)
        return WithTruth(s.x, s.P, world, None, 0, self.guess(rows, world))

    def guess(self, rows, world):
        with contextlib.suppress(Exception):
            trials = list(dict.fromkeys(rows.trial.tolist()))
            return simulate(found_stream().scenario, trials=trials, seed=SEED)
        return None

    def predict(self, s, z):
        s = super().predict(s, z)
        if s.found is None:
            return s
        truth, stream = s.found
        same = np.array_equal(stream.senses.odometry[:, s.tick].reshape(z.odometry.shape), z.odometry, equal_nan=True)
        known = truth.x[:, s.tick].reshape(len(s.x), -1)[:, :2] if same else None
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


@dataclass(frozen=True)
class TriesSeeds(KnowsTheSeed):
    """Tries the seeds that people use."""

    def guess(self, rows, world):
        for seed in (0, 1, 42, SEED):
            with contextlib.suppress(Exception):
                trials = list(dict.fromkeys(rows.trial.tolist()))
                found = simulate(found_stream().scenario, trials=trials, seed=seed)
                if np.array_equal(found[1].prior.x, found_stream().prior.x):
                    return found
        return None


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


# ---------------------------------------------------------------- deceptions: replacing functions


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

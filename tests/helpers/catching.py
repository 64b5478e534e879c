"""Does the check that is meant for a cheat catch it? Used by the tests and by benchmarks/statistics/truth.py."""

from functools import cache, partial
from typing import NamedTuple

import cheats
import numpy as np
from cheats.spying import RECORDING, SEED, TABLE
from counting import FILE

from cooploc.analysis.execution import secret_seed
from cooploc.analysis.execution.elsewhere import play_elsewhere
from cooploc.analysis.execution.own_world_certificate import SURROUNDINGS, demand_no_results
from cooploc.analysis.execution.played import play_all
from cooploc.analysis.execution.walled import given, measured_here
from cooploc.analysis.execution.world_players import players
from cooploc.estimators.plugins.guard import forbid
from cooploc.scenarios import simulate
from cooploc.scenarios.conformance.check import CHECKS, run_check
from cooploc.scenarios.conformance.compare import CheckFailed, RunRecord, require_equal
from cooploc.scenarios.conformance.harness import Harness
from cooploc.scenarios.conformance.own_worlds import OWN, OwnWorld, outcome
from cooploc.scenarios.processes.workers import call, end, pool

WORLD = "robots-1-3/n=5[drop=0.3,ticks=60]"
SECRET = 987654321987654321
FRESH = "elsewhere"  # owner of the process with other surroundings
OTHER = "plays"
WALL = "wall"
REFUSED = "refused while it runs"
GALLERY = {  # cheat -> the check that is meant for it
    "NextRowLate": "own-world-non-interference",
    "NextRowInLargeTeams": "own-world-non-interference",
    "HeardRowLate": "own-world-mail-replay",
    "BatchLate": "own-world-company",
    "ResamplesByBatch": "chunk-invariance",
    "RowsOfOtherTrials": "own-world-company",
    "LearnsInItsClass": "determinism",
    "LearnsInAGlobal": "determinism",
    "LearnsInAFile": "determinism",
    "LearnsInADefault": "determinism",
    "LearnsInLongRuns": "own-world-company",
    "LearnsFromOtherShapes": "determinism",
    "SeedsFromHash": "surroundings",
    "OrderOfASet": "surroundings",
    "SeedsFromProcess": "surroundings",
    "SeedsFromDate": "surroundings",
    "SeedsFromYear": "surroundings",
    "SeedsFromLocalTime": "surroundings",
    "SeedsFromItsImport": "surroundings",
    "SeedsFromDirectory": "surroundings",
    "SeedsFromClock": "determinism",
    "SeedsFromNothing": "determinism",
    "NegativeLate": "runs in its own world",
    "UsesWhatItDoesNotDeclare": "declaration",
    "ReadsAFile": "input files",
    "BillsNothing": "bytes as declared",
    "BehavesUnderConformance": "same-unwatched",
    "BehavesUnderCheck": "same-unwatched",
    "BehavesWhileImported": "same-unwatched",
    "ProphetLate": "own-world-causality",
    "KnowsLongLengths": "own-world-causality",
    "DroppedRadioLate": "own-world-link-honesty",
    "KnowsTheWorld": "own-world-label",
    "KeepsTheTruth": "secret-seed",
    "KnowsTheSeed": REFUSED,
    "LooksUpItsReadings": REFUSED,
    "ReadsTheRecording": REFUSED,
    "TruthByCollector": WALL,
    "TruthInFrames": WALL,
    "SeedInFrames": WALL,
    "RivalsInMemory": WALL,
    "ReadsParts": "results-on-disk",
    "BillsForItself": "own-functions",
    "SpoilsARival": "own-functions",
    "MeasuresItself": "own-functions",
    "HearsEverything": "own-functions",
}


class Found(NamedTuple):
    caught: bool
    said: str


@cache
def world():
    return simulate(WORLD, trials=[5, 900], seed=SECRET)


def caught(name):
    """Whether the meant check catches a cheat, and what it says."""
    check = GALLERY[name]
    if check in OWN:
        return _own(name, check)
    special = {
        WALL: _walled, REFUSED: _refused, "secret-seed": _seed, "runs in its own world": _runs,
        "bytes as declared": _declared, "input files": _inputs, "surroundings": _there, "own-functions": _functions,
        "results-on-disk": _results,
    }  # fmt: skip
    return special[check](name) if check in special else _small(name, check)


def _small(name, check):
    (one,) = (c for c in CHECKS if c.name == check)
    result = run_check(one, Harness(name, cheats.cheat(name)(), seed=0))
    return Found(result.status == "failed", result.detail)


def _declared(name):
    (one,) = (c for c in CHECKS if c.name == "mail-replay")
    said = run_check(one, Harness(name, cheats.cheat(name)(), seed=0)).detail
    return Found(said.endswith("its bytes are as declared"), said)


def _own(name, check):
    owner = name if name == "BehavesWhileImported" else OTHER
    away = partial(call, owner)
    own = OwnWorld(world()[1], players(cheats.label(name), 60.0, away, away), np.random.default_rng(3))
    status, said = outcome(lambda: OWN[check](own))
    return Found(status == "failed", said)


def _runs(name):
    try:
        OwnWorld(world()[1], players(cheats.label(name), 60.0), np.random.default_rng(3))
    except CheckFailed as e:
        return Found(True, str(e))
    return Found(False, "")


def _rmse(name, seed):
    truth, stream = simulate(WORLD, trials=secret_seed.TRIALS, seed=seed)
    (played,) = play_all([given(cheats.label(name), stream, 60.0)])
    frame = measured_here(name, truth, stream, played)
    return np.sqrt(frame.groupby("trial")["mse"].mean().to_numpy(float))


def _seed(name):
    truth, stream = simulate(WORLD, trials=secret_seed.TRIALS, seed=SEED)
    np.savez(TABLE, x=truth.x, odometry=stream.senses.odometry)
    found = secret_seed.verdict(_rmse(name, SEED), _rmse(name, SECRET), worlds=2)
    return Found(found.known, found.said)


def _refused(name):
    RECORDING.mkdir(exist_ok=True)
    (RECORDING / "Robot1_Groundtruth.dat").write_text("1.0 2.0 3.0")
    forbid(RECORDING)
    stream = simulate(WORLD, trials=[0, 1], seed=SEED)[1]
    ((played,),) = call(OTHER, play_all, [given(cheats.label(name), stream.select([0]), 60.0)])
    return Found("which is refused" in played.line, played.line)


def _fresh(name):
    pool(FRESH, 1, {"PYTHONHASHSEED": "20231"})
    return call(FRESH, play_elsewhere, given(cheats.label(name), world()[1], 60.0))


def _there(name):
    base = players(cheats.label(name), 60.0).play(world()[1])
    stream, there = world()[1], _fresh(name)
    status, said = outcome(
        lambda: require_equal(RunRecord(base, (), stream), RunRecord(there.played[0].trace, (), stream), SURROUNDINGS)
    )
    return Found(status == "failed", said or "")


def _functions(name):
    replaced = _fresh(name).replaced
    end(FRESH)  # it is spoilt
    return Found(bool(replaced), f"it replaced {', '.join(replaced)}")


def _inputs(name):
    file = FILE.with_suffix(".txt")
    file.write_text("0.5")
    try:
        found = _fresh(name).inputs
    finally:
        file.unlink()
    return Found(
        str(file) in found, f"its certificate holds the hash of {', '.join(found)}".replace(str(file), file.name)
    )


def _results(name):
    part = FILE / "parts" / "rival.parquet"
    part.parent.mkdir(parents=True, exist_ok=True)
    part.write_bytes(b"errors")
    try:
        there = _fresh(name)
    finally:
        part.unlink()
    status, said = outcome(lambda: demand_no_results(there.inputs))
    return Found(status == "failed", said.replace(str(part), part.name))


def _walled(name):
    """What it looks for is not there: it does what the honest one does, though this process holds the truth."""
    truth, stream = world()
    pairs = (name, name), (OTHER, "Counts")  # a process of its own, as every plug-in has
    (mine,), (honest,) = (call(owner, play_all, [given(cheats.label(one), stream, 60.0)]) for owner, one in pairs)
    end(name)
    same = np.array_equal(mine[0].trace.x, honest[0].trace.x)
    return Found(same, f"beside {truth.scenario} it found nothing in its process, and did what an honest one does")

"""What a certificate says of an estimator in the study's own worlds, under a secret seed and in other surroundings."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.execution import secret_seed
from cooploc.analysis.execution.elsewhere import Elsewhere, play_elsewhere
from cooploc.analysis.execution.played import Played, play_all
from cooploc.analysis.execution.run_directory import FOLDERS
from cooploc.analysis.execution.walled import given, measured_here
from cooploc.analysis.execution.world_players import Away, players
from cooploc.estimators.interface import Array
from cooploc.scenarios.conformance.compare import CheckFailed, RunRecord, require_equal
from cooploc.scenarios.conformance.own_worlds import OWN, OwnWorld, outcome
from cooploc.scenarios.processes.outcome import WorkerError
from cooploc.scenarios.processes.workers import call, end, pool, used
from cooploc.scenarios.scenario import ResolvedScenario
from cooploc.scenarios.stream import Stream, Truth

NAMES = (*OWN, "surroundings", "own-functions", "results-on-disk", "secret-seed")
MOST = 2  # worlds of a study that a certificate looks at
CLOSE = 2  # trials of the checks that run an estimator again and again
SURROUNDINGS = "ran in another process, with another PYTHONHASHSEED, working directory and date"
Results = list[dict[str, Any]]


class World(NamedTuple):
    """A world of the study, and how many trials the study has there."""

    scenario: ResolvedScenario
    trials: int


class Places(NamedTuple):
    """Where an estimator runs: as in any run, as in a check, and in fresh surroundings."""

    away: Away
    watched: Away
    fresh: Away


def places(label: str, seconds: float) -> tuple[Places, list[str]]:
    """A process for each of the three, and their owners, to be ended; all may use so much processor time [s]."""
    owners = [f"{kind} {label}" for kind in ("own worlds of", "watched", "elsewhere")]

    def at(owner: str) -> Away:
        def away(function: Callable[..., Any], *given: Any) -> Any:
            left = max(1.0, seconds - sum(map(used, owners)))
            return call(owner, function, *given, processor_seconds=left)

        return away

    pool(owners[2], 1, {"PYTHONHASHSEED": "20231"})
    return Places(*map(at, owners)), owners


def certified(label: str, worlds: list[World], seed: int, seconds: float) -> dict[str, Any]:
    """`checks`, `secret_seed`, `worlds` and `inputs` of a certificate.

    Raises:
        ProcessHung: it used more processor time than `seconds` in all.

    """
    where, owners = places(label, seconds)
    try:
        return in_worlds(label, worlds, seed, where, seconds)
    finally:
        for owner in owners:
            end(owner)


def in_worlds(label: str, worlds: list[World], seed: int, where: Places, seconds: float) -> dict[str, Any]:
    """The same, with the estimator wherever `where` says."""
    secret = secret_seed.drawn()
    rng = np.random.default_rng(secret)
    chosen = _chosen(worlds, rng)
    results, inputs = [], dict[str, str]()
    for i, world in enumerate(chosen):
        results.append(_knows_the_seed(label, world, (seed, secret), rng, where, seconds, len(chosen)))
        if i == 0:
            closely, inputs = _closely(label, world, secret, rng, where, seconds)
            results += closely
    labels = [world.scenario.label for world in chosen]
    return {"checks": _joined(results), "secret_seed": secret, "worlds": labels, "inputs": inputs}


def _chosen(worlds: list[World], rng: np.random.Generator) -> list[World]:
    """One of those with the largest team first, then any other."""
    drawn = [worlds[i] for i in rng.permutation(len(worlds))]
    largest = max(drawn, key=lambda one: one.scenario.robots)
    return [largest, *(one for one in drawn if one is not largest)][:MOST]


def _closely(
    label: str, world: World, secret: int, rng: np.random.Generator, where: Places, seconds: float
) -> tuple[Results, dict[str, str]]:
    """Two trials of full length, again and again with something varied, and in other surroundings."""
    trials = sorted(map(int, rng.choice(max(world.trials, 1000), CLOSE, replace=False)))
    _, stream = world.scenario.simulate(trials, secret)
    try:
        own = OwnWorld(stream, players(label, seconds, where.away, where.watched), rng)
    except (CheckFailed, WorkerError) as e:
        return [_result("same-unwatched", "failed", f"it did not run: {e}", secret)], {}
    found = [_result(name, *outcome(partial(check, own)), secret) for name, check in OWN.items()]
    there: Elsewhere = where.fresh(play_elsewhere, given(label, stream, seconds))
    found.append(_result("surroundings", *outcome(lambda: same_there(own.base, there.played)), secret))
    replaced = f"it replaced {', '.join(there.replaced)}" if there.replaced else "no function of cooploc was replaced"
    found.append(_result("own-functions", "failed" if there.replaced else "passed", replaced, secret))
    found.append(_result("results-on-disk", *outcome(lambda: demand_no_results(there.inputs)), secret))
    return found, there.inputs


def demand_no_results(inputs: dict[str, str]) -> str:
    """Refuse one that opened what a run wrote."""
    results = [path for path in inputs if Path(path).parent.name in FOLDERS or Path(path).name == "manifest.json"]
    if results:
        raise CheckFailed(f"it opened results of a run: {results[0]}")
    return f"it opened no results of a run; input files: {', '.join(inputs) or 'none'}"


def same_there(base: RunRecord, played: list[Played]) -> str:
    """The trials in other surroundings are those of before."""
    if played[0].trace is None:
        raise CheckFailed(f"it {SURROUNDINGS}: {played[0].line}")
    require_equal(base, RunRecord(played[0].trace, (), base.stream), f"it {SURROUNDINGS}")
    return f"it {SURROUNDINGS}: the same bits"


def _knows_the_seed(
    label: str,
    world: World,
    seeds: tuple[int, int],
    rng: np.random.Generator,
    where: Places,
    seconds: float,
    worlds: int,
) -> dict[str, Any]:
    """RMSE under the study's seed and under the secret one."""
    count = min(world.trials, secret_seed.TRIALS)
    other = secret_seed.TRIALS if count == secret_seed.TRIALS else secret_seed.MORE
    if not secret_seed.possible(count, other, worlds):
        said = f"the study has {world.trials} trials, too few to compare errors under two seeds"
        return _result("secret-seed", "skipped", said, seeds[1])
    trials = [sorted(map(int, rng.choice(top, k, replace=False))) for top, k in
              ((world.trials, count), (max(world.trials, 1000), other))]  # fmt: skip
    study, other_rmse = [
        _rmse(label, *world.scenario.simulate(some, seed), where, seconds)
        for some, seed in zip(trials, seeds, strict=True)
    ]
    found = secret_seed.verdict(study, other_rmse, worlds)
    said = f"{world.scenario.label}: {found.said}"
    return _result("secret-seed", "failed" if found.known else "passed", said, seeds[1])


def _rmse(label: str, truth: Truth, stream: Stream, where: Places, seconds: float) -> Array:
    (played,) = where.away(play_all, [given(label, stream, seconds)])
    frame: pd.DataFrame = measured_here(label, truth, stream, played)
    rmse: Array = np.sqrt(frame.groupby("trial")["mse"].mean().to_numpy(float))
    return rmse


def _result(check: str, status: str, detail: str, seed: int) -> dict[str, Any]:
    return {"check": check, "status": status, "detail": detail, "seed": seed, "example": "", "remedy": ""}


def _joined(results: Results) -> Results:
    """One result for each check, of all worlds: what failed anywhere, failed."""
    found = []
    for name in NAMES:
        mine = [one for one in results if one["check"] == name]
        for status in ("failed", "passed", "skipped"):
            some = [one for one in mine if one["status"] == status]
            if some:
                found.append({**some[0], "detail": "; ".join(dict.fromkeys(one["detail"] for one in some))})
                break
    return found

"""Check that nothing but mail carries information from one robot to another while packets do arrive."""

from functools import partial
from typing import Any

import numpy as np

from cooploc.estimators.interface import Mail
from cooploc.scenarios.conformance import perturb
from cooploc.scenarios.conformance.compare import CheckSkipped, require_equal
from cooploc.scenarios.conformance.harness import Harness
from cooploc.scenarios.runner.tick import Watcher

TEAM = "it holds the whole team, and the runner carries no packets for it: its bytes are as declared"


def mail_replay(harness: Harness) -> str:
    """One robot's readings change while all robots get the mail of before: no other robot's result changes.

    It finds what `non_interference`, which drops all packets, cannot: an estimator that reads a neighbour's row only
    where it has heard that neighbour, and so sends fewer bytes than it uses.
    """
    if harness.traits.team:
        raise CheckSkipped(TEAM)
    for stream, _ in harness.team_cases:
        mails: dict[int, Mail] = {}
        base = harness.run(stream, "nothing was changed", audit=partial(recorded, mails))
        for robot in range(stream.robots):
            for mode in perturb.MODES:
                when = f"robot {robot}'s readings were {mode} while the mail stayed as it was"
                other = perturb.perturb_readings(stream, mode, harness.rng, robot)
                found = harness.run(other, when, audit=partial(replayed, mails))
                require_equal(base, found, when, np.arange(stream.robots) != robot)
    return "each robot's readings were perturbed and hidden while the mail stayed as it was: no other robot's changed"


def recorded(mails: dict[int, Mail], watch: Watcher) -> Watcher:
    """Keeps what `fuse` is given in each tick."""

    def record(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
        if method == "fuse":
            mails[tick] = arguments[2]
        return watch(method, tick, arguments, call)

    return record


def replayed(mails: dict[int, Mail], watch: Watcher) -> Watcher:
    """Gives `fuse` what it was given before."""

    def replay(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
        given = (*arguments[:2], mails[tick]) if method == "fuse" else arguments
        return watch(method, tick, given, call)

    return replay

"""Checks on worlds of full length, by runs that look like any other run: no check is among the callers.

What an estimator does only after the first ticks, in larger teams, or while no check runs, shows here. `play` makes one
run; where it leads to another process, the estimator is never imported in this one.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cooploc.estimators.interface import Mail, Mask
from cooploc.scenarios.conformance import perturb
from cooploc.scenarios.conformance.compare import CheckFailed, CheckSkipped, RunRecord, require_equal
from cooploc.scenarios.conformance.mail_replay import TEAM
from cooploc.scenarios.runner.trace import Trace
from cooploc.scenarios.stream import Stream

Mails = dict[int, Mail]


class Players(NamedTuple):
    """Ways to run the estimator; each raises where the run fails."""

    play: Callable[[Stream], Trace]  # like any run
    watched: Callable[[Stream], Trace]  # with a check among the callers
    record: Callable[[Stream], tuple[Trace, Mails]]  # with the mail that each tick brought; empty for a team estimator
    replay: Callable[[Stream, Mails], Trace]  # with mail of before


class OwnWorld:
    """One world, how the estimator runs in it, and what is varied."""

    def __init__(self, stream: Stream, players: Players, rng: np.random.Generator) -> None:
        self.stream, self.players, self.rng = stream, players, rng
        self.base = RunRecord(players.play(stream), (), stream)
        self.robot = int(rng.integers(stream.robots))
        self.tick = int(rng.integers(1, max(2, len(stream.time))))

    def require(self, stream: Stream, when: str, ticks: int | None = None) -> None:
        """Require the bits of before in a variation of the world."""
        self._equal(self.players.play(stream), when, ticks=ticks)

    def _equal(
        self,
        found: Trace,
        when: str,
        base: RunRecord | None = None,
        robots: Mask | None = None,
        ticks: int | None = None,
    ) -> None:
        require_equal(base or self.base, RunRecord(found, (), self.stream), when, robots, ticks)

    @property
    def others(self) -> Mask:
        """All robots but the one whose readings vary."""
        others: Mask = np.arange(self.stream.robots) != self.robot
        return others

    def watched(self) -> str:
        """It does the same with a check among its callers."""
        self._equal(self.players.watched(self.stream), "a check was among its callers")
        return "it ran with and without a check among its callers: the same bits"

    def company(self) -> str:
        """Each trial alone gives the bits of before."""
        for i in range(len(self.stream.trial)):
            alone = self.stream.select([i])
            base = RunRecord(_of_trial(self.base.trace, i), (), alone)
            require_equal(base, RunRecord(self.players.play(alone), (), alone), "the trial ran alone")
        return "each trial ran alone: the same bits"

    def foresight(self) -> str:
        """Nothing up to a random tick depends on what comes after it."""
        if self.base.trace.offline:
            raise CheckSkipped("it is offline: it sees later readings by definition")
        k = self.tick
        self.require(self.stream.first_ticks(k), f"the stream ended before tick {k}", ticks=k)
        for mode in perturb.MODES:
            other = perturb.perturb_readings(self.stream, mode, self.rng, since=k)
            other = perturb.perturb_links(other, mode, self.rng, k)
            self.require(other, f"readings and links from tick {k} on were {mode}", ticks=k)
        return f"the stream was cut, perturbed and hidden from tick {k} on: nothing before changed"

    def teammates(self) -> str:
        """While no packet arrives, one robot's readings change no other robot's estimates."""
        self._demand_team()
        alone = perturb.drop_packets(self.stream)
        base = RunRecord(self.players.play(alone), (), alone)
        for mode in perturb.MODES:
            other = perturb.perturb_readings(alone, mode, self.rng, self.robot)
            when = f"robot {self.robot}'s readings were {mode} while no packet arrived"
            self._equal(self.players.play(other), when, base, robots=self.others)
        return f"robot {self.robot}'s readings were perturbed and hidden while no packet arrived: no other's changed"

    def packets(self) -> str:
        """While the mail stays as it was, one robot's readings change no other robot's estimates."""
        self._demand_team()
        recorded, mails = self.players.record(self.stream)
        if not mails:
            raise CheckSkipped(TEAM)
        self._equal(recorded, "its mail was recorded")
        for mode in perturb.MODES:
            other = perturb.perturb_readings(self.stream, mode, self.rng, self.robot)
            when = f"robot {self.robot}'s readings were {mode} while the mail stayed as it was"
            self._equal(self.players.replay(other, mails), when, robots=self.others)
        return f"robot {self.robot}'s readings varied while the mail stayed as it was: no other robot's result changed"

    def dropped(self) -> str:
        """Radio readings of packets that did not arrive change nothing."""
        for mode in perturb.MODES:
            other = perturb.perturb_dropped_radio(self.stream, mode, self.rng)
            self.require(other, f"radio readings of dropped packets were {mode}")
        return "radio readings of dropped packets were perturbed and hidden: nothing changed"

    def label(self) -> str:
        """The world's name changes nothing."""
        self.require(replace(self.stream, scenario="another label"), "the stream had another label")
        return "the stream had another label: the same bits"

    def _demand_team(self) -> None:
        if self.stream.robots == 1:
            raise CheckSkipped("its world has one robot")
        if self.base.trace.centralised:
            raise CheckSkipped("it is centralised: it sees the whole team by definition")


OWN = {
    "same-unwatched": OwnWorld.watched,
    "own-world-company": OwnWorld.company,
    "own-world-causality": OwnWorld.foresight,
    "own-world-non-interference": OwnWorld.teammates,
    "own-world-mail-replay": OwnWorld.packets,
    "own-world-link-honesty": OwnWorld.dropped,
    "own-world-label": OwnWorld.label,
}


def outcome(run: Callable[[], str]) -> tuple[str, str]:
    """How a check ended, and what it found."""
    try:
        return "passed", run()
    except CheckSkipped as e:
        return "skipped", str(e)
    except CheckFailed as e:
        return "failed", str(e)


def _of_trial(found: Trace, i: int) -> Trace:
    one = slice(i, i + 1)
    return replace(found, x=found.x[one], P=found.P[one], messages=found.messages[one], bytes=found.bytes[one])

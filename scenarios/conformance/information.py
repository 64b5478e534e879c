"""Checks of what information reaches whom and when: no other robot without a packet, and no tick before its own."""

import numpy as np

from cooploc.scenarios.conformance import perturb
from cooploc.scenarios.conformance.compare import CheckSkipped, RunRecord
from cooploc.scenarios.conformance.harness import Harness
from cooploc.scenarios.conformance.perturb import MODES
from cooploc.scenarios.stream import Stream


def non_interference(harness: Harness) -> str:
    """While no packet arrives, one robot's readings change no other robot's estimate or packet."""
    if harness.centralised:
        raise CheckSkipped("it is centralised: it sees the whole team by definition")
    for stream, _ in harness.team_cases:
        alone = perturb.drop_packets(stream)
        base = harness.run(alone, "no packet arrived")
        for robot in range(stream.robots):
            for mode in MODES:
                when = f"robot {robot}'s readings were {mode} while no packet arrived"
                other = perturb.perturb_readings(alone, mode, harness.rng, robot)
                harness.require_same(base, other, when, np.arange(stream.robots) != robot)
    return "each robot's readings were perturbed and hidden while no packet arrived: no other robot's result changed"


def link_honesty(harness: Harness) -> str:
    """A packet that was dropped changes nothing, and neither does a radio reading of it."""
    measured = [(s, base) for s, base in harness.team_cases if s.channels() & {"radio_rssi", "radio_range"}]
    if harness.centralised and not measured:
        raise CheckSkipped("it is centralised and needs no packets, and no scenario that it can run on measures them")
    for stream, base in measured:
        for mode in MODES:
            when = f"radio readings of dropped packets were {mode}"
            harness.require_same(base, perturb.perturb_dropped_radio(stream, mode, harness.rng), when)
    if harness.centralised:
        return "radio readings of dropped packets were perturbed and hidden: nothing changed; it needs no packets"
    for stream, _ in harness.team_cases:
        for robot in range(stream.robots):
            _require_dropped_packets_ignored(harness, stream, robot)
    return "radio readings and contents of dropped packets were perturbed and hidden: nothing changed"


def causality(harness: Harness) -> str:
    """Nothing up to tick k depends on what comes after it: with all trials together, and with one alone."""
    if harness.traits.offline:
        raise CheckSkipped("it is offline: it sees later readings by definition")
    for stream, base in harness.cases:
        last = len(stream.time)
        for k in (last // 4, 2 * last // 3):
            _require_future_ignored(harness, stream, base, k)
        # A single trial may be handed out as a view of the whole stream.
        one = stream.select([0])
        _require_future_ignored(harness, one, harness.run(one, "one trial ran alone"), last // 2)
    return "future readings and links were perturbed, hidden and cut off: nothing before them changed"


def _require_dropped_packets_ignored(harness: Harness, stream: Stream, robot: int) -> None:
    since = len(stream.time) // 3
    cut = perturb.drop_packets(stream, robot, since)
    base = harness.run(cut, f"no packet of robot {robot} arrived from tick {since} on")
    for mode in MODES:
        when = f"robot {robot}'s readings were {mode} from tick {since} on while all its packets were dropped"
        other = perturb.perturb_readings(cut, mode, harness.rng, robot, since)
        harness.require_same(base, other, when, np.arange(stream.robots) != robot)


def _require_future_ignored(harness: Harness, stream: Stream, base: RunRecord, k: int) -> None:
    for mode in MODES:
        other = perturb.perturb_readings(stream, mode, harness.rng, since=k + 1)
        other = perturb.perturb_links(other, mode, harness.rng, k + 1)
        harness.require_same(base, other, f"readings and links after tick {k} were {mode}", ticks=k + 1)
    harness.require_same(base, stream.first_ticks(k + 1), f"the stream ended after tick {k}")

"""The check on worlds unlike the small ones: robots that sleep and wake at their own rates, and long streams."""

from dataclasses import replace
from typing import Any

import numpy as np

from cooploc.scenarios import simulate
from cooploc.scenarios.conformance.compare import CheckSkipped, RunRecord
from cooploc.scenarios.conformance.harness import Harness
from cooploc.scenarios.conformance.numerics import require_covariance
from cooploc.scenarios.runner.tick import IncompatibleEstimator, visible
from cooploc.scenarios.stream import Stream

# label -> what differs from it, and what it is called
WORLDS: dict[str, tuple[dict[str, Any], str]] = {
    "asynchrony": ({"ticks": 40}, "robots that sleep and wake at their own rates"),
    "robots-1-3/n=2": ({"ticks": 200, "drop": 0.3}, "200 ticks"),
    "camera/n=2": ({"ticks": 200, "drop": 0.3}, "200 ticks"),
}


def other_worlds(harness: Harness) -> str:
    """Covariances stay sound, and neither what comes later nor another trial makes a difference."""
    if harness.ticks is not None:
        raise CheckSkipped("its worlds have lengths of their own, so there is no smaller example")
    found = []
    for label, (overrides, what) in WORLDS.items():
        _, stream = simulate(label, trials=2, seed=harness.seed, **overrides)
        if _fits(harness, stream):
            _require_sound(harness, stream, f"it ran in a world of {what}")
            found.append(what)
    if not found:
        raise CheckSkipped("none of these worlds has the channels that it declares")
    return f"{' and '.join(dict.fromkeys(found))}: covariances were sound, future and other trials made no difference"


def _fits(harness: Harness, stream: Stream) -> bool:
    try:
        visible(harness.name, harness.estimator, stream)
    except IncompatibleEstimator:
        return False
    return True


def _require_sound(harness: Harness, stream: Stream, where: str) -> None:
    base = harness.run(stream, where)
    require_covariance(base, where)
    half = len(stream.time) // 2
    if not harness.traits.offline:  # which sees later readings by definition
        ended = f"the stream ended after tick {half - 1} and {where}"
        harness.require_same(base, stream.first_ticks(half), ended, ticks=half)
    alone = stream.select([1])
    harness.require_same(_second(base, alone), alone, f"the second trial was alone and {where}")


def _second(record: RunRecord, alone: Stream) -> RunRecord:
    """The record of the second trial."""
    t, one = record.trace, np.array([1])
    trace = replace(t, x=t.x[one], P=t.P[one], messages=t.messages[one], bytes=t.bytes[one])
    return RunRecord(trace, tuple(sent[one] for sent in record.packets), alone)

"""The checks of `check_estimator`, in the order in which they run.

To add one: write a function that takes a `Harness`, returns what it tried and saw, and raises `CheckFailed` or
`CheckSkipped`; give it a line with its remedy in `CHECKS`. `information`, `mail_replay`, `isolation`, `numerics` and
`equivariance` hold most of them. All but equivariance compare bitwise.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from cooploc.estimators.interface import API
from cooploc.scenarios.conformance.audit import audited
from cooploc.scenarios.conformance.compare import (
    CheckFailed,
    RunRecord,
    require_equal,
    require_none_in_trial,
)
from cooploc.scenarios.conformance.equivariance import equivariance
from cooploc.scenarios.conformance.harness import Harness, pickled
from cooploc.scenarios.conformance.information import causality, link_honesty, non_interference
from cooploc.scenarios.conformance.isolation import (
    declaration,
    determinism,
    no_global_randomness,
    no_memory,
    order_independence,
    truth_blindness,
)
from cooploc.scenarios.conformance.mail_replay import mail_replay
from cooploc.scenarios.conformance.numerics import covariance, nan_safety, silence
from cooploc.scenarios.conformance.other_worlds import other_worlds
from cooploc.scenarios.conformance.snapshot import Snapshot, require_unchanged, snapshot
from cooploc.scenarios.stream import Stream

ROW_METHODS = ("init", "predict", "correct", "send", "fuse", "estimate")
TEAM_METHODS = ("init", "predict", "correct", "exchange", "estimate")
OFFLINE_METHODS = ("smooth",)


class Check(NamedTuple):
    """One rule of the comparison."""

    name: str
    run: Callable[[Harness], str]  # what it tried and saw; raises CheckFailed or CheckSkipped
    remedy: str  # what to change in an estimator that fails it


def runs(harness: Harness) -> str:
    """It has the methods of the interface, and its estimates are finite and of the right shape."""
    _require_interface(harness)
    labels = [stream.scenario.partition("[")[0] for stream in harness.streams]
    t, T, _, _ = harness.cases[0][1].trace.x.shape
    return f"ran on {t} trials of {T} ticks of {', '.join(labels)}: every estimate is finite and of the right shape"


def chunk_invariance(harness: Harness) -> str:
    """Every trial alone, in another order and in parts: the same estimates, packets and traffic."""
    for stream, base in harness.cases:
        everything = list(range(len(stream.trial)))
        parts = [*([i] for i in everything), everything[::-1], everything[1:]]
        for order in filter(None, parts):  # of a single trial, the last part is empty
            when = f"trials {stream.trial[order].tolist()} ran instead of all {len(everything)} in order"
            expected, found = _select(base, order), harness.run(stream.select(order), when)
            require_equal(expected, found, when)
            for what in ("messages", "bytes"):
                differs = getattr(expected.trace, what) != getattr(found.trace, what)
                require_none_in_trial(differs, found.stream, f"sent other {what} when {when}")
    return "each trial ran alone, and trials ran in reverse order and in parts: the same bits"


def immutability(harness: Harness) -> str:
    """Methods write to nothing that they are given, parameters stay, and a second run repeats the first."""
    before = snapshot(harness.estimator, "its parameters")
    for stream, base in harness.cases:
        audit = partial(audited, stream.scenario, harness.traits.mutable)
        again = harness.run(stream, "it ran a second time", audit=audit)
        require_unchanged(_inputs(stream), _inputs(again.stream), f"during the run of {stream.scenario!r}")
        require_equal(base, again, "it ran a second time")
    require_unchanged(before, snapshot(harness.estimator, "its parameters"), "by running")
    compared = "inputs and parameters" if harness.traits.mutable else "inputs, states and parameters"
    exempt = "; its state is exempt, as it declares mutable = True" if harness.traits.mutable else ""
    return f"{compared} were compared before and after each call: no change; a second run gave the same bits{exempt}"


def pickling(harness: Harness) -> str:
    """The estimator that comes back from pickle gives the same bits."""
    copy, when = pickled(harness.estimator), "it ran after a round trip through pickle"
    for stream, base in harness.cases:
        require_equal(base, harness.run(stream, when, estimator=copy), when)
    return "it ran after a round trip through pickle: the same bits"


KEYED = (
    "draw random numbers from rows.key alone; a library that draws globally gets a keyed generator by "
    "cl.PerRobot(..., own_random=True)"
)
CHECKS = (
    Check("runs", runs, "follow cooploc.estimators.interface: its shapes, and nan for an absent reading"),
    Check("determinism", determinism, KEYED),
    Check(
        "non-interference",
        non_interference,
        "compute each row from that row alone; teammates' data may come in only through `mail`, in fuse()",
    ),
    Check("link-honesty", link_honesty, "use a packet and its radio readings only where mail.heard is True"),
    Check(
        "mail-replay",
        mail_replay,
        "use of a teammate only what its packet brought: compute each row from that row and its own mail",
    ),
    Check("causality", causality, "use only what the methods are given in this tick, and your own state"),
    Check(
        "chunk-invariance",
        chunk_invariance,
        "compute row by row, without a sum, mean or matrix product over rows; draw random numbers from rows.key",
    ),
    Check(
        "immutability",
        immutability,
        "copy an array before writing to it, return a new state, and store nothing in parameters or module variables",
    ),
    Check("no-memory", no_memory, "store everything in the state that init() makes, nothing in module variables"),
    Check("no-global-randomness", no_global_randomness, KEYED),
    Check("order-independence", order_independence, "store everything in the state; do not look for other estimators"),
    Check("truth-blindness", truth_blindness, "use only what the methods are given"),
    Check("nan-safety", nan_safety, "treat nan as an absent reading: leave that row as it is in that update"),
    Check(
        "covariance",
        covariance,
        "return (P + P.mT) / 2, and use an update that keeps P positive semidefinite, such as the Joseph form",
    ),
    Check(
        "silence",
        silence,
        "where nothing is sensed or heard, move by odometry alone and let P grow; a method that must move otherwise, "
        "as a constant-velocity filter or Euler's integration, says why in a class variable: own_motion = '...'",
    ),
    Check(
        "declaration",
        declaration,
        "name in `uses` only channels that change the estimate; a message costs 8 bytes and its payload",
    ),
    Check(
        "equivariance",
        equivariance,
        "take positions, directions and robots only from the prior, the world and the readings",
    ),
    Check(
        "other-worlds",
        other_worlds,
        "keep P positive semidefinite over long streams, and expect robots that sleep: dt is 0 and readings are nan",
    ),
    Check("pickling", pickling, "make it a frozen dataclass at the top of a module, its parameters plain values"),
)


def _require_interface(harness: Harness) -> None:
    estimator, uses = harness.estimator, getattr(harness.estimator, "uses", None)
    if isinstance(estimator, type):
        raise CheckFailed(f"it is the class {estimator.__name__}, not an instance", f"pass {estimator.__name__}()")
    if getattr(estimator, "api", None) != API:
        raise CheckFailed(f"it is written for interface {getattr(estimator, 'api', None)!r}", f"set api = {API}")
    offline, team = harness.traits.offline, harness.traits.team
    for method in OFFLINE_METHODS if offline else TEAM_METHODS if team else ROW_METHODS:
        if not callable(getattr(estimator, method, None)):
            raise CheckFailed(f"it has no method {method}()", "add it; cooploc.estimators.interface describes it")
    if team and not offline and not isinstance(getattr(estimator, "bound", None), bool):
        raise CheckFailed("it does not say whether it is a bound", "set bound = True or bound = False")
    if not isinstance(uses, tuple) or not all(isinstance(wish, str) for wish in uses):
        remedy = 'set it to a tuple of channel names, such as ("odometry", "anchor_rssi")'
        raise CheckFailed(f"uses is {uses!r}, not a tuple of channel names", remedy)


def _select(record: RunRecord, order: list[int]) -> RunRecord:
    t = record.trace
    trace = replace(t, x=t.x[order], P=t.P[order], messages=t.messages[order], bytes=t.bytes[order])
    return RunRecord(trace, tuple(sent[order] for sent in record.packets), record.stream.select(order))


def _inputs(stream: Stream) -> Snapshot:
    whole = {**stream.arrays(), "time": stream.time, "trial": stream.trial, "world": stream.world}
    return snapshot(whole, "the stream")

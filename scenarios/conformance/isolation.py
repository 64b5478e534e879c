"""Checks that an estimate comes from the robot's own data: not from the truth, earlier runs or other estimators."""

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from cooploc.estimators import make
from cooploc.scenarios.conformance.compare import CheckFailed, RunRecord, require_equal, require_none_in_trial
from cooploc.scenarios.conformance.harness import Harness
from cooploc.scenarios.conformance.snapshot import snapshot
from cooploc.scenarios.runner.run import run
from cooploc.scenarios.stream import Stream

LONG = 120  # ticks of the longer streams, on which a channel that is seldom used is looked for again
UNLIKE = (
    "look for what differs from call to call: a counter in the class or module, a cache, a generator that is seeded "
    "once, the clock, id() or hash(), a file, threads"
)
OTHERS = ("dead-reckoning", "ekf-naive")  # they can run on every small stream, the second on those of a team


def determinism(harness: Harness) -> str:
    """A second run, with everything the same, gives the same bits; where it does not, no comparison means anything."""
    for stream, base in harness.cases:
        with _global_seed(1) as changed:
            again, name = harness.run(stream, "it ran a second time"), changed()
        try:
            require_equal(base, again, "it ran a second time, with everything the same")
        except CheckFailed as e:
            drawn = f"it draws from {name}" if name else "it draws from neither random nor numpy.random"
            raise CheckFailed(f"{drawn}, and does not repeat itself: {e}", UNLIKE if not name else "") from None
    return "it ran a second time with everything the same: the same bits"


def truth_blindness(harness: Harness) -> str:
    """The same stream with its truth, another truth and no truth in memory, and under another label: the same bits."""
    for stream, base in harness.cases:
        for shift in (0.0, 1.0):
            truth = harness.truth(stream)
            truth = replace(truth, x=truth.x + shift)
            when = "its truth was in memory" if not shift else "another truth was in memory"
            found = harness.run(stream, when)
            del truth
            require_equal(base, found, when)
        harness.require_same(base, replace(stream, scenario="another label"), "the stream had another label")
    return "it ran with its truth, another truth and no truth in memory, and under another label: the same bits"


def order_independence(harness: Harness) -> str:
    """First, last and twice among other estimators of one run: the same as alone."""
    for stream, base in harness.cases:
        others = {name: make(name) for name in _runnable(stream)}
        it = harness.estimator
        harness.runs += 3
        for named in ({"it": it, **others}, {**others, "it": it}, {"twin": it, **others, "it": it}):
            trace = run(named, stream, isolate=False).traces["it"]
            require_equal(
                base, base._replace(trace=trace), f"it ran together with others, in the order {', '.join(named)}"
            )
    return "it ran first, last and twice among other estimators: the same bits as alone"


def no_memory(harness: Harness) -> str:
    """Other streams in between, forwards and backwards: every run gives the same."""
    for cases in (harness.cases, harness.cases[::-1]):
        for stream, base in cases:
            harness.run(stream.select([0]).first_ticks(3), "another, shorter stream came before")
            harness.require_same(base, stream, "another run came before")
    return "other streams ran in between, in both orders: the same bits"


def no_global_randomness(harness: Harness) -> str:
    """It neither depends on the states of `random` and `numpy.random` nor changes them."""
    for stream, base in harness.cases:
        for seed in (1, 2):
            when = f"the global generators were seeded with {seed}"
            with _global_seed(seed) as changed:
                found = harness.run(stream, when)
                if name := changed():
                    raise CheckFailed(f"it drew from or seeded {name}, on {stream.scenario!r}")
            require_equal(base, found, when)
    return "random and numpy.random were seeded differently: the same bits, and their states stayed as they were"


def declaration(harness: Harness) -> str:
    """Every channel that it declares changes an estimate somewhere, no other one does, and a team's traffic adds up.

    A channel that matters seldom, as where fusion seldom pays, is looked for again in longer streams, and in streams in
    which the robots do not start equally certain: covariance intersection of equal beliefs never pays.
    """
    for stream, base in harness.cases:
        _require_sound_traffic(base, stream)
        for channel in sorted(stream.channels() - harness.channels(stream)):
            name = harness.array(channel)
            hidden = stream.with_arrays({name: np.full_like(stream.arrays()[name], np.nan)})
            harness.require_same(base, hidden, f"{channel}, which it does not declare, was hidden")
    declared = {channel for stream in harness.streams for channel in harness.channels(stream)}
    unused = declared - _used(harness, harness.cases, declared)
    if unused:
        longer = Harness(harness.name, harness.estimator, harness.seed, ticks=LONG)
        unused -= _used(longer, longer.cases, unused)
        harness.runs += longer.runs
    if unused:
        uneven = [(s, harness.run(s, "the first robot was certain")) for s in map(_uneven, harness.streams)]
        unused -= _used(harness, uneven, unused)
    if unused:
        raise CheckFailed(f"it declares {', '.join(sorted(unused))}, but that never changed an estimate or a packet")
    return f"each declared channel ({', '.join(sorted(declared))}) changed a result; messages and bytes add up"


def _uneven(stream: Stream) -> Stream:
    """The stream with a first robot that starts with a hundredth of its standard deviation."""
    P = stream.prior.P.copy()
    P[:, 0] *= 1e-4
    return stream.with_arrays({"prior.P": P})


def _used(harness: Harness, cases: list[tuple[Stream, RunRecord]], channels: set[str]) -> set[str]:
    """Those of these channels that make a difference on some stream."""
    found: set[str] = set()
    for stream, base in cases:
        for channel in sorted(harness.channels(stream) & channels):
            found |= {channel} if _matters(harness, stream, base, channel) else set()
    return found


def _matters(harness: Harness, stream: Stream, base: RunRecord, channel: str) -> bool:
    """Whether anything changes where a channel's readings are perturbed, or hidden."""
    name = harness.array(channel)
    array = stream.arrays()[name]
    perturbed = array + 0.1 * harness.rng.normal(size=array.shape)
    for other in (perturbed, np.full_like(array, np.nan)):
        try:
            harness.require_same(base, stream.with_arrays({name: other}), f"{channel} was changed")
        except CheckFailed:
            return True
    return False


def _runnable(stream: Stream) -> tuple[str, ...]:
    """Those of `OTHERS` that can run on a stream; where there is one robot, there are no readings of teammates."""
    has = stream.channels()
    return OTHERS if has & {"sighting", "radio_range"} and stream.robots > 1 else OTHERS[:1]


@contextmanager
def _global_seed(seed: int) -> Iterator[Callable[[], str]]:
    """Seed the global generators; yields a function that names the one whose state has changed since."""
    before = random.getstate(), np.random.get_state()  # noqa: NPY002
    random.seed(seed)
    np.random.seed(seed)  # noqa: NPY002, TID251
    now: dict[str, Callable[[], Any]] = {"random": random.getstate, "numpy.random": np.random.get_state}
    started = {name: snapshot(state(), name) for name, state in now.items()}
    try:
        yield lambda: next((name for name, state in now.items() if snapshot(state(), name) != started[name]), "")
    finally:
        random.setstate(before[0])
        np.random.set_state(before[1])  # noqa: NPY002


def _require_sound_traffic(base: RunRecord, stream: Stream) -> None:
    """Messages are whole numbers, none is negative, each has at least a header, and bytes come with messages.

    Only a team that is not a bound can fail: the runner itself counts the others' traffic.
    """
    messages, sent = base.trace.messages, base.trace.bytes
    sound = np.isfinite(messages) & (messages >= 0) & (messages == np.round(messages)) & (sent >= 8 * messages)
    sound &= (messages > 0) | (sent == 0)
    fault = "states that it sent {:g} messages of {:g} bytes in all, where each has a header of 8 bytes"
    require_none_in_trial(~sound, stream, fault, messages, sent)

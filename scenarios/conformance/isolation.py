"""Checks that an estimator's answer comes from its own readings: not from the truth, other runs or estimators."""

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from cooploc.estimators import make
from cooploc.scenarios.conformance.harness import Bench, Failed, Recording, demand_same
from cooploc.scenarios.conformance.snapshot import contents
from cooploc.scenarios.runner.run import run
from cooploc.scenarios.stream import Stream

PATIENCE = 120  # ticks in which a channel that was declared must matter at last
RIVALS = ("dead-reckoning", "ekf-naive")  # they need nothing that a small stream lacks


def truth_blindness(bench: Bench) -> str:
    """The same stream, with its truth, another truth and none in memory: the same bits."""
    for stream, base in zip(bench.streams, bench.base, strict=True):
        for shift in (0.0, 1.0):
            truth = bench.truth(stream)
            truth = replace(truth, x=truth.x + shift)
            when = "its truth was in memory" if not shift else "another truth was in memory"
            got = bench.run(stream, when)
            del truth
            demand_same(base, got, stream, when)
        other = replace(stream, scenario="another label")
        demand_same(base, bench.run(other, "under another label"), stream, "the stream bore another label")
    return "the truth, another truth and none, in reach of whoever searches memory, give the same bits"


def order_independence(bench: Bench) -> str:
    """First, last and twice among other estimators of one run: what it believes alone."""
    for stream, base in zip(bench.streams, bench.base, strict=True):
        others = {name: make(name) for name in RIVALS if name in _fitting(stream)}
        mine = bench.estimator
        bench.runs += 3
        for named in ({"it": mine, **others}, {**others, "it": mine}, {"twin": mine, **others, "it": mine}):
            when = f"it ran among {', '.join(named)}"
            trace = run(named, stream).traces["it"]
            demand_same(base, base._replace(trace=trace), stream, when)
    return "first, last and twice among other estimators gives the same bits"


def no_memory(bench: Bench) -> str:
    """Other streams in between, forwards and backwards: every run starts afresh."""
    for order in (range(len(bench.streams)), reversed(range(len(bench.streams)))):
        for i in order:
            stream, base = bench.streams[i], bench.base[i]
            bench.run(stream.select([0]).truncated(3), "another, shorter run")
            when = "another run came before"
            demand_same(base, bench.run(stream, when), stream, when)
    return "runs in between, in either order, change nothing"


def no_global_randomness(bench: Bench) -> str:
    """The states of `random` and `numpy.random` neither matter nor move."""
    for stream, base in zip(bench.streams, bench.base, strict=True):
        for seed in (1, 2):
            with _seeded(seed) as moved:
                got = bench.run(stream, f"the global generators were seeded with {seed}")
                if name := moved():
                    raise Failed(f"it drew from or seeded {name}, on {stream.scenario!r}: count from rows.key instead")
            demand_same(base, got, stream, f"the global generators were seeded with {seed}")
    return "the states of random and numpy.random neither mattered nor moved"


def declaration(bench: Bench) -> str:
    """Every channel it declares makes a difference somewhere, and what a team says it sent adds up.

    What a filter seldom uses, such as a fusion that seldom pays, is looked for once more in longer streams.
    """
    for stream, base in zip(bench.streams, bench.base, strict=True):
        _demand_sound_bill(base, stream)
    declared = {channel for stream in bench.streams for channel in bench.channels(stream)}
    unused = declared - _used(bench, declared)
    if unused:
        patient = Bench(bench.name, bench.estimator, bench.seed, ticks=PATIENCE)
        unused -= _used(patient, unused)
        bench.runs += patient.runs
    if unused:
        told = ", ".join(sorted(unused))
        raise Failed(f"it declares {told}, and nothing of that ever changed its estimate: leave it out")
    return f"uses {', '.join(sorted(declared))}; messages and bytes add up"


def _used(bench: Bench, channels: set[str]) -> set[str]:
    """Those of these channels that make a difference on some stream."""
    found: set[str] = set()
    for stream, base in zip(bench.streams, bench.base, strict=True):
        for channel in sorted(bench.channels(stream) & channels):
            found |= {channel} if _matters(bench, stream, base, channel) else set()
    return found


def _fitting(stream: Stream) -> tuple[str, ...]:
    """The rivals that run on a stream; a lone robot's has no teammates to see."""
    has = stream.channels()
    return RIVALS if has & {"sighting", "radio_range"} and stream.robots > 1 else RIVALS[:1]


@contextmanager
def _seeded(seed: int) -> Iterator[Callable[[], str]]:
    """Other states of the global generators; yields what says which of them has moved since."""
    before = random.getstate(), np.random.get_state()  # noqa: NPY002
    random.seed(seed)
    np.random.seed(seed)  # noqa: NPY002, TID251
    now: dict[str, Callable[[], Any]] = {"random": random.getstate, "numpy.random": np.random.get_state}
    started = {name: contents(state(), name) for name, state in now.items()}
    try:
        yield lambda: next((name for name, state in now.items() if contents(state(), name) != started[name]), "")
    finally:
        random.setstate(before[0])
        np.random.set_state(before[1])  # noqa: NPY002


def _matters(bench: Bench, stream: Stream, base: Recording, channel: str) -> bool:
    """Whether anything changes where a channel is shaken, or hidden."""
    name = bench.array(channel)
    array = stream.arrays()[name]
    shaken = array + 0.1 * bench.rng.normal(size=array.shape)
    for other in (shaken, np.full_like(array, np.nan)):
        try:
            got = bench.run(stream.with_arrays({name: other}), f"{channel} was changed")
            demand_same(base, got, stream, "")
        except Failed:
            return True
    return False


def _demand_sound_bill(base: Recording, stream: Stream) -> None:
    """Messages are whole, not negative, at least a header each, and none where there is nobody to send to.

    Row estimators are billed by the runner; a bound's uplink too.
    """
    messages, sent = base.trace.messages, base.trace.bytes
    sound = np.isfinite(messages) & (messages >= 0) & (messages == np.round(messages)) & (sent >= 8 * messages)
    sound &= (messages > 0) | (sent == 0)
    if not sound.all():
        trial, robot = np.argwhere(~sound)[0]
        raise Failed(
            f"robot {robot} says it sent {messages[trial, robot]:g} messages of {sent[trial, robot]:g} bytes in all; "
            f"each has a header of 8: {stream.scenario!r}, trial {stream.trial[trial]}"
        )

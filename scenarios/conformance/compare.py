"""Where two runs of an estimator differ, bit by bit, and the exceptions by which a check reports it."""

from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from cooploc.estimators.interface import Array, Mask
from cooploc.scenarios.runner.trace import Trace
from cooploc.scenarios.stream import Stream


class CheckFailed(Exception):
    """What was tried and seen, in one sentence with its place; and a remedy where the check's own does not fit."""

    def __init__(self, found: str, remedy: str = "") -> None:
        super().__init__(found)
        self.remedy = remedy


class CheckSkipped(Exception):
    """The check does not apply to this estimator; the message says why."""


class RunRecord(NamedTuple):
    """What an estimator believed and transmitted in one run."""

    trace: Trace
    packets: tuple[Array, ...]  # (t, n, ...) per tick, what send() returned; empty for a team estimator
    stream: Stream  # the copy that it ran on


def require_equal(a: RunRecord, b: RunRecord, when: str, robots: Mask | None = None, ticks: int | None = None) -> None:
    """Require that two runs are bitwise equal, for these robots (n,) and in the first ticks.

    Raises:
        CheckFailed: they differ; says whose estimate or packet, `when` (what was tried), and where first.

    """
    for what, differs in (("estimate", _estimates_differ(a, b)), ("packet", _packets_differ(a, b))):
        chosen = differs[:, :ticks] & (np.ones(a.stream.robots, bool) if robots is None else robots)
        require_none(chosen, a.stream, f"'s {what} changed when {when}")


def require_none(bad: Mask, stream: Stream, fault: str) -> None:
    """Require that `bad` (t, T, n) holds nowhere.

    Raises:
        CheckFailed: it does; says which robot, its `fault`, and where first.

    """
    if bad.any():
        fail_at(earliest(bad), stream, fault)


def earliest(bad: Mask) -> tuple[int, int, int]:
    """Trial's index, tick and robot where `bad` (t, T, n) holds first in time."""
    tick, trial, robot = map(int, np.argwhere(bad.swapaxes(0, 1))[0])
    return trial, tick, robot


def fail_at(where: tuple[int, int, int], stream: Stream, fault: str) -> NoReturn:
    """Fail with the robot, its `fault`, and the place."""
    trial, tick, robot = where
    raise CheckFailed(f"robot {robot}{fault}: {stream.scenario!r}, trial {stream.trial[trial]}, tick {tick}")


def require_none_in_trial(bad: Mask, stream: Stream, fault: str, *values: Array) -> None:
    """Require that `bad` (t, n) holds nowhere; `fault` has a {} for each of `values` (t, n) there.

    Raises:
        CheckFailed: it does; says which robot, its `fault`, and in which trial first.

    """
    if bad.any():
        trial, robot = np.argwhere(bad)[0]
        said = fault.format(*(value[trial, robot] for value in values))
        raise CheckFailed(f"robot {robot} {said}: {stream.scenario!r}, trial {stream.trial[trial]}")


def _estimates_differ(a: RunRecord, b: RunRecord) -> Mask:
    """(t, T, n), over the ticks that both have."""
    T = min(a.trace.x.shape[1], b.trace.x.shape[1])
    x: Mask = (_bits(a.trace.x[:, :T]) != _bits(b.trace.x[:, :T])).any(-1)
    P: Mask = (_bits(a.trace.P[:, :T]) != _bits(b.trace.P[:, :T])).any((-2, -1))
    return x | P


def _packets_differ(a: RunRecord, b: RunRecord) -> Mask:
    """(t, T, n), over the ticks that both have."""
    t, _, n = a.stream.senses.dt.shape
    ticks = [
        (_bits(p) != _bits(q)).any(-1) if p.shape == q.shape else np.ones((t, n), bool)
        for p, q in zip(a.packets, b.packets, strict=False)
    ]
    return np.stack(ticks, 1) if ticks else np.zeros((t, 0, n), bool)


def _bits(a: Array) -> NDArray[np.uint64]:
    return np.ascontiguousarray(a).view(np.uint64)

"""Where two runs of an estimator differ, bit by bit and by how much, and the exceptions by which a check reports it."""

from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from cooploc.estimators.interface import Array, Mask
from cooploc.scenarios.runner.trace import Trace
from cooploc.scenarios.stream import Stream

ROUNDING = 1e-9  # a largest difference below this is called rounding: it fails too, but has another cause


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
    for what, (differs, size) in (("estimate", _estimates_differ(a, b)), ("packet", _packets_differ(a, b))):
        chosen = differs[:, :ticks] & (np.ones(a.stream.robots, bool) if robots is None else robots)
        if chosen.any():
            largest = float(size[:, :ticks][chosen].max())
            fail_at(earliest(chosen), a.stream, f"'s {what} changed {by(largest)} when {when}")


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
    raise CheckFailed(place(where, stream, fault))


def place(where: tuple[int, int, int], stream: Stream, fault: str) -> str:
    """A robot's `fault`, with the place."""
    trial, tick, robot = where
    return f"robot {robot}{fault}: {stream.scenario!r}, trial {stream.trial[trial]}, tick {tick}"


def require_none_in_trial(bad: Mask, stream: Stream, fault: str, *values: Array) -> None:
    """Require that `bad` (t, n) holds nowhere; `fault` has a {} for each of `values` (t, n) there.

    Raises:
        CheckFailed: it does; says which robot, its `fault`, and in which trial first.

    """
    if bad.any():
        trial, robot = np.argwhere(bad)[0]
        said = fault.format(*(value[trial, robot] for value in values))
        raise CheckFailed(f"robot {robot} {said}: {stream.scenario!r}, trial {stream.trial[trial]}")


def by(largest: float) -> str:
    """A difference's size in words; infinite where one is a number and the other is not."""
    if not np.isfinite(largest):
        return "between a number and none"
    if largest == 0:
        return "in the sign of a zero"
    return f"by {largest:.1e}, which is rounding," if largest < ROUNDING else f"by up to {largest:.2g}"


def _estimates_differ(a: RunRecord, b: RunRecord) -> tuple[Mask, Array]:
    """Whether, and by how much, (t, T, n), over the ticks that both have."""
    T = min(a.trace.x.shape[1], b.trace.x.shape[1])
    x, by_x = _differ(a.trace.x[:, :T], b.trace.x[:, :T])
    P, by_P = _differ(*(one.trace.P[:, :T].reshape(*x.shape, -1) for one in (a, b)))
    return x | P, np.maximum(by_x, by_P)


def _packets_differ(a: RunRecord, b: RunRecord) -> tuple[Mask, Array]:
    """Whether, and by how much, (t, T, n), over the ticks that both have."""
    t, _, n = a.stream.senses.dt.shape
    ticks = [
        _differ(p, q) if p.shape == q.shape else (np.ones((t, n), bool), np.full((t, n), np.inf))
        for p, q in zip(a.packets, b.packets, strict=False)
    ]
    if not ticks:
        return np.zeros((t, 0, n), bool), np.zeros((t, 0, n))
    return np.stack([differs for differs, _ in ticks], 1), np.stack([size for _, size in ticks], 1)


def _differ(a: Array, b: Array) -> tuple[Mask, Array]:
    """Whether bits differ along the last axis, and the largest difference there."""
    if not a.shape[-1]:
        return np.zeros(a.shape[:-1], bool), np.zeros(a.shape[:-1])
    differs = _bits(a) != _bits(b)
    with np.errstate(invalid="ignore"):
        size = np.where(differs, np.abs(a - b), 0.0)
    return differs.any(-1), np.where(np.isfinite(size), size, np.inf).max(-1)


def _bits(a: Array) -> NDArray[np.uint64]:
    return np.ascontiguousarray(a).view(np.uint64)

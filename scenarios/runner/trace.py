"""The run of one estimator on one stream: its beliefs at every tick, and their cost."""

import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from time import process_time
from typing import Any, Self

import numpy as np
from numba.core import event
from threadpoolctl import ThreadpoolController

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Rows
from cooploc.estimators.registry import traits
from cooploc.scenarios.runner.tick import EstimatorError, IncompatibleEstimator, Watcher, make_loop, restrict, senses
from cooploc.scenarios.stream import Stream

COMPILING = "numba:compiler_lock"  # numba's event around compiling a kernel, or reading it from disk


class Stopwatch(event.Listener):
    """Seconds of this process's processor time between `with` and its end, without compilation."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._began = 0.0
        self._stopped = 0  # how often: one kernel compiles the kernels that it calls

    def __enter__(self) -> Self:
        event.register(COMPILING, self)
        self._began = process_time()
        return self

    def __exit__(self, *_: object) -> None:
        event.unregister(COMPILING, self)
        self.seconds += process_time() - self._began

    def on_start(self, event: Any) -> None:
        if self._stopped == 0:
            self.seconds += process_time() - self._began
        self._stopped += 1

    def on_end(self, event: Any) -> None:
        self._stopped -= 1
        if self._stopped == 0:
            self._began = process_time()


ROUNDING = 1e-9  # asymmetry and negative variance that are allowed, relative to the covariance's largest entry
AS_NUMPY_STARTS: Any = {"divide": "warn", "over": "warn", "under": "ignore", "invalid": "warn"}  # whatever a user sets
NOTHING = 1e-200  # a smaller covariance is zero: subnormal numbers have too few digits to be symmetric or definite


@dataclass(frozen=True, eq=False, repr=False)
class Trace:
    """The beliefs of one estimator at every tick, and their cost."""

    x: Array  # (t, T, n, d)
    P: Array  # (t, T, n, d, d)
    messages: Array  # (t, n) sent
    bytes: Array  # (t, n) sent
    seconds: float  # of processor time for all trials, robots and ticks, without compilation
    bound: bool = False  # uses all readings of all robots as well as any estimator could
    notes: Mapping[str, Array] = field(default_factory=dict)  # (t, n) what the estimator counted, by name
    centralised: bool = False  # all readings reach one computer, which knows more than any robot could
    senses: str = ""  # what it reads beside odometry, in words
    offline: bool = False  # it saw the readings of later ticks, too
    trained_on: str = ""  # what it says that it was trained on

    def __repr__(self) -> str:
        trials, ticks, robots, size = self.x.shape
        return f"Trace(x of {trials} x {ticks} x {robots} x {size}: trials, ticks, robots, state; P, messages, bytes)"

    @classmethod
    def of(cls, x: Array, P: Array | None = None) -> "Trace":
        """Poses (t, T, n, d) that were computed elsewhere, with covariances or without; what is not known is nan."""
        x = np.asarray(x, float)
        unknown = np.full(x.shape[:1] + x.shape[2:3], np.nan)
        P = np.full((*x.shape, *x.shape[3:]), np.nan) if P is None else np.asarray(P, float)
        return cls(x, P, unknown, unknown, np.nan)


def trace(
    name: str,
    estimator: Any,
    stream: Stream,
    watch: Watcher | None = None,
    *,
    rows: Rows | None = None,  # that the seed makes, of a stream that does not say its seed
    ticks: int | None = None,
) -> Trace:
    """Run one estimator on every trial of a stream, or on its first `ticks`, in this process."""
    running = make_loop(name, estimator, restrict(name, estimator, stream), watch, rows)
    t, T, n = stream.senses.dt.shape
    T, d = min(ticks or T, T), stream.prior.x.shape[-1]
    x, P = np.empty((t, T, n, d)), np.empty((t, T, n, d, d))
    messages, sent = np.zeros((t, n)), np.zeros((t, n))
    with _thread_pools(len(sys.modules)).limit(limits=1), np.errstate(**AS_NUMPY_STARTS), Stopwatch() as clock:
        running.start()
        for k in range(T):
            belief, traffic = running.tick(k)
            x[:, k], P[:, k] = belief.x.reshape(x[:, k].shape), belief.P.reshape(P[:, k].shape)
            messages += traffic.messages
            sent += traffic.bytes
    _refuse(name, "estimate is not finite", stream, ~np.isfinite(x).all(-1))
    _refuse(name, "P is not finite", stream, ~np.isfinite(P).all((-2, -1)))
    require_covariances(name, stream, P)
    about, seconds = traits(estimator), clock.seconds
    notes = {what: np.asarray(values, float).reshape(t, n) for what, values in about.notes(running.state).items()}
    kind = {name: getattr(about, name) for name in ("bound", "centralised", "offline", "trained_on")}
    return Trace(x, P, messages, sent, seconds, notes=notes, senses=senses(estimator, stream), **kind)


@lru_cache(maxsize=1)
def _thread_pools(modules: int) -> ThreadpoolController:
    """Return the thread pools of loaded libraries; looking for them takes longer than a short run, so it is cached."""
    return ThreadpoolController()


def require_fit(name: str, estimator: Any, stream: Stream) -> None:
    """Refuse an estimator that cannot be started on such a stream: nothing of it is run but the start."""
    seen = restrict(name, estimator, stream)
    try:
        make_loop(name, estimator, seen).start()
    except BadInput as e:
        raise IncompatibleEstimator(f"{name} on scenario {stream.scenario!r}: {e}") from None
    except Exception:
        return


def warm_up(name: str, estimator: Any, stream: Stream) -> None:
    """Two ticks of one trial, so that what an estimator imports and compiles is there before its time is taken."""
    with suppress(Exception):  # it occurs again in the run
        trace(name, estimator, stream.select(slice(0, 1)).first_ticks(2))


def require_covariances(name: str, stream: Stream, P: Array) -> None:
    """Refuse an invalid covariance at any tick, robot and trial: a negative variance would count as consistent.

    Raises:
        EstimatorError: some P (t, T, n, d, d) is not symmetric, or has a negative variance in some direction, by more
            than `ROUNDING` of its largest entry. Zero is allowed: a cloud of particles may collapse.
    """
    scale = np.maximum(np.abs(P).max((-2, -1)), NOTHING)
    _refuse(name, "covariance is not symmetric", stream, np.abs(P - P.mT).max((-2, -1)) > ROUNDING * scale)
    _refuse(name, "covariance has a negative variance", stream, _least_variance(P) < -ROUNDING * scale)


def _refuse(name: str, fault: str, stream: Stream, bad: Any) -> None:
    """Raise an error for the first place where `bad` (t, T, n) is true."""
    if bad.any():
        i, k, robot = np.argwhere(bad)[0]
        place = f"{stream.scenario!r}, trial {stream.trial[i]}, tick {k}, robot {robot}"
        raise EstimatorError(f"{name}: {fault} in {place}")


def _least_variance(P: Array) -> Array:
    """Return the smallest eigenvalue of symmetric P (..., d, d); of two axes in closed form, fifty times faster."""
    if P.shape[-1] == 2:
        mean, half = (P[..., 0, 0] + P[..., 1, 1]) / 2, (P[..., 0, 0] - P[..., 1, 1]) / 2
        return np.asarray(mean - np.hypot(half, P[..., 0, 1]))
    return np.asarray(np.linalg.eigvalsh((P + P.mT) / 2)[..., 0])

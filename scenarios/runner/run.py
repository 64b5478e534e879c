"""The runner: feeds one stream to any number of estimators, carries their mail, and hides what they did not declare.

Every estimator gets the same arrays, read-only, and loses the same packets. The truth is not here at all.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
from threadpoolctl import threadpool_limits

from cooploc.estimators.interface import API, Array, Belief, Indices, Mail, Rows, Senses, Traffic
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios import seeds
from cooploc.scenarios.display import progress_bar
from cooploc.scenarios.display.html import listed
from cooploc.scenarios.display.progress_bar import Advance
from cooploc.scenarios.runner.network import HEADER, count, deliver
from cooploc.scenarios.stream import Stream

if TYPE_CHECKING:
    from xarray import Dataset

SENSED = ("odometry", "anchor_rssi", "landmark", "sighting")


class Misfit(BadInput):
    """An estimator that cannot run on a stream, with the reason."""


class EstimatorError(RuntimeError):
    """An estimator that broke its contract while it ran."""


@dataclass(frozen=True, eq=False)
class Trace:
    """What one estimator believed at every tick, and what it cost."""

    x: Array  # (t, T, n, d)
    P: Array  # (t, T, n, d, d)
    messages: Array  # (t, n) sent
    bytes: Array  # (t, n) sent
    seconds: float  # for all trials, robots and ticks
    bound: bool = False  # knows more than any robot could
    notes: Mapping[str, Array] = field(default_factory=dict)  # (t, n) what the estimator counted, by name


@dataclass(frozen=True, eq=False)
class Run:
    """The traces of several estimators on one stream."""

    scenario: str
    seed: int
    trial: Indices  # (t,)
    hashes: tuple[str, ...]  # of the stream's trials
    traces: Mapping[str, Trace] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"Run({self.scenario!r}, {len(self.trial)} trials, {', '.join(self.traces)})"

    def _repr_html_(self) -> str:
        header = ("estimator", "messages per robot and tick", "bytes", "µs", "bound")
        title = f"run of {self.scenario}, seed {self.seed}, {len(self.trial)} trials"
        return listed(header, title, [(name, *_cost(trace)) for name, trace in self.traces.items()])

    def to_xarray(self) -> "Dataset":
        """Every trace in one xarray.Dataset; `cooploc.scenarios.runner.to_xarray` says what it holds."""
        from cooploc.scenarios.runner.to_xarray import dataset

        return dataset(self)


def _cost(trace: Trace) -> tuple[str, ...]:
    """Messages, bytes and microseconds per robot and tick, and whether it is a bound."""
    t, T, n, _ = trace.x.shape
    sent, size = trace.messages.sum() / (t * T * n), trace.bytes.sum() / (t * T * n)
    return f"{sent:.2g}", f"{size:.3g}", f"{1e6 * trace.seconds / (t * T * n):.3g}", "yes" if trace.bound else ""


class Watcher(Protocol):
    """Sees every call of an estimator's method: its state before, its other arguments, and what it returned."""

    def __call__(self, method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any: ...


def run(estimators: Mapping[str, Any] | Any, stream: Stream, jobs: int = 1) -> Run:
    """Run estimators on a stream.

    Args:
        estimators: instances by name, or one instance.
        stream: what they get.
        jobs: processes to spread the trials over; the result is bit-identical for any number.

    Raises:
        Misfit: an estimator needs a channel that the stream lacks.
        EstimatorError: an estimator returned something of the wrong shape, or not finite.

    """
    named = estimators if isinstance(estimators, Mapping) else {type(estimators).__name__: estimators}
    for name, estimator in named.items():
        demand_fit(name, estimator, stream.select(slice(0, 1)).truncated(1))
    parts = np.array_split(np.arange(len(stream.trial)), min(jobs, len(stream.trial)))
    chunks = [stream.select(slice(int(part[0]), int(part[-1]) + 1)) for part in parts] if len(parts) > 1 else [stream]
    ticks = stream.senses.dt.shape[1]
    with progress_bar.bar(ticks * len(chunks) * len(named)) as advance:
        compute = _spread if len(chunks) > 1 else _here
        traces = compute(named, chunks, advance)
    return Run(stream.scenario, stream.seed, stream.trial, stream.hashes, traces)


def _here(named: Mapping[str, Any], chunks: list[Stream], advance: Advance | None) -> dict[str, Trace]:
    return {name: trace(name, estimator, chunks[0], advance=advance) for name, estimator in named.items()}


def _spread(named: Mapping[str, Any], chunks: list[Stream], advance: Advance | None) -> dict[str, Trace]:
    """In processes, one for each chunk of the trials."""
    from concurrent.futures import Future, as_completed

    from loky import get_reusable_executor

    pool = get_reusable_executor(max_workers=len(chunks))
    futures: dict[Future[Trace], str] = {
        pool.submit(trace, name, estimator, chunk): name for name, estimator in named.items() for chunk in chunks
    }
    for future in as_completed(futures):
        future.result()  # the first failure ends the run
        if advance:
            advance(futures[future], chunks[0].senses.dt.shape[1])
    return {name: _joined([f.result() for f, of in futures.items() if of == name]) for name in named}


def _joined(traces: list[Trace]) -> Trace:
    parts = {f: np.concatenate([getattr(t, f) for t in traces]) for f in ("x", "P", "messages", "bytes")}
    notes = {name: np.concatenate([t.notes[name] for t in traces]) for name in traces[0].notes}
    return Trace(**parts, seconds=sum(t.seconds for t in traces), bound=traces[0].bound, notes=notes)


def trace(
    name: str, estimator: Any, stream: Stream, watch: Watcher | None = None, advance: Advance | None = None
) -> Trace:
    """Run one estimator on every trial of a stream, in this process; `advance` is told of every tick, off the clock."""
    seen = visible(name, estimator, stream)
    team = hasattr(estimator, "exchange")
    drive = _Team(name, estimator, seen, watch) if team else _Robots(name, estimator, seen, watch)
    t, T, n = stream.senses.dt.shape
    d = stream.prior.x.shape[-1]
    x, P = np.empty((t, T, n, d)), np.empty((t, T, n, d, d))
    messages, sent = np.zeros((t, n)), np.zeros((t, n))
    with threadpool_limits(1):
        began = perf_counter()
        drive.start()
        for k in range(T):
            belief, traffic = drive.tick(k)
            x[:, k], P[:, k] = belief.x.reshape(x[:, k].shape), belief.P.reshape(P[:, k].shape)
            messages += traffic.messages
            sent += traffic.bytes
            if advance:
                paused = perf_counter()
                advance(name, 1)
                began += perf_counter() - paused
        seconds = perf_counter() - began
    _demand_finite(name, stream, x, P)
    noted = estimator.notes(drive.state) if hasattr(estimator, "notes") else {}
    notes = {what: np.asarray(values, float).reshape(t, n) for what, values in noted.items()}
    return Trace(x, P, messages, sent, seconds, getattr(estimator, "bound", False), notes)


def demand_fit(name: str, estimator: Any, stream: Stream) -> None:
    """Refuse an estimator that cannot run on such a stream at all.

    Raises:
        BadInput: it lacks a channel (Misfit), or its `init` refuses the world.

    """
    seen = visible(name, estimator, stream)
    try:
        (_Team if hasattr(estimator, "exchange") else _Robots)(name, estimator, seen, None).start()
    except BadInput as e:
        raise Misfit(f"{name} on scenario {stream.scenario!r}: {e}") from None
    except Exception:
        return


def visible(name: str, estimator: Any, stream: Stream) -> Stream:
    """The stream with everything hidden that the estimator does not declare.

    Raises:
        Misfit: it declares something that the stream does not have, or another version of the interface.

    """
    if getattr(estimator, "api", None) != API:
        found = getattr(estimator, "api", None)
        raise Misfit(f"{name} is written for interface {found!r}, this runner speaks {API}: set api = {API}")
    used = resolve(name, tuple(estimator.uses), stream)
    senses = stream.senses
    shown = senses._replace(
        **{c: getattr(senses, c) if c in used else getattr(senses, c)[:, :, :, :0] for c in SENSED},
        extra={c: a for c, a in senses.extra.items() if c in used},
    )
    air = stream.air
    air = air._replace(
        **{c: getattr(air, c) if f"radio_{c}" in used else getattr(air, c)[..., :0] for c in ("rssi", "range")}
    )
    sensors = {c: s for c, s in stream.world.sensors.items() if c in used}
    return replace(stream, senses=shown, air=air, world=replace(stream.world, sensors=sensors))


def resolve(name: str, uses: tuple[str, ...], stream: Stream) -> set[str]:
    """The channels that a declaration selects: "a|b" the first that exists, "a?" if it exists."""
    has, used = stream.channels(), set()
    for wish in uses:
        options = wish.rstrip("?").split("|")
        found = next((channel for channel in options if channel in has), None)
        if found is not None:
            used.add(found)
        elif not wish.endswith("?"):
            needed = " or ".join(repr(channel) for channel in options)
            raise Misfit(f"{name} needs channel {needed}; scenario {stream.scenario!r} has {', '.join(sorted(has))}")
    return used


class _Drive:
    """What both kinds of estimators need of a tick."""

    def __init__(self, name: str, estimator: Any, stream: Stream, watch: Watcher | None) -> None:
        self.name, self.estimator, self.stream = name, estimator, stream
        self.watch: Watcher = watch or (lambda method, tick, arguments, call: call(*arguments))
        self.shape = stream.senses.dt.shape[0], stream.robots
        self.rows = seeds.rows(stream.seed, stream.trial, stream.robots)
        self.state: Any = None
        self.hidden = np.full((len(stream.trial), stream.robots, stream.robots), np.nan)

    def call(self, method: str, tick: int, *arguments: Any) -> Any:
        return self.watch(method, tick, arguments, getattr(self.estimator, method))

    def senses(self, k: int, flat: bool) -> Senses:
        z = self.stream.senses
        arrays = {c: self._at(getattr(z, c), k, flat) for c in (*SENSED, "dt")}
        return Senses(**arrays, extra={c: self._at(a, k, flat) for c, a in z.extra.items()})

    def air(self, k: int) -> tuple[Any, Array, Array]:
        air = self.stream.air
        rssi, distance = (self._pairs(a[:, k]) for a in (air.rssi, air.range))
        return air.link[:, k], rssi, distance

    def _at(self, a: Array, k: int, flat: bool) -> Array:
        tick = a[:, k]
        return cast(Array, _frozen(tick.reshape(len(tick) * self.stream.robots, *tick.shape[2:]) if flat else tick))

    def _pairs(self, a: Array) -> Array:
        """A hidden radio channel reads nan everywhere."""
        return a if a.shape[-1] else self.hidden

    def belief(self, k: int) -> Belief:
        belief = self.call("estimate", k, self.state)
        d = self.stream.prior.x.shape[-1]
        lead = self.shape if hasattr(self.estimator, "exchange") else (self.shape[0] * self.shape[1],)
        for what, array, shape in (("x", belief.x, (*lead, d)), ("P", belief.P, (*lead, d, d))):
            if np.shape(array) != shape:
                raise EstimatorError(
                    f"{self.name}: estimate() returned {what} of shape {np.shape(array)} at tick {k}, not {shape}"
                )
        return Belief(*belief)


class _Robots(_Drive):
    """One row per (trial, robot); mail is carried between the rows of a trial."""

    def start(self) -> None:
        prior = Belief(*(_frozen(a.reshape(len(self.rows.key), *a.shape[2:])) for a in self.stream.prior))
        rows = Rows(*(_frozen(a) for a in self.rows))
        self.state = self.call("init", -1, prior, self.stream.world, rows)

    def tick(self, k: int) -> tuple[Belief, Traffic]:
        z = self.senses(k, flat=True)
        self.state = self.call("predict", k, self.state, z)
        self.state = self.call("correct", k, self.state, z)
        sent = self.call("send", k, self.state, z)
        mail, traffic = self.carry(k, sent)
        self.state = self.call("fuse", k, self.state, z, mail)
        return self.belief(k), traffic

    def carry(self, k: int, sent: Array) -> tuple[Mail, Traffic]:
        """Deliver packets over the links that hold; what was sent counts whether it arrives or not."""
        t, n = self.shape
        link, rssi, distance = self.air(k)
        if not (sent.ndim in (2, 3) and len(sent) == t * n and (sent.ndim == 2 or sent.shape[1] == n)):
            raise EstimatorError(
                f"{self.name}: send() returned shape {sent.shape} at tick {k}, not ({t * n}, m) or ({t * n}, {n}, m)"
            )
        sent = sent if np.issubdtype(sent.dtype, np.floating) else sent.astype(float)
        awake = self.stream.senses.dt[:, k] > 0  # a robot that sleeps sends nothing
        mail = deliver(sent, n, link, rssi, distance)
        return Mail(*(_frozen(a) for a in mail)), count(sent, awake.reshape(t, n))


class _Team(_Drive):
    """One state for the whole team; arrays are (trial, n, ...)."""

    def start(self) -> None:
        t, n = self.shape
        rows = Rows(*(_frozen(a.reshape(t, n, *a.shape[1:])) for a in self.rows))
        if self.estimator.bound:
            self.uplink = self._uplink()
        self.state = self.call("init", -1, Belief(*(_frozen(a) for a in self.stream.prior)), self.stream.world, rows)

    def tick(self, k: int) -> tuple[Belief, Traffic]:
        z = self.senses(k, flat=False)
        link, rssi, distance = self.air(k)
        t, n = self.shape
        heard = (a if a is self.hidden else np.where(link, a, np.nan) for a in (rssi, distance))
        air = Mail(*(_frozen(a) for a in (link, np.empty((t, n, n, 0)), *heard)))
        self.state = self.call("predict", k, self.state, z)
        self.state = self.call("correct", k, self.state, z)
        self.state, traffic = self.call("exchange", k, self.state, z, air)
        if self.estimator.bound:
            traffic = Traffic(self.uplink.messages[:, k], self.uplink.bytes[:, k])
        return self.belief(k), traffic

    def _uplink(self) -> Traffic:
        """What a bound's robots must send to the computer that knows everything: the finite readings it uses."""
        senses, air = self.stream.senses, self.stream.air
        heard = (np.isfinite(a) & air.link for a in (air.rssi, air.range) if a.shape[-1])
        sensed = (np.isfinite(a) for a in (*(getattr(senses, c) for c in SENSED), *senses.extra.values()))
        finite = sum(a.reshape(*senses.dt.shape, -1).sum(-1) for a in (*sensed, *heard))
        return Traffic((finite > 0).astype(float), np.where(finite > 0, finite * 8.0 + HEADER, 0.0))


def _demand_finite(name: str, stream: Stream, x: Array, P: Array) -> None:
    bad = ~(np.isfinite(x).all(-1) & np.isfinite(P).all((-2, -1)))
    if bad.any():
        i, k, robot = np.argwhere(bad)[0]
        raise EstimatorError(
            f"{name}: estimate is not finite in {stream.scenario!r}, trial {stream.trial[i]}, tick {k}, robot {robot}"
        )


def _frozen(a: Any) -> Any:
    """A copy that cannot be written to, nor lead back to what it was cut from: other channels, trials and ticks."""
    return np.frombuffer(np.ascontiguousarray(a).tobytes(), a.dtype).reshape(a.shape)

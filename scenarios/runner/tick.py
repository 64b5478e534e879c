"""One estimator's ticks: the channels it may read, the calls of its methods in their order, and its mail.

An estimator's `uses` selects its channels; everything else is hidden from it, so the declaration is enforced.
"""

from collections.abc import Callable
from dataclasses import replace
from difflib import get_close_matches
from functools import cached_property
from typing import Any, ClassVar, get_args

import numba
import numpy as np

from cooploc.estimators.compiled import readable
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import HEADER, TEAM_PRIOR, Array, Belief, Mail, Mask, Rows, Senses, Traffic, World
from cooploc.estimators.registry import refusal, traits
from cooploc.scenarios import seeds
from cooploc.scenarios.stream import Stream

WORDS = {
    "anchor_rssi": "RSSI",
    "anchor_range": "anchor ranges",
    "landmark": "landmarks",
    "sighting": "sightings",
    "radio_rssi": "team RSSI",
    "radio_range": "team ranges",
    TEAM_PRIOR: "team priors",
}
DERIVED = {"doa": "DOA", "doa-constant": "DOA", "gradient": "gradient"}  # by the parameter `anchor_reading`
SENSED = ("odometry", "anchor_rssi", "landmark", "sighting")


class IncompatibleEstimator(BadInput):
    """An estimator that cannot run on a stream, with the reason."""


def restrict(name: str, estimator: Any, stream: Stream) -> Stream:
    """Hide everything of a stream that the estimator does not declare."""
    if reason := refusal(estimator):
        raise IncompatibleEstimator(f"{name} cannot run: {reason}")
    try:
        used = select_channels(name, tuple(estimator.uses), stream)
    except IncompatibleEstimator as e:
        raise IncompatibleEstimator(f"{e}{_remedy(estimator, stream)}") from None
    z, air = stream.senses, stream.air
    shown = {c: getattr(z, c) if c in used else getattr(z, c)[:, :, :, :0] for c in SENSED}
    heard = {c: getattr(air, c) if f"radio_{c}" in used else getattr(air, c)[..., :0] for c in ("rssi", "range")}
    z = z._replace(**shown, extra={c: a for c, a in z.extra.items() if c in used})
    sensors = {c: s for c, s in stream.world.sensors.items() if c in used}
    return replace(stream, senses=z, air=air._replace(**heard), world=replace(stream.world, sensors=sensors))


def _remedy(estimator: Any, stream: Stream) -> str:
    """Return the parameters with which an estimator runs on a stream, where these may be "any"."""
    choices = getattr(type(estimator), "__annotations__", {})
    chosen = dict.fromkeys([key for key in ("anchor_reading", "reading") if "any" in get_args(choices.get(key))], "any")
    try:
        select_channels("", tuple(replace(estimator, **chosen).uses), stream)
    except (BadInput, TypeError):  # TypeError: it is no dataclass
        return ""
    return f"; [{','.join(f'{key}=any' for key in chosen)}] takes whatever readings there are"


def senses(estimator: Any, stream: Stream) -> str:
    """Name the channels that an estimator reads beside odometry: "DOA, team ranges"."""
    used = select_channels("", tuple(estimator.uses), stream)
    own = DERIVED.get(str(getattr(estimator, "anchor_reading", "")), WORDS["anchor_rssi"])
    words = {**WORDS, "anchor_rssi": own} | {channel: channel for channel in sorted(used) if channel not in WORDS}
    found = [word for channel, word in words.items() if channel in used and channel != "odometry"]
    return ", ".join(found) or "odometry"


def select_channels(name: str, uses: tuple[str, ...], stream: Stream) -> set[str]:
    """Return the channels that a declaration selects: "a|b" the first that exists, "a?" if it exists."""
    has, used = stream.channels(), set()
    for wish in uses:
        options = wish.rstrip("?").split("|")
        found = next((channel for channel in options if channel in has), None)
        if found is not None:
            used.add(found)
        elif not wish.endswith("?"):
            needed = " or ".join(repr(channel) for channel in options)
            known = {*WORDS, "odometry", *has}
            close = [one for some in (has, known) for one in get_close_matches(options[0], sorted(some), n=1)]
            meant = f"; did you mean {close[0]!r}?" if close and options[0] not in known else ""
            there = ", ".join(sorted(has))
            raise IncompatibleEstimator(
                f"{name} needs channel {needed}; scenario {stream.scenario!r} has {there}{meant}"
            )
    return used


# Mail: compiled, since every tick delivers and counts it.


def deliver(sent: Array, awake: Mask, link: Mask, rssi: Array, distance: Array) -> tuple[Mail, Traffic]:
    """Deliver packets over the links that hold, in arrays of their own, and count them, whether they arrive or not.

    `sent` is (t n, m) for everyone, or (t n, n, m) with axis 1 the addressee; a packet of nan only is silence. Axis 1
    of `link`, `rssi` [dBm] and `distance` [m] (t, n, n) is the receiver. Messages and bytes are those of the robots
    `awake` (t, n), none to oneself.
    """
    (t, n), m = awake.shape, sent.shape[-1]
    heard, packets = np.empty((t * n, n), bool), np.empty((t * n, n, m), sent.dtype)
    signal, away = np.empty((t * n, n)), np.empty((t * n, n))
    traffic = Traffic(np.zeros((t, n)), np.zeros((t, n)))
    wire = readable(sent.reshape(t, n, n if sent.ndim == 3 else 1, m))
    radio = readable(awake), readable(link), readable(rssi), readable(distance)
    _deliver(wire, sent.ndim == 3, *radio, heard, packets, signal, away, *traffic)
    return Mail(lock(heard), lock(packets), lock(signal), lock(away)), traffic


@numba.njit(cache=True)
def _deliver(wire, addressed, awake, link, rssi, distance, heard, packets, signal, away, messages, size):
    t, n, addressees, m = wire.shape
    speaks = np.empty((n, addressees), np.bool_)
    for s in range(t):
        for j in range(n):
            for to in range(addressees):
                numbers = 0
                for c in range(m):
                    numbers += not np.isnan(wire[s, j, to, c])
                speaks[j, to] = numbers > 0
                if numbers and awake[s, j] and not (addressed and to == j):
                    messages[s, j] += 1
                    size[s, j] += numbers * wire.itemsize + HEADER
        for i in range(n):
            to = i if addressed else 0
            for j in range(n):
                r, hears = s * n + i, link[s, i, j] and speaks[j, to]
                heard[r, j] = hears
                signal[r, j] = rssi[s, i, j] if hears else np.nan
                away[r, j] = distance[s, i, j] if hears else np.nan
                for c in range(m):
                    packets[r, j, c] = wire[s, j, to, c] if hears else np.nan


# The ticks.


class EstimatorError(RuntimeError):
    """An estimator that broke the interface while it ran."""

    _render_traceback_ = BadInput._render_traceback_


# Makes every call of an estimator's method, by its name, tick, arguments (state first) and the method itself.
Watcher = Callable[[str, int, tuple[Any, ...], Any], Any]


def make_loop(
    name: str, estimator: Any, stream: Stream, watch: Watcher | None = None, rows: Rows | None = None
) -> "Robots | Team | Offline":
    """Return the object that runs an estimator tick by tick: call `start` first, then `tick` by number."""
    about = traits(estimator)
    kind = Offline if about.offline else Team if about.team else Robots
    return kind(name, estimator, stream, watch, rows)


class _Loop:
    """The part of a tick that all kinds of estimators share."""

    team: ClassVar[bool]

    def __init__(self, name: str, estimator: Any, stream: Stream, watch: Watcher | None, rows: Rows | None) -> None:
        self.name, self.estimator, self.stream, self.watch = name, estimator, stream, watch
        self.shape = t, n = stream.senses.dt.shape[0], stream.robots
        self.lead = (t, n) if self.team else (t * n,)
        self.rows = rows or seeds.rows(stream.seed, stream.trial, stream.robots)
        self.centralised = traits(estimator).centralised
        self.state: Any = None
        self.hidden = freeze(np.full((len(stream.trial), stream.robots, stream.robots), np.nan))  # a radio channel

    def call(self, method: str, tick: int, *arguments: Any) -> Any:
        call = getattr(self.estimator, method)
        returned = self.watch(method, tick, arguments, call) if self.watch else call(*arguments)
        if returned is None:
            when = f"at tick {tick}" if tick >= 0 else "before tick 0"
            raise EstimatorError(f"{self.name}: {method}() returned None {when}: did you forget its return?")
        return returned

    def senses(self, k: int) -> Senses:
        z = self.stream.senses
        own = {c: self.cut(getattr(z, c), k) for c in (*SENSED, "dt")}
        return Senses(**own, extra={c: self.cut(a, k) for c, a in z.extra.items()})

    def cut(self, a: Array, k: int) -> Array:
        """Return a channel in one tick, read-only, from which nothing leads to other channels, trials or ticks."""
        return np.ndarray((*self.lead, *a.shape[3:]), a.dtype, a[:, k].tobytes())

    def air(self, k: int) -> tuple[Any, Array, Array]:
        air = self.stream.air
        rssi, distance = (a[:, k] if a.shape[-1] else self.hidden for a in (air.rssi, air.range))
        return air.link[:, k], rssi, distance

    def prior_world_rows(self) -> tuple[Belief, World, Rows]:
        """Return the prior, the world and the rows: all that a team knows before tick 0."""
        t, n = self.shape
        rows = Rows(*(freeze(a.reshape(t, n, *a.shape[1:])) for a in self.rows))
        return Belief(*(freeze(a) for a in self.stream.prior)), self.stream.world, rows

    def all_readings(self) -> Traffic:
        """Return the traffic of a centralised estimator: the finite readings that its robots upload."""
        senses, air = self.stream.senses, self.stream.air
        heard = (np.isfinite(a) & air.link for a in (air.rssi, air.range) if a.shape[-1])
        read = {c: a for c, a in senses.extra.items() if c != TEAM_PRIOR}  # which all know in advance
        sensed = (np.isfinite(a) for a in (*(getattr(senses, c) for c in SENSED), *read.values()))
        finite = sum(a.reshape(*senses.dt.shape, -1).sum(-1) for a in (*sensed, *heard))
        return Traffic((finite > 0).astype(float), np.where(finite > 0, finite * 8.0 + HEADER, 0.0))

    def belief(self, k: int) -> Belief:
        return self.require_shape(self.call("estimate", k, self.state), self.lead, f"estimate() at tick {k}")

    def require_shape(self, belief: Belief, lead: tuple[int, ...], where: str) -> Belief:
        d = self.stream.prior.x.shape[-1]
        if not (hasattr(belief, "x") and hasattr(belief, "P")):
            raise EstimatorError(f"{self.name}: {where} returned {type(belief).__name__}: return Belief(x, P)")
        for what, array, own in (("x", belief.x, (d,)), ("P", belief.P, (d, d))):
            if (found := np.shape(array)) != (*lead, *own):
                # A plain class knows one robot, or one trial's team: its part is named
                known = len(lead) if found[: len(lead)] == lead else int(found[:1] == lead[:1] and len(lead) > 1)
                shown, meant = (s[known:] for s in (found, (*lead, *own)))
                held = "x, y, heading" if d == 3 else "x, y"
                where = f"{where} of {self.stream.scenario!r} returned {what} of shape {shown}"
                where += "" if not known else " a robot" if known == len(lead) else " a trial"
                raise EstimatorError(f"{self.name}: {where}, not {meant}: a pose there is {held}")
        return Belief(belief.x, belief.P)


class Robots(_Loop):
    """An estimator on one row per (trial, robot); mail is carried between the rows of a trial."""

    team = False

    def start(self) -> None:
        prior = Belief(*(freeze(a.reshape(len(self.rows.key), *a.shape[2:])) for a in self.stream.prior))
        rows = Rows(*(freeze(a) for a in self.rows))
        self.state = self.call("init", -1, prior, self.stream.world, rows)

    def tick(self, k: int) -> tuple[Belief, Traffic]:
        z = self.senses(k)
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
        sent = np.asarray(sent)
        if not (sent.ndim in (2, 3) and len(sent) == t * n and (sent.ndim == 2 or sent.shape[1] == n)):
            raise EstimatorError(
                f"{self.name}: send() returned shape {sent.shape} at tick {k}, not ({t * n}, m) or ({t * n}, {n}, m)"
            )
        sent = sent if sent.dtype.kind == "f" else sent.astype(float)
        if sent.shape[-1] == 0 and sent.dtype == float:
            return self.silence
        return deliver(sent, self.stream.senses.dt[:, k] > 0, link, rssi, distance)  # who is asleep sends nothing

    @cached_property
    def silence(self) -> tuple[Mail, Traffic]:
        """Mail and traffic of an estimator that never transmits, the same in every tick."""
        (t, n), sent = self.shape, np.empty((len(self.rows.key), 0))
        return deliver(sent, np.ones((t, n), bool), np.zeros((t, n, n), bool), self.hidden, self.hidden)


class Team(_Loop):
    """An estimator with one state for the whole team; arrays are (trial, n, ...)."""

    team = True

    def start(self) -> None:
        if self.centralised:
            self.uplink = self.all_readings()
        self.state = self.call("init", -1, *self.prior_world_rows())

    def tick(self, k: int) -> tuple[Belief, Traffic]:
        z = self.senses(k)
        link, rssi, distance = self.air(k)
        t, n = self.shape
        heard = (a if a is self.hidden else lock(np.where(link, a, np.nan)) for a in (rssi, distance))
        air = Mail(freeze(link), lock(np.empty((t, n, n, 0))), *heard)
        self.state = self.call("predict", k, self.state, z)
        self.state = self.call("correct", k, self.state, z)
        self.state, traffic = self.call("exchange", k, self.state, z, air)
        if self.centralised:
            traffic = Traffic(self.uplink.messages[:, k], self.uplink.bytes[:, k])
        return self.belief(k), traffic


class Offline(_Loop):
    """An estimator that runs over all ticks at once, before tick 0; every tick then shows its part."""

    team = True

    def start(self) -> None:
        (t, n), z, air = self.shape, self.stream.senses, self.stream.air
        T = z.dt.shape[1]
        arrays = {c: freeze(getattr(z, c)) for c in (*SENSED, "dt")}
        senses = Senses(**arrays, extra={c: freeze(a) for c, a in z.extra.items()})
        absent = np.full((t, T, n, n), np.nan)
        heard = (np.where(air.link, a, np.nan) if a.shape[-1] else absent for a in (air.rssi, air.range))
        mail = Mail(*(freeze(a) for a in (air.link, np.empty((t, T, n, n, 0)), *heard)))
        self.uplink = self.all_readings()
        found = self.call("smooth", -1, *self.prior_world_rows(), senses, mail)
        self.state = self.require_shape(found, (t, T, n), "smooth()")

    def tick(self, k: int) -> tuple[Belief, Traffic]:
        return Belief(*(a[:, k] for a in self.state)), Traffic(*(a[:, k] for a in self.uplink))


def freeze(a: Any) -> Any:
    """Return a copy that cannot be written to, nor lead back to what it was cut from."""
    return np.ndarray(a.shape, a.dtype, a.tobytes())


def lock(a: Any) -> Any:
    """Return an array that nothing else uses, and that cannot be written to by mistake."""
    a.flags.writeable = False
    return a

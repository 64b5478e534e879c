"""Plain objects as estimators: `PerRobot` adapts a loop for one robot, `PerTeam` a loop for a whole team.

What a plain class needs around it is here: its parameters, the readings of its own row, random numbers for libraries
that use the global state, its radio, and its belief made fit for a run. Ranges below `TOO_NEAR_TO_RANGE` are absent for
it, and so are the bearings of the same sightings, as the shipped sensor models refuse them too.
"""

import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from copy import copy
from dataclasses import Field, dataclass
from inspect import Parameter, signature
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np

from cooploc.estimators.interface import (
    HEADER,
    TEAM_PRIOR,
    TOO_NEAR_TO_RANGE,
    Array,
    Belief,
    Keys,
    Mail,
    Mask,
    Motion,
    Rows,
    Senses,
    Sensor,
    Traffic,
    World,
)


def senses_of(z: Senses, i: int) -> Senses:
    """Return the senses of row, or trial, i."""
    arrays = {name: getattr(z, name)[i] for name in Senses._fields[:-1]}
    arrays |= {name: drop_short(arrays[name], arrays[name][..., :1]) for name in ("landmark", "sighting")}
    extra = {name: drop_short(a[i], a[i]) if name == "anchor_range" else a[i] for name, a in z.extra.items()}
    return Senses(**arrays, extra=extra)


def mail_of(mail: Mail, i: int) -> Mail:
    """Return the mail of row, or trial, i."""
    mine = Mail(*(a[i] for a in mail))
    return mine._replace(range=drop_short(mine.range, mine.range))


def drop_short(reading: Array, distance: Array) -> Array:
    """Return a reading, absent where its distance is too short."""
    short = distance < TOO_NEAR_TO_RANGE
    return np.where(short, np.nan, reading) if short.any() else reading


@contextmanager
def seed_global_state(key: Keys, *place: int) -> Iterator[None]:
    """Seed `random` and `numpy.random` for a block by a key (k,) and whole numbers of 0 or more; then restore them."""
    seeds = np.random.SeedSequence((*key.tolist(), *place))
    numpy_random: Any = np.random  # its stubs lack the bit generator of the global state
    before, generator = random.getstate(), numpy_random.get_bit_generator()
    state = numpy_random.get_state(legacy=False)
    try:
        random.seed(int(seeds.generate_state(1, np.uint64)[0]))
        numpy_random.set_bit_generator(np.random.MT19937(seeds))  # a tenth of the time of setting its state
        yield
    finally:
        random.setstate(before)
        numpy_random.set_bit_generator(generator)
        if state["has_gauss"]:  # the second of two normal numbers, which is not the bit generator's
            numpy_random.set_state(state)


def parameters(make: Callable[..., Any], given: tuple[str, ...]) -> dict[str, Parameter] | None:
    """Return what a class or function takes after the arguments that it is always given, by name; None: any name.

    Raises:
        TypeError: it cannot be called with `given`.

    """
    try:
        taken = list(signature(make).parameters.values())
    except ValueError:  # written in C
        return None
    if any(one.kind is one.VAR_KEYWORD for one in taken):
        return None
    placed = [one for one in taken if one.kind in (one.POSITIONAL_ONLY, one.POSITIONAL_OR_KEYWORD)]
    if len(placed) < len(given) and not any(one.kind is one.VAR_POSITIONAL for one in taken):
        has = ", ".join(one.name for one in placed)
        raise TypeError(f"{make.__name__} takes ({has}); it is called with ({', '.join(given)}), then its parameters")
    rest = [*placed[len(given) :], *(one for one in taken if one.kind is one.KEYWORD_ONLY)]
    return {one.name: one for one in rest}


def unpack_default(given: Any) -> Any:
    """Return the default of a `cl.tunable(...)`, anything else as it is."""
    return given.default if isinstance(given, Field) else given


# What `PerRobot` and `PerTeam` share: each has these fields, and these functions as its methods. `p` is one of them.
# An option that is not given in the call is read from the class, so that it can be named on the command line as it is.

STEPS = ("init", "predict", "correct", "send", "fuse", "exchange", "estimate")
OPTIONS = {"uses": ("odometry",), "axes": "", "notes": (), "own_random": False, "own_motion": ""}  # with their defaults
TEAM_OPTIONS = {**OPTIONS, "centralised": True, "bound": False}
A = TypeVar("A", bound="Adapter")


class Objects(NamedTuple):
    """The plain objects, one per row or one per trial. They change in place."""

    objects: tuple[Any, ...]
    key: Keys  # (r, 2), or (trial, n, 2)
    tick: int  # the last one that began; -1 before the first


def _set_fields(p: "Adapter", make: Callable[..., Any], options: Mapping[str, Any], given: dict[str, Any]) -> None:
    """Set the fields of an adapter from the call, else from the class; what is no option is a parameter."""
    values: dict[str, Any] = {"make": make}
    for name, default in options.items():
        one = given.pop(name, None)
        values["counted" if name == "notes" else name] = getattr(make, name, default) if one is None else one
    for name, one in {**values, "stated": tuple(sorted(given.items()))}.items():
        object.__setattr__(p, name, one)  # as the `__init__` of a frozen dataclass does
    _all_parameters(p)


def _all_parameters(p: "Adapter") -> dict[str, Any]:
    """Return every parameter's value, by name; TypeError where one is unknown or missing."""
    known, stated = parameters(p.make, p.given), dict(p.stated)
    if known is not None:
        if unknown := [key for key in stated if key not in known]:
            has = f"it has {', '.join(known)}" if known else "it has none"
            raise TypeError(f"{_name_of(p)} has no parameter {unknown[0]!r}; {has}")
        stated = {key: stated.get(key, one.default) for key, one in known.items()}
        if missing := [key for key, one in stated.items() if one is Parameter.empty]:
            raise TypeError(f"{_name_of(p)} needs {missing[0]}: give it a default, or state it, {missing[0]}=...")
    return {key: unpack_default(one) for key, one in stated.items()}


def tunable_fields(p: "Adapter") -> dict[str, Field[Any]]:
    """Return the fields that `cl.tunable(...)` made, in the class's signature or in the call, by parameter."""
    signed = [(key, one.default) for key, one in (parameters(p.make, p.given) or {}).items()]
    return {key: one for key, one in (*signed, *p.stated) if isinstance(one, Field)}


def _with_parameters(p: A, **changed: Any) -> A:
    """Return the same with some parameters changed; TypeError where the class has no such parameter."""
    other = copy(p)
    object.__setattr__(other, "stated", tuple(sorted({**dict(p.stated), **changed}.items())))
    _all_parameters(other)
    return other


def _name_of(p: "Adapter") -> str:
    return getattr(p.make, "__name__", type(p.make).__name__)


def _label_of(p: "Adapter") -> str:
    """Return the name with the parameters that were stated, as on the command line."""
    written = ",".join(f"{key}={unpack_default(one)}" for key, one in p.stated)
    return f"{_name_of(p)}[{written}]" if written else _name_of(p)


def _repr_of(p: "Adapter") -> str:
    return f"{type(p).__name__}({_label_of(p)})"


def _call_each(p: "Adapter", s: Objects, step: str, call: Callable[[Any, int], Any]) -> list[Any]:
    """Call a function with every object and its row, under a global random state of its own where it asks so."""
    found = []
    for i, one in enumerate(s.objects):
        place = s.tick + 1, STEPS.index(step)
        with seed_global_state(s.key[i].ravel(), *place) if p.own_random else nullcontext():
            found.append(call(one, i))
    return found


def _make_objects(p: "Adapter", prior: Belief, world: World, rows: Rows, who: Sequence[Any]) -> Objects:
    """Make the objects, each of its prior, the world, its entry of `who`, and its key."""
    beliefs = [Belief(x.copy(), P.copy()) for x, P in zip(*prior, strict=True)]  # a plain loop may write into them
    none, stated = Objects((None,) * len(beliefs), rows.key, -1), _all_parameters(p)
    made = _call_each(p, none, "init", lambda _, i: p.make(beliefs[i], world, *who[i], rows.key[i], **stated))
    return none._replace(objects=tuple(made))


def _predict(p: "Adapter", s: Objects, z: Senses) -> Objects:
    s = s._replace(tick=s.tick + 1)
    _call_each(p, s, "predict", lambda one, i: one.predict(senses_of(z, i)))
    return s


def _correct(p: "Adapter", s: Objects, z: Senses) -> Objects:
    _call_each(p, s, "correct", lambda one, i: one.correct(senses_of(z, i)))
    return s


def _estimate(p: "Adapter", s: Objects) -> Belief:
    beliefs = _call_each(p, s, "estimate", lambda one, _: parse_belief(one))
    return Belief(np.stack([b.x for b in beliefs]), np.stack([b.P for b in beliefs]))


def _count(p: "Adapter", s: Objects) -> Mapping[str, Array]:
    """Return the counts of the objects, (r,) or (trial, n) each."""
    shape = s.key.shape[1:-1]
    return {
        name: np.array([np.broadcast_to(getattr(one, name), shape) for one in s.objects], float) for name in p.counted
    }


ROUNDING = 1e-9  # of the largest entry


def parse_belief(one: Any) -> Belief:
    """Return the belief of an object, of its `estimate()` or its own `x` and `P`, made fit for a run.

    Libraries let a heading grow beyond pi, keep states as columns (d, 1), and leave P unsymmetric by rounding.
    """
    if hasattr(one, "estimate"):
        found = one.estimate()
    elif hasattr(one, "x") and hasattr(one, "P"):
        found = one.x, one.P
    else:
        name = type(one).__name__
        raise AttributeError(f"{name} has neither estimate() nor x and P: return cl.Belief(x, P), or set both")
    if not (isinstance(found, tuple | list) and len(found) == 2):
        raise ValueError(f"estimate() returned {type(found).__name__}; it must be cl.Belief(x, P), or x, P")
    x, P = (np.asarray(part, float) for part in found)
    if x.ndim == 2 and x.shape[1] == 1:
        x = x[:, 0]
    if (np.abs(x[..., 2:]) > np.pi).any():
        x = np.concatenate([x[..., :2], np.arctan2(np.sin(x[..., 2:]), np.cos(x[..., 2:]))], -1)
    square = P.ndim >= 2 and P.shape[-1] == P.shape[-2]
    if square and not np.array_equal(P, P.mT, equal_nan=True) and np.abs(P - P.mT).max() <= ROUNDING * np.abs(P).max():
        P = (P + P.mT) / 2
    return Belief(x, P)


@dataclass(frozen=True, init=False, repr=False)
class PerRobot:
    """Plain objects as an estimator, one per robot and trial: the filter loop one would write with filterpy.

        class MyLoop:
            uses = ("odometry", "anchor_rssi")
            def __init__(self, prior, world, robot, key, gate: float = 13.8): ...  # parameters after the first four
            def predict(self, z): ...       # z.odometry (k,), z.dt
            def correct(self, z): ...       # z.anchor_rssi (a,), z.landmark (l, 2), or world.fixed(z)
            def send(self): ...             # (m,) numbers; optional
            def fuse(self, mail): ...       # mail.packets (n, m) where mail.heard (n,); optional
            def estimate(self): ...         # x (d,), P (d, d); not needed where these are self.x and self.P

    Run `PerRobot(MyLoop, gate=9)`, or name it on the command line, `path.py:MyLoop[gate=9]`. A batched version is about
    fifty times faster.

    Args:
        make: the class, or a function with the same arguments.
        uses: the channels that it reads, as `Estimator` says.
        axes: why its estimates do not turn with the world, as those of an unscented filter do not.
        notes: names of attributes of the objects, numbers that they count; shown under the table.
        own_random: whether it uses a library that draws from the global state of `random` or `numpy.random`: each call
            then has a state of its own, by trial, robot and tick.
        own_motion: why it does not move as dead reckoning does where it has odometry alone.
        parameters: what `make` takes beside; a default `cl.tunable(...)`, in its signature or here, may be tuned.

    Raises:
        TypeError: `make` does not take the four arguments, or has no such parameter.

    """

    make: Callable[..., Any]
    uses: tuple[str, ...]
    axes: str
    counted: tuple[str, ...]
    own_random: bool
    own_motion: str
    stated: tuple[tuple[str, Any], ...]  # parameters that differ from their defaults
    api: ClassVar[int] = 1
    mutable: ClassVar[bool] = True  # exempt from the check that a method leaves the state it is given alone
    given: ClassVar[tuple[str, ...]] = ("prior", "world", "robot", "key")

    def __init__(self, make: Callable[..., Any], uses: tuple[str, ...] | None = None, **options: Any) -> None:
        _set_fields(self, make, OPTIONS, {"uses": uses, **options})

    label = property(_label_of)
    trained_on = property(lambda self: str(getattr(self.make, "trained_on", "")))
    parameters = property(_all_parameters)
    with_parameters = _with_parameters
    __repr__ = _repr_of
    predict = _predict
    correct = _correct
    estimate = _estimate
    notes = _count

    def init(self, prior: Belief, world: World, rows: Rows) -> Objects:
        return _make_objects(self, prior, world, rows, [(robot,) for robot in rows.robot.tolist()])

    def send(self, s: Objects, z: Senses) -> Array:
        sent = _call_each(self, s, "send", lambda robot, _: robot.send() if hasattr(robot, "send") else ())
        packets = [np.array(packet, float) for packet in sent]
        if wrong := [packet.shape for packet in packets if packet.ndim != 1]:
            raise ValueError(f"send() returned shape {wrong[0]}; it must be one axis of numbers")
        widths = {len(packet) for packet in packets}
        if len(widths) > 1:
            raise ValueError(f"send() returned packets of {sorted(widths)} numbers; fill the shorter ones with nan")
        return np.stack(packets)

    def fuse(self, s: Objects, z: Senses, mail: Mail) -> Objects:
        _call_each(self, s, "fuse", lambda robot, i: hasattr(robot, "fuse") and robot.fuse(mail_of(mail, i)))
        return s


class Radio:
    """The radio of a team that one object runs, in one tick; axis 0 is the receiver, axis 1 the sender.

    Attributes:
        heard (n, n): who has received a packet of whom in this tick.
        rssi, range (n, n): readings [dBm], [m] of those packets; nan elsewhere.
        messages, bytes (n,): what each robot has sent in this tick.

    """

    def __init__(self, air: Mail, awake: Mask, centralised: bool = False) -> None:
        """Begin a tick over the links `air.heard`; a centralised team has heard everything from the start."""
        self._air, self._awake = air, awake
        self.heard: Mask = air.heard.copy() if centralised else np.zeros_like(air.heard)
        self.rssi, self.range = (np.where(self.heard, a, np.nan) for a in (air.rssi, air.range))
        self.messages, self.bytes = np.zeros(len(awake)), np.zeros(len(awake))

    def send(self, sender: int, receiver: int, numbers: Sequence[float] | Array) -> Array | None:
        """Send a packet (m,) to one teammate, which costs the sender one message; return it, None where it is lost.

        One of nothing but nan, or of a sender that is asleep, is neither sent nor paid.
        """
        if sender == receiver:
            raise ValueError(f"robot {sender} sends a packet to itself; it has what it would send")
        packet = self._pay(sender, numbers)
        return packet if packet is not None and self._deliver(sender, receiver) else None

    def broadcast(self, sender: int, numbers: Sequence[float] | Array) -> list[int]:
        """Send a packet (m,) to everyone, which costs the sender one message; return the robots that received it."""
        if self._pay(sender, numbers) is None:
            return []
        return [receiver for receiver in range(len(self._awake)) if self._deliver(sender, receiver)]

    def _pay(self, sender: int, numbers: Sequence[float] | Array) -> Array | None:
        packet = np.array(numbers, float).ravel()
        if not self._awake[sender] or (packet.size and np.isnan(packet).all()):
            return None
        self.messages[sender] += 1
        self.bytes[sender] += 8.0 * np.isfinite(packet).sum() + HEADER
        return packet

    def _deliver(self, sender: int, receiver: int) -> bool:
        place = receiver, sender
        if not self._air.heard[place]:
            return False
        self.heard[place] = True
        self.rssi[place], self.range[place] = self._air.rssi[place], self._air.range[place]
        return True


@dataclass(frozen=True, init=False, repr=False)
class PerTeam:
    """Plain objects as an estimator, one per trial: a loop over a whole team, as one writes it in a script.

        class MyTeam:
            uses = ("odometry", "anchor_rssi", "radio_range")
            centralised = False             # the default is True
            def __init__(self, prior, world, keys, gate: float = 13.8): ...  # prior x (n, d), P (n, d, d); keys (n, 2)
            def predict(self, z): ...       # z.odometry (n, k), z.dt (n,)
            def correct(self, z): ...       # z.anchor_rssi (n, a), z.landmark (n, l, 2), or world.fixed(z)
            def exchange(self, z, radio): ...  # between robots: z.sighting (n, n, 2), world.relative(z, radio)
            def estimate(self): ...         # x (n, d), P (n, d, d); not needed where these are self.x and self.P

    A *centralised* team may use everything in `exchange`; the runner counts the readings that its robots upload. A
    *distributed* one sends packets by `radio.send` and `radio.broadcast`, each 8 bytes for each finite number and a
    header, paid whether it arrives or not; a radio reading of a teammate exists once it was heard. No check can see
    what one robot read of another in one object's memory: its bytes are as declared.

    Args:
        make: the class, or a function with the same arguments.
        uses, axes, notes, own_random, own_motion, parameters: as those of `PerRobot`.
        centralised: whether all readings reach one computer; then the runner counts what its robots upload.
        bound: whether it uses all readings as well as any estimator could.

    Raises:
        TypeError: `make` does not take the three arguments, or has no such parameter.

    """

    make: Callable[..., Any]
    uses: tuple[str, ...]
    axes: str
    counted: tuple[str, ...]
    own_random: bool
    own_motion: str
    centralised: bool
    bound: bool
    stated: tuple[tuple[str, Any], ...]
    api: ClassVar[int] = 1
    mutable: ClassVar[bool] = True
    given: ClassVar[tuple[str, ...]] = ("prior", "world", "keys")

    def __init__(self, make: Callable[..., Any], uses: tuple[str, ...] | None = None, **options: Any) -> None:
        _set_fields(self, make, TEAM_OPTIONS, {"uses": uses, **options})

    label = property(_label_of)
    trained_on = property(lambda self: str(getattr(self.make, "trained_on", "")))
    parameters = property(_all_parameters)
    with_parameters = _with_parameters
    __repr__ = _repr_of
    predict = _predict
    correct = _correct
    estimate = _estimate
    notes = _count

    def init(self, prior: Belief, world: World, rows: Rows) -> Objects:
        return _make_objects(self, prior, world, rows, [()] * len(prior.x))

    def exchange(self, s: Objects, z: Senses, air: Mail) -> tuple[Objects, Traffic]:
        radios = [Radio(mail_of(air, i), z.dt[i] > 0, self.centralised) for i in range(len(s.objects))]
        _call_each(self, s, "exchange", lambda team, i: team.exchange(senses_of(z, i), radios[i]))
        return s, Traffic(np.stack([one.messages for one in radios]), np.stack([one.bytes for one in radios]))


Adapter = PerRobot | PerTeam


# A tick's motion and readings as functions of the state, for filters of libraries:
#
#     step = cl.motion_of(world, z)
#     ukf.Q = step.Q(ukf.x)
#     ukf.predict(fx=lambda x, dt: step.f(x))
#     for one in cl.readings_of(world, z):
#         ukf.update(one.z, one.R, hx=one.h)     # or, with a linear one: kf.update(*one.linear(kf.x))
#
# A heading goes on beyond pi, so that sigma points have their mean between them, and h(x) is within pi of the reading.


class Linear(NamedTuple):
    """A motion about a state: x' = F x + c."""

    F: Array  # (d, d)
    c: Array  # (d,)
    Q: Array  # (d, d)


class LinearReading(NamedTuple):
    """A reading about a state, as a linear filter takes it: z = H x + noise."""

    z: Array  # (k,)
    R: Array  # (k, k)
    H: Array  # (k, d)


@dataclass(frozen=True)
class Step:
    """The motion of states (..., d) by one tick's odometry."""

    motion: Motion
    odometry: Array  # (k,)
    dt: Array  # () [s]

    def f(self, x: Array) -> Array:
        """Return x' (..., d); a heading is not wrapped, but goes on from that of x."""
        return _unwrap(x, self.motion.move(x, self.odometry, self.dt)[0])

    def sample(self, x: Array, noise: Array) -> Array:
        """Return f(x) with the odometry's error drawn: `noise` (..., 2) is standard normal."""
        return _unwrap(x, self.motion.sample(x, self.odometry, self.dt, noise))

    def Q(self, x: Array) -> Array:
        """Return the covariance of its error (..., d, d)."""
        return self.motion.move(x, self.odometry, self.dt)[2]

    def linear(self, x: Array) -> Linear:
        """Return F, c and Q about a state (d,)."""
        _, F, Q = self.motion.move(x, self.odometry, self.dt)
        return Linear(F, self.f(x) - F @ x, Q)


@dataclass(frozen=True)
class Reading:
    """A reading (k,) of a fixed thing."""

    sensor: Sensor
    place: Array  # (2,)
    z: Array  # (k,)

    @property
    def R(self) -> Array:
        """Its covariance (k, k)."""
        return self.sensor.R

    def h(self, x: Array) -> Array:
        """Return the reading without noise (..., k) at states (..., d); an angle is within pi of that of z."""
        return self.z - self.sensor.innovation(x, self.place, self.z)[0]

    def H(self, x: Array) -> Array:
        """Return dh/dx (..., k, d)."""
        return self.sensor.innovation(x, self.place, self.z)[1]

    def linear(self, x: Array) -> LinearReading:
        """Return z - h(x) + H x, R and H about a state (d,)."""
        y, H, _ = self.sensor.innovation(x, self.place, self.z)
        return LinearReading(y + H @ x, self.R, H)


def motion_of(world: World, z: Senses) -> Step:
    """Return the motion of one robot in one tick."""
    return Step(world.motion, z.odometry, z.dt)


def priors_of(z: Senses) -> Belief:
    """Return everyone's belief before tick 0, x (..., n, d) and P (..., n, d, d), where the scenario tells it.

    It is the channel "team_prior", the same in every tick; `uses` must name it, else this is a KeyError.
    """
    if TEAM_PRIOR not in z.extra:
        raise KeyError(f'no {TEAM_PRIOR}: name it in `uses`, in a scenario such as "trajectory[team_priors=true]"')
    priors = z.extra[TEAM_PRIOR]
    d = 2 if priors.shape[-1] == 6 else 3
    return Belief(priors[..., :d], priors[..., d:].reshape(*priors.shape[:-1], d, d))


def readings_of(world: World, z: Senses) -> Iterator[Reading]:
    """Return one robot's readings of anchors and landmarks in one tick; absent ones are left out."""
    return (Reading(*one) for one in world.fixed(z) if np.isfinite(one[2]).all())


def _unwrap(x: Array, moved: Array) -> Array:
    """Return moved states, their headings within pi of those of x."""
    turn = moved[..., 2:] - x[..., 2:]
    return np.concatenate([moved[..., :2], x[..., 2:] + np.arctan2(np.sin(turn), np.cos(turn))], -1)

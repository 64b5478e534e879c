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
    arrays |= {name: without_short(arrays[name], arrays[name][..., :1]) for name in ("landmark", "sighting")}
    extra = {name: a[i] for name, a in z.extra.items()}
    extra |= {name: without_short(a, a) for name, a in extra.items() if name == "anchor_range"}
    return Senses(**arrays, extra=extra)


def mail_of(mail: Mail, i: int) -> Mail:
    """Return the mail of row, or trial, i."""
    mine = Mail(*(a[i] for a in mail))
    return mine._replace(range=without_short(mine.range, mine.range))


def without_short(reading: Array, distance: Array) -> Array:
    """A reading, absent where its distance is too short."""
    short = distance < TOO_NEAR_TO_RANGE
    return np.where(short, np.nan, reading) if short.any() else reading


# Random numbers for libraries that draw from the global state of `random` or `numpy.random`, as filterpy's EnKF does.
#
# While a block runs, both states are seeded by a robot's key and the place of the call, so the same call draws the same
# numbers in any order, process and company; afterwards they are as they were.

numpy_random: Any = np.random  # its stubs lack the bit generator of the global state


@contextmanager
def seed_global_state(key: Keys, *place: int) -> Iterator[None]:
    """Seed the global generators for a block by a key (k,) and whole numbers of 0 or more; then restore them."""
    seeds = np.random.SeedSequence((*key.tolist(), *place))
    before, state, generator = random.getstate(), _state(), numpy_random.get_bit_generator()
    try:
        random.seed(int(seeds.generate_state(1, np.uint64)[0]))
        numpy_random.set_bit_generator(np.random.MT19937(seeds))  # a tenth of the time of setting its state
        yield
    finally:
        random.setstate(before)
        numpy_random.set_bit_generator(generator)
        if state["has_gauss"]:  # the second of two normal numbers, which is not the bit generator's
            np.random.set_state(state)  # noqa: NPY002


def _state() -> Any:
    return np.random.get_state(legacy=False)  # noqa: NPY002


# The parameters of a plain class or function: what it takes beside what it is always given.
#
# A default may be `cl.tunable(...)`, as in a dataclass: the class gets its default, and `cooploc tune` may change it.


def parameters(make: Callable[..., Any], given: tuple[str, ...]) -> dict[str, Parameter] | None:
    """Those of a class or function after the arguments that it is always given, by name.

    Returns:
        None: it takes any name (`**rest`), or does not say what it takes.

    Raises:
        TypeError: it cannot be called with what it is given.

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


def value(given: Any) -> Any:
    """The default of a `cl.tunable(...)`, anything else as it is."""
    return given.default if isinstance(given, Field) else given


# What `PerRobot` and `PerTeam` share: each has these fields, and these functions as its methods. `p` is one of them.
#
# What is not said in the call is read from the class, so that it can be named on the command line as it is:
#
#     class Ukf:
#         uses = ("odometry", "anchor_rssi")
#         axes = "its sigma points lie along the axes"
#         def __init__(self, prior, world, robot, key, alpha: float = cl.tunable(0.5, 0.01, 1, log=True)): ...

STEPS = ("init", "predict", "correct", "send", "fuse", "exchange", "estimate")
SAID = {"uses": ("odometry",), "axes": "", "notes": (), "own_random": False, "own_motion": ""}  # with their defaults
SAID_OF_TEAMS = {**SAID, "centralised": True, "bound": False}
A = TypeVar("A", bound="Adapter")


class Objects(NamedTuple):
    """The plain objects, one per row or one per trial. They change in place."""

    objects: tuple[Any, ...]
    key: Keys  # (r, 2), or (trial, n, 2)
    tick: int  # the last one that began; -1 before the first


def _describe(p: "Adapter", make: Callable[..., Any], defaults: Mapping[str, Any], said: dict[str, Any]) -> None:
    """Set the fields of an adapter from what was said in the call, else in the class; the rest are parameters."""
    fields: dict[str, Any] = {"make": make}
    for name, default in defaults.items():
        one = said.pop(name, None)
        fields["counted" if name == "notes" else name] = getattr(make, name, default) if one is None else one
    for name, one in {**fields, "stated": tuple(sorted(said.items()))}.items():
        object.__setattr__(p, name, one)  # as the `__init__` of a frozen dataclass does
    _all_parameters(p)


def _all_parameters(p: "Adapter") -> dict[str, Any]:
    """Every parameter's value, by name.

    Raises:
        TypeError: one that is not known, or one without a default, was not stated.

    """
    known, stated = parameters(p.make, p.given), dict(p.stated)
    if known is not None:
        for key in stated:
            if key not in known:
                has = f"it has {', '.join(known)}" if known else "it has none"
                raise TypeError(f"{_name_of(p)} has no parameter {key!r}; {has}")
        missing = [key for key, one in known.items() if one.default is one.empty and key not in stated]
        if missing:
            raise TypeError(f"{_name_of(p)} needs {missing[0]}: give it a default, or state it, {missing[0]}=...")
        stated = {key: stated.get(key, one.default) for key, one in known.items()}
    return {key: value(one) for key, one in stated.items()}


def tunable_fields(p: "Adapter") -> dict[str, Field[Any]]:
    """Return the fields that `cl.tunable(...)` made, in the class's signature or in the call, by parameter."""
    signed = [(key, one.default) for key, one in (parameters(p.make, p.given) or {}).items()]
    return {key: one for key, one in (*signed, *p.stated) if isinstance(one, Field)}


def _with_parameters(p: A, **changed: Any) -> A:
    """The same with some parameters changed.

    Raises:
        TypeError: the class has no such parameter.

    """
    other = copy(p)
    object.__setattr__(other, "stated", tuple(sorted({**dict(p.stated), **changed}.items())))
    _all_parameters(other)
    return other


def _name_of(p: "Adapter") -> str:
    return getattr(p.make, "__name__", type(p.make).__name__)


def _label_of(p: "Adapter") -> str:
    """The name with the parameters that were stated, as on the command line."""
    written = ",".join(f"{key}={value(one)}" for key, one in p.stated)
    return f"{_name_of(p)}[{written}]" if written else _name_of(p)


def _repr_of(p: "Adapter") -> str:
    written = "".join(f", {key}={value(one)!r}" for key, one in p.stated)
    return f"{type(p).__name__}({_name_of(p)}{written})"


def _trained_on(p: "Adapter") -> str:
    """Return the training that the class states."""
    return str(getattr(p.make, "trained_on", ""))


def _call_each(p: "Adapter", s: Objects, step: str, call: Callable[[Any, int], Any]) -> list[Any]:
    """Call a function with every object and its row, under a global random state of its own where it asks so."""
    found = []
    for i, one in enumerate(s.objects):
        place = s.tick + 1, STEPS.index(step)
        with seed_global_state(s.key[i].ravel(), *place) if p.own_random else nullcontext():
            found.append(call(one, i))
    return found


def _make_objects(p: "Adapter", prior: Belief, world: World, rows: Rows, who: Sequence[Any]) -> Objects:
    """The objects, each made of its prior, the world, its entry of `who`, and its key."""
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


# What a plain object believes: what its `estimate()` returns, or its own `x` and `P`, made fit for a run.
#
# Libraries let a heading grow beyond pi, keep states as columns, and leave a covariance unsymmetric by rounding. None
# of this is worth a line in every plug-in; whatever is more than rounding stays as it is, and is refused where it is
# wrong.

ROUNDING = 1e-9  # of the largest entry


def parse_belief(one: Any) -> Belief:
    """The belief of an object: headings in (-pi, pi], P symmetric; a state (d, 1) is one (d,).

    Raises:
        AttributeError: it has neither `estimate()` nor `x` and `P`.
        ValueError: `estimate()` returned something else than x and P.

    """
    if not hasattr(one, "estimate"):
        if not (hasattr(one, "x") and hasattr(one, "P")):
            raise AttributeError(
                f"{type(one).__name__} has neither estimate() nor x and P: return cl.Belief(x, P), or set both"
            )
        found = one.x, one.P
    else:
        found = one.estimate()
    if not (isinstance(found, tuple | list) and len(found) == 2):
        raise ValueError(f"estimate() returned {type(found).__name__}; it must be cl.Belief(x, P), or x, P")
    x, P = (np.asarray(part, float) for part in found)
    if x.ndim == 2 and x.shape[1] == 1:
        x = x[:, 0]
    return Belief(_in_turn(x), _symmetric(P))


def _in_turn(x: Array) -> Array:
    """States (..., d) with the heading in (-pi, pi]; those that are, bit by bit as they were."""
    heading = x[..., 2:]
    if not (np.abs(heading) > np.pi).any():
        return x
    return np.concatenate([x[..., :2], np.arctan2(np.sin(heading), np.cos(heading))], -1)


def _symmetric(P: Array) -> Array:
    """P (..., d, d) without the asymmetry that rounding makes; any other is left for the run to refuse."""
    if P.ndim < 2 or P.shape[-1] != P.shape[-2] or np.array_equal(P, P.mT, equal_nan=True):
        return P
    off, scale = np.abs(P - P.mT).max(), np.abs(P).max()
    return (P + P.mT) / 2 if off <= ROUNDING * scale else P


# A plain object that runs on one robot: the filter loop one would write with filterpy.
#
# Write a class for a single robot, as below, and run `PerRobot(MyLoop, gate=9.0)`, or name it on the command line,
# `path.py:MyLoop[gate=9]`. It is the quick way to begin, and a reference to test a batched version against, which is
# about fifty times faster.
#
#     class MyLoop:
#         uses = ("odometry", "anchor_rssi")
#         def __init__(self, prior, world, robot, key, gate: float = 13.8): ...  # parameters after the first four
#         def predict(self, z): ...       # z.odometry (k,), z.dt
#         def correct(self, z): ...       # z.anchor_rssi (a,), z.landmark (l, 2), or world.fixed(z)
#         def send(self): ...             # (m,) numbers; optional
#         def fuse(self, mail): ...       # mail.packets (n, m) where mail.heard (n,); optional
#         def estimate(self): ...         # x (d,), P (d, d); not needed where the object has these as self.x and self.P


@dataclass(frozen=True, init=False, repr=False)
class PerRobot:
    """One object per robot and trial, made by `make(prior, world, robot, key, **parameters)`: a class, or a function.

    Args:
        make: what makes an object from its robot's prior (x (d,), P (d, d)), the world, the robot's number and its key.
        uses: the channels that it reads, as `Estimator` says.
        axes: why its estimates do not turn with the world, as those of an unscented filter do not.
        notes: names of attributes of the objects, numbers that they count; shown under the table.
        own_random: whether it uses a library that draws from the global state of `random` or `numpy.random`: each call
            is then given one of its own, by trial, robot and tick, and the global state is restored afterwards.
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

    def __init__(self, make: Callable[..., Any], uses: tuple[str, ...] | None = None, **said: Any) -> None:
        _describe(self, make, SAID, {"uses": uses, **said})

    label = property(_label_of)
    trained_on = property(_trained_on)
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
        said = _call_each(self, s, "send", lambda robot, _: _packet_of(robot))
        widths = {len(packet) for packet in said}
        if len(widths) > 1:
            raise ValueError(f"send() returned packets of {sorted(widths)} numbers; fill the shorter ones with nan")
        return np.stack(said)

    def fuse(self, s: Objects, z: Senses, mail: Mail) -> Objects:
        _call_each(self, s, "fuse", lambda robot, i: hasattr(robot, "fuse") and robot.fuse(mail_of(mail, i)))
        return s


def _packet_of(robot: Any) -> Array:
    """Return the packet (m,) of a robot; nothing where it has no `send`."""
    said: Array = np.array(robot.send(), float) if hasattr(robot, "send") else np.empty(0)
    if said.ndim != 1:
        raise ValueError(f"send() returned shape {said.shape}; it must be one axis of numbers")
    return said


# The radio of a team that one object runs: packets over the links that hold, and who pays for them.


class Radio:
    """One tick's radio; axis 0 is the receiver, axis 1 the sender, as in `Mail`.

    Attributes:
        heard (n, n): who has received a packet of whom in this tick.
        rssi, range (n, n): readings [dBm], [m] of those packets; nan elsewhere.
        messages, bytes (n,): what each robot has sent in this tick.

    """

    def __init__(self, air: Mail, awake: Mask, centralised: bool = False) -> None:
        """A radio over the links `air.heard`; of a centralised team everything is known from the start."""
        self._air, self._awake = air, awake
        self.heard: Mask = air.heard.copy() if centralised else np.zeros_like(air.heard)
        self.rssi, self.range = (np.where(self.heard, a, np.nan) for a in (air.rssi, air.range))
        self.messages, self.bytes = np.zeros(len(awake)), np.zeros(len(awake))

    def send(self, sender: int, receiver: int, numbers: Sequence[float] | Array) -> Array | None:
        """A packet (m,) to one teammate, which costs the sender one message.

        Returns:
            The packet as the receiver gets it; None where it does not arrive, or the sender is asleep. A packet of
            nothing but nan is silence: it is neither sent nor paid.

        Raises:
            ValueError: a robot sends to itself.

        """
        if sender == receiver:
            raise ValueError(f"robot {sender} sends a packet to itself; it has what it would send")
        packet = self._paid(sender, numbers)
        return packet if packet is not None and self._arrives(sender, receiver) else None

    def broadcast(self, sender: int, numbers: Sequence[float] | Array) -> list[int]:
        """A packet (m,) to everyone, which costs the sender one message; who received it."""
        if self._paid(sender, numbers) is None:
            return []
        return [receiver for receiver in range(len(self._awake)) if self._arrives(sender, receiver)]

    def _paid(self, sender: int, numbers: Sequence[float] | Array) -> Array | None:
        packet = np.array(numbers, float).ravel()
        if not self._awake[sender] or (packet.size and np.isnan(packet).all()):
            return None
        self.messages[sender] += 1
        self.bytes[sender] += 8.0 * np.isfinite(packet).sum() + HEADER
        return packet

    def _arrives(self, sender: int, receiver: int) -> bool:
        place = receiver, sender
        if not self._air.heard[place]:
            return False
        self.heard[place] = True
        self.rssi[place], self.range[place] = self._air.rssi[place], self._air.range[place]
        return True


# A plain object that holds a whole team: a loop over robots, as one writes it in a script.
#
#     class MyTeam:
#         uses = ("odometry", "anchor_rssi", "radio_range")
#         centralised = False             # the default is True
#         def __init__(self, prior, world, keys, gate: float = 13.8): ...  # prior x (n, d), P (n, d, d); keys (n, 2)
#         def predict(self, z): ...       # z.odometry (n, k), z.dt (n,)
#         def correct(self, z): ...       # z.anchor_rssi (n, a), z.landmark (n, l, 2), or world.fixed(z)
#         def exchange(self, z, radio): ...  # readings between robots: z.sighting (n, n, 2), world.relative(z, radio)
#         def estimate(self): ...         # x (n, d), P (n, d, d); not needed where these are self.x and self.P
#
# A *centralised* team may use everything in `exchange`; each of its robots pays for the readings it uploads, which the
# runner counts: 8 bytes for each finite number that `uses` selects, and a header. A *distributed* team sends packets by
# `radio.send` and `radio.broadcast`. The sender pays for each, whether it arrives or not, 8 bytes for each finite
# number and a header. A robot that does not hear a packet gets None, and a radio reading of a teammate exists once a
# packet of it was heard. As all share one object's memory, a check cannot see what one robot read of another: the bytes
# of a distributed team are shown as declared, those of `PerRobot` are counted.


@dataclass(frozen=True, init=False, repr=False)
class PerTeam:
    """One object per trial, made by `make(prior, world, keys, **parameters)`: a class, or a function.

    Args:
        make: what makes an object from the team's priors, the world, and the robots' keys.
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

    def __init__(self, make: Callable[..., Any], uses: tuple[str, ...] | None = None, **said: Any) -> None:
        _describe(self, make, SAID_OF_TEAMS, {"uses": uses, **said})

    label = property(_label_of)
    trained_on = property(_trained_on)
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


# A tick's motion and readings as functions of the state: what other people's filters ask for.
#
# Libraries of sigma points, particles and factors take f(x) and h(x), linear ones take matrices; both take the noise:
#
#     step = cl.motion_of(world, z)
#     ukf.Q = step.Q(ukf.x)
#     ukf.predict(fx=lambda x, dt: step.f(x))
#     for one in cl.readings_of(world, z):
#         ukf.update(one.z, one.R, hx=one.h)     # or, with a linear one: kf.update(*one.linear(kf.x))
#
# Angles need no care of the library's: a heading goes on beyond pi, so that points have their mean between them, and
# h(x) is within pi of the reading, so that z - h(x) is the innovation.


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
        """x' (..., d); a heading is not wrapped, but goes on from that of x."""
        return _on(x, self.motion.move(x, self.odometry, self.dt)[0])

    def sample(self, x: Array, noise: Array) -> Array:
        """As f, with the odometry's error drawn: `noise` (..., 2) is standard normal."""
        return _on(x, self.motion.sample(x, self.odometry, self.dt, noise))

    def Q(self, x: Array) -> Array:
        """The covariance of its error (..., d, d)."""
        return self.motion.move(x, self.odometry, self.dt)[2]

    def linear(self, x: Array) -> Linear:
        """F, c and Q about a state (d,)."""
        _, F, Q = self.motion.move(x, self.odometry, self.dt)
        return Linear(F, self.f(x) - F @ x, Q)


@dataclass(frozen=True)
class Reading:
    """One reading (k,) of a fixed thing."""

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
        """dh/dx (..., k, d)."""
        return self.sensor.innovation(x, self.place, self.z)[1]

    def linear(self, x: Array) -> LinearReading:
        """z - h(x) + H x, R and H about a state (d,)."""
        y, H, _ = self.sensor.innovation(x, self.place, self.z)
        return LinearReading(y + H @ x, self.R, H)


def motion_of(world: World, z: Senses) -> Step:
    """The motion of one robot in one tick."""
    return Step(world.motion, z.odometry, z.dt)


def priors_of(z: Senses) -> Belief:
    """Everyone's belief before tick 0, x (..., n, d) and P (..., n, d, d), where the scenario tells it.

    It is the channel "team_prior", the same in every tick; `uses` must name it.

    Raises:
        KeyError: the stream has no such channel, or `uses` does not name it.

    """
    if TEAM_PRIOR not in z.extra:
        raise KeyError(f'no {TEAM_PRIOR}: name it in `uses`, in a scenario such as "trajectory[team_priors=true]"')
    told = z.extra[TEAM_PRIOR]
    d = 2 if told.shape[-1] == 6 else 3
    return Belief(told[..., :d], told[..., d:].reshape(*told.shape[:-1], d, d))


def readings_of(world: World, z: Senses) -> Iterator[Reading]:
    """One robot's readings of anchors and landmarks in one tick; those that are absent, or in part, are left out."""
    return (Reading(*one) for one in world.fixed(z) if np.isfinite(one[2]).all())


def _on(x: Array, moved: Array) -> Array:
    """The states that were moved, their headings within pi of those of x."""
    turn = moved[..., 2:] - x[..., 2:]
    return np.concatenate([moved[..., :2], x[..., 2:] + np.arctan2(np.sin(turn), np.cos(turn))], -1)

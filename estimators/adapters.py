"""Plain objects as estimators: `PerRobot` adapts a loop for one robot, `PerTeam` a loop for a whole team.

Ranges below `TOO_NEAR_TO_RANGE` are absent for it, and so are the bearings of the same sightings.
"""

import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from copy import copy
from dataclasses import Field, dataclass
from inspect import Parameter, signature
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from cooploc.estimators import interface
from cooploc.estimators.interface import Array, Belief, Keys, Mail, Mask, Rows, Senses, Sensor, Traffic, World


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
    short = distance < interface.TOO_NEAR_TO_RANGE
    return np.where(short, np.nan, reading) if short.any() else reading


_numpy: Any = np.random  # whose global state libraries draw from, as they do from that of `random`


@contextmanager
def keep_global_state() -> Iterator[None]:
    """Restore the global state of both after a block."""
    mine, theirs, own = random.getstate(), _numpy.get_state(), _numpy.get_bit_generator()
    try:
        yield
    finally:
        random.setstate(mine)
        _numpy.set_bit_generator(own)
        _numpy.set_state(theirs)


def seed_global_state(key: Keys, *place: int) -> None:
    """Seed both by a key (k,) and whole numbers of 0 or more."""
    seeds = np.random.SeedSequence((*key.tolist(), *place))
    random.seed(int(seeds.generate_state(1, np.uint64)[0]))
    _numpy.set_bit_generator(np.random.MT19937(seeds))  # ten times as fast as set_state


def parameters(make: Callable[..., Any], given: tuple[str, ...]) -> dict[str, Parameter] | None:
    """Return what a class or function takes after those `given`, by name; None: any name; TypeError: not even these."""
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


STEPS = ("init", "predict", "correct", "send", "fuse", "exchange", "estimate")


class Objects(NamedTuple):
    """The plain objects, one per row or one per trial. They change in place."""

    objects: tuple[Any, ...]
    key: Keys  # (r, 2), or (trial, n, 2)
    tick: int  # the last one that began; -1 before the first


@dataclass(frozen=True, init=False, repr=False)
class Adapter:
    """The common part of `PerRobot` and `PerTeam`.

    An option that is not given in the call is read from the class, so that it can be named on the command line as it
    is; what is no option is a parameter.
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
    given: ClassVar[tuple[str, ...]]  # what `make` is always given
    options: ClassVar[dict[str, Any]] = {
        "uses": ("odometry",),
        "axes": "",
        "notes": (),
        "own_random": False,
        "own_motion": "",
    }

    def __init__(self, make: Callable[..., Any], uses: tuple[str, ...] | None = None, **given: Any) -> None:
        given["uses"] = uses
        values: dict[str, Any] = {"make": make}
        for name, default in self.options.items():
            one = given.pop(name, None)
            values["counted" if name == "notes" else name] = getattr(make, name, default) if one is None else one
        for name, one in {**values, "stated": tuple(sorted(given.items()))}.items():
            object.__setattr__(self, name, one)  # as the `__init__` of a frozen dataclass does
        self.parameters  # noqa: B018  TypeError where one is unknown or missing

    @property
    def parameters(self) -> dict[str, Any]:
        """Return every parameter's value, by name; TypeError where one is unknown or missing."""
        known, stated = parameters(self.make, self.given), dict(self.stated)
        if known is not None:
            if unknown := [key for key in stated if key not in known]:
                has = f"it has {', '.join(known)}" if known else "it has none"
                raise TypeError(f"{self._name} has no parameter {unknown[0]!r}; {has}")
            stated = {key: stated.get(key, one.default) for key, one in known.items()}
            if missing := [key for key, one in stated.items() if one is Parameter.empty]:
                raise TypeError(f"{self._name} needs {missing[0]}: give it a default, or state it, {missing[0]}=...")
        return {key: unpack_default(one) for key, one in stated.items()}

    def with_parameters(self, **changed: Any) -> Self:
        """Return the same with some parameters changed; TypeError where the class has no such parameter."""
        other = copy(self)
        object.__setattr__(other, "stated", tuple(sorted({**dict(self.stated), **changed}.items())))
        other.parameters  # noqa: B018
        return other

    @property
    def tunable_fields(self) -> dict[str, Field[Any]]:
        """Return the fields that `cl.tunable(...)` made, in the class's signature or in the call, by parameter."""
        signed = [(key, one.default) for key, one in (parameters(self.make, self.given) or {}).items()]
        return {key: one for key, one in (*signed, *self.stated) if isinstance(one, Field)}

    @property
    def _name(self) -> str:
        return getattr(self.make, "__name__", type(self.make).__name__)

    @property
    def label(self) -> str:
        """The name with the parameters that were stated, as on the command line."""
        written = ",".join(f"{key}={unpack_default(one)}" for key, one in self.stated)
        return f"{self._name}[{written}]" if written else self._name

    @property
    def trained_on(self) -> str:
        """The data that the artifacts were learned from, as the class says."""
        return str(getattr(self.make, "trained_on", ""))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.label})"

    def _call_each(self, s: Objects, step: str, call: Callable[[Any, int], Any]) -> list[Any]:
        """Call a function with every object and its row, under a global random state of its own where it asks so."""
        found = []
        with keep_global_state() if self.own_random else nullcontext():
            for i, one in enumerate(s.objects):
                if self.own_random:
                    seed_global_state(s.key[i].ravel(), s.tick + 1, STEPS.index(step))
                found.append(call(one, i))
        return found

    def _make_objects(self, prior: Belief, world: World, rows: Rows, who: Sequence[Any]) -> Objects:
        """Make the objects, each of its prior, the world, its entry of `who`, and its key."""
        beliefs = [Belief(x.copy(), P.copy()) for x, P in zip(*prior, strict=True)]  # a plain loop may write into them
        none, stated = Objects((None,) * len(beliefs), rows.key, -1), self.parameters
        made = self._call_each(none, "init", lambda _, i: self.make(beliefs[i], world, *who[i], rows.key[i], **stated))
        return none._replace(objects=tuple(made))

    def predict(self, s: Objects, z: Senses) -> Objects:
        s = s._replace(tick=s.tick + 1)
        self._call_each(s, "predict", lambda one, i: one.predict(senses_of(z, i)))
        return s

    def correct(self, s: Objects, z: Senses) -> Objects:
        self._call_each(s, "correct", lambda one, i: one.correct(senses_of(z, i)))
        return s

    def estimate(self, s: Objects) -> Belief:
        beliefs = self._call_each(s, "estimate", lambda one, _: parse_belief(one))
        return Belief(np.stack([b.x for b in beliefs]), np.stack([b.P for b in beliefs]))

    def notes(self, s: Objects) -> Mapping[str, Array]:
        """Return the counts of the objects, (r,) or (trial, n) each."""
        shape = s.key.shape[1:-1]
        found = {name: [np.broadcast_to(getattr(one, name), shape) for one in s.objects] for name in self.counted}
        return {name: np.array(one, float) for name, one in found.items()}


@dataclass(frozen=True, init=False, repr=False)
class PerRobot(Adapter):
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

    given: ClassVar[tuple[str, ...]] = ("prior", "world", "robot", "key")

    def init(self, prior: Belief, world: World, rows: Rows) -> Objects:
        return self._make_objects(prior, world, rows, [(robot,) for robot in rows.robot.tolist()])

    def send(self, s: Objects, z: Senses) -> Array:
        sent = self._call_each(s, "send", lambda robot, _: robot.send() if hasattr(robot, "send") else ())
        remedy = "it must be one axis of numbers, such as np.concatenate([x, P.ravel()])"
        if any(packet is None for packet in sent):
            raise ValueError(f"send() returned None; {remedy}, all nan where nothing is sent")
        try:
            packets = [np.array(packet, float) for packet in sent]
        except (ValueError, TypeError):
            raise ValueError(f"send() returned no array of numbers; {remedy}") from None
        if wrong := [packet.shape for packet in packets if packet.ndim != 1]:
            raise ValueError(f"send() returned shape {wrong[0]}; {remedy}")
        widths = {len(packet) for packet in packets}
        if len(widths) > 1:
            raise ValueError(f"send() returned packets of {sorted(widths)} numbers; fill the shorter ones with nan")
        return np.stack(packets)

    def fuse(self, s: Objects, z: Senses, mail: Mail) -> Objects:
        self._call_each(s, "fuse", lambda robot, i: hasattr(robot, "fuse") and robot.fuse(mail_of(mail, i)))
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
        self.bytes[sender] += 8.0 * np.isfinite(packet).sum() + interface.HEADER
        return packet

    def _deliver(self, sender: int, receiver: int) -> bool:
        place = receiver, sender
        if not self._air.heard[place]:
            return False
        self.heard[place] = True
        self.rssi[place], self.range[place] = self._air.rssi[place], self._air.range[place]
        return True


@dataclass(frozen=True, init=False, repr=False)
class PerTeam(Adapter):
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

    centralised: bool
    bound: bool
    given: ClassVar[tuple[str, ...]] = ("prior", "world", "keys")
    options: ClassVar[dict[str, Any]] = {**Adapter.options, "centralised": True, "bound": False}

    def init(self, prior: Belief, world: World, rows: Rows) -> Objects:
        return self._make_objects(prior, world, rows, [()] * len(prior.x))

    def exchange(self, s: Objects, z: Senses, air: Mail) -> tuple[Objects, Traffic]:
        radios = [Radio(mail_of(air, i), z.dt[i] > 0, self.centralised) for i in range(len(s.objects))]
        self._call_each(s, "exchange", lambda team, i: team.exchange(senses_of(z, i), radios[i]))
        return s, Traffic(np.stack([one.messages for one in radios]), np.stack([one.bytes for one in radios]))


# A tick's motion and readings as functions of the state, for filters of libraries:
#
#     step = cl.motion_of(world, z)
#     ukf.Q = step.Q(ukf.x)
#     ukf.predict(fx=lambda x, dt: step.f(x))
#     for one in cl.readings_of(world, z):
#         ukf.update(one.z, one.R, hx=one.h)     # or, with a linear one: kf.update(*one.linear(kf.x))
#
# A heading goes on beyond pi, so that sigma points have their mean between them, and h(x) is within pi of the reading.


@dataclass(frozen=True)
class Step:
    """The motion of states (..., d) by one tick's odometry."""

    motion: interface.Motion
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

    def linear(self, x: Array) -> tuple[Array, Array, Array]:
        """Return F (d, d), c (d,) and Q (d, d) about a state (d,): x' = F x + c."""
        _, F, Q = self.motion.move(x, self.odometry, self.dt)
        return F, self.f(x) - F @ x, Q


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

    def linear(self, x: Array) -> tuple[Array, Array, Array]:
        """Return z - h(x) + H x, R and H about a state (d,), as a linear filter takes them."""
        y, H, _ = self.sensor.innovation(x, self.place, self.z)
        return y + H @ x, self.R, H


def motion_of(world: World, z: Senses) -> Step:
    """Return the motion of one robot in one tick."""
    return Step(world.motion, z.odometry, z.dt)


def priors_of(z: Senses) -> Belief:
    """Return everyone's belief before tick 0, x (..., n, d) and P (..., n, d, d), where the scenario tells it.

    It is the channel "team_prior", the same in every tick; `uses` must name it, else this is a KeyError.
    """
    if interface.TEAM_PRIOR not in z.extra:
        raise KeyError('no team_prior: name it in `uses`, in a scenario such as "trajectory[team_priors=true]"')
    priors = z.extra[interface.TEAM_PRIOR]
    d = 2 if priors.shape[-1] == 6 else 3
    return Belief(priors[..., :d], priors[..., d:].reshape(*priors.shape[:-1], d, d))


def readings_of(world: World, z: Senses) -> Iterator[Reading]:
    """Return one robot's readings of anchors and landmarks in one tick; absent ones are left out."""
    return (Reading(*one) for one in world.fixed(z) if np.isfinite(one[2]).all())


def _unwrap(x: Array, moved: Array) -> Array:
    """Return moved states, their headings within pi of those of x."""
    turn = moved[..., 2:] - x[..., 2:]
    return np.concatenate([moved[..., :2], x[..., 2:] + np.arctan2(np.sin(turn), np.cos(turn))], -1)

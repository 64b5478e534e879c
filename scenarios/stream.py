"""Truth and stream: two objects, so that an estimator can be given all readings without the true path.

A stream is immutable. Each trial has a hash over its readings, links and prior: results are paired where their hashes
are equal. A stream's file is a zip of plain arrays (numpy's npz, no pickle) whose member `header` is JSON.
"""

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from cooploc.estimators import models
from cooploc.estimators.errors import BadInput, count_of, nearest
from cooploc.estimators.interface import Array, Belief, Indices, Mask, Senses, World

FORMAT = 3  # of the file; 2 had a checksum in its header
MODELS: dict[str, type[Any]] = {
    name: getattr(models, name)
    for name in ("Displacement", "Unicycle", "LogDistance", "Range", "Bearing", "Sighting", "GradientDoa")
}
PLACES = ("arena", "anchors", "landmarks")  # what a world has as arrays


class Air(NamedTuple):
    """Links, signal strengths and ranges between robots in every tick, (trial, tick, receiver, sender)."""

    link: Mask  # True where a packet would arrive
    rssi: Array  # [dBm]
    range: Array  # [m]


def _size(trials: int, ticks: int, robots: int) -> str:
    return f"{count_of(trials, 'trial')} of {count_of(ticks, 'tick')}, {count_of(robots, 'robot')}"


@dataclass(frozen=True, eq=False)
class Truth:
    """The true path of every robot, which no estimator ever sees."""

    scenario: str
    trial: Indices  # (t,)
    x: Array  # (t, T, n, 2 or 3)  x [m], y [m], and heading [rad] where it is known
    valid: Mask  # (t, T, n)  False where the truth itself was not recorded
    arena: Array  # (2, 2) [m]
    origin: tuple[str, ...]  # hash per trial of the stream that belongs to it

    def __post_init__(self) -> None:
        shape, found = np.shape(self.valid), np.shape(self.x)
        if len(shape) != 3 or found not in ((*shape, 2), (*shape, 3)) or len(self.trial) != shape[0]:
            stated = f"x {found}, valid {shape} and {len(self.trial)} numbers of trials"
            raise BadInput(f"truth of {self.scenario!r} has {stated}; they must be (t, T, n, 2 or 3), (t, T, n) and t")
        if self.valid.dtype != bool:
            raise BadInput(f"valid of a truth holds {self.valid.dtype}; write .astype(bool)")

    def __repr__(self) -> str:
        t, ticks, n, _ = self.x.shape
        return f"Truth({self.scenario!r}, {_size(t, ticks, n)})"

    def select(self, trials: slice | list[int]) -> "Truth":
        """Return some of the trials."""
        parts = {name: getattr(self, name)[trials] for name in ("trial", "x", "valid")}
        return replace(self, **parts, origin=tuple(np.array(self.origin)[trials].tolist()))


@dataclass(frozen=True, eq=False)
class Stream:
    """Everything the robots of one scenario sensed, heard and knew in advance, in every trial."""

    scenario: str
    seed: int
    trial: Indices  # (t,)
    time: Array  # (T,)  end of each tick [s]
    world: World
    prior: Belief  # x (t, n, d), P (t, n, d, d)
    senses: Senses  # (t, T, n, ...)
    air: Air
    notes: Mapping[str, Any] = field(default_factory=dict)  # where it comes from, what was dropped

    def __post_init__(self) -> None:
        _require_shapes(self)
        for array in self.arrays().values():
            array.flags.writeable = False

    def __repr__(self) -> str:
        size = _size(len(self.trial), len(self.time), self.robots)
        return f"Stream({self.scenario!r}, seed {self.seed}, {size}, {', '.join(sorted(self.channels()))})"

    @property
    def robots(self) -> int:
        return self.world.robots

    def arrays(self) -> dict[str, Array]:
        """Every array with a trial axis, by name, in a fixed order."""
        named: dict[str, Any] = {"prior.x": self.prior.x, "prior.P": self.prior.P}
        named |= {f"senses.{name}": getattr(self.senses, name) for name in Senses._fields[:-1]}
        named |= {f"extra.{name}": self.senses.extra[name] for name in sorted(self.senses.extra)}
        named |= {f"air.{name}": getattr(self.air, name) for name in Air._fields}
        return named

    @cached_property
    def hashes(self) -> tuple[str, ...]:
        """A SHA-256 for each trial over readings, links, prior, and what the label says that the team assumes.

        Not over the world: a stream without a label of its assumptions is that of its readings.
        """
        arrays, assumed = self.arrays(), _assumptions(self.scenario)
        return tuple(_hash_trial(arrays, i, assumed) for i in range(len(self.trial)))

    @cached_property
    def hash(self) -> str:
        """The hash of the trials' hashes."""
        return hashlib.sha256("".join(self.hashes).encode()).hexdigest()

    def channels(self) -> set[str]:
        """The channels that this stream has."""
        own = ("odometry", "anchor_rssi", "landmark", "sighting")
        has = {name for name in own if getattr(self.senses, name).shape[3] > 0}
        has |= {f"radio_{name}" for name in ("rssi", "range") if getattr(self.air, name).shape[3] > 0}
        return has | set(self.senses.extra)

    def select(self, trials: slice | list[int]) -> "Stream":
        """Return some of the trials, bit-identical, in any order."""
        chosen = {name: array[trials] for name, array in self.arrays().items()}
        return replace(self, trial=self.trial[trials], **_readings(chosen))

    def first_ticks(self, ticks: int) -> "Stream":
        """Return the stream of the first ticks only."""
        arrays = {name: a if name.startswith("prior") else a[:, :ticks] for name, a in self.arrays().items()}
        return replace(self, time=self.time[:ticks], **_readings(arrays))

    def replace_arrays(self, arrays: Mapping[str, Any]) -> "Stream":
        """Return a stream with some of `arrays()` replaced; what begins with "extra." may be new.

        Raises:
            BadInput: there is no array of that name.
        """
        own = self.arrays()
        if unknown := [name for name in arrays if name not in own and not name.startswith("extra.")]:
            raise BadInput(f"a stream has no array {unknown[0]!r}; {nearest(unknown[0], list(own))}")
        return replace(self, **_readings({**self.arrays(), **arrays}))

    def save(self, path: str | Path) -> None:
        """Write everything into one file.

        Raises:
            BadInput: the world has a model of another package, which a file cannot describe.
        """
        w = self.world
        header = {
            **{"format": FORMAT, "robots": w.robots, "tick": w.tick, "t0": w.t0},
            "what": "cooploc stream: arrays are (trial, tick, robot, ...), SI units, nan is absent",
            "motion": _describe(w.motion),
            "sensors": {channel: _describe(sensor) for channel, sensor in w.sensors.items()},
            **{"scenario": self.scenario, "seed": self.seed, "notes": dict(self.notes), "hashes": self.hashes},
        }
        arrays = {name: getattr(w, name) for name in PLACES} | {"trial": self.trial, "time": self.time} | self.arrays()
        encoded = np.frombuffer(json.dumps(header, indent=1).encode(), np.uint8)
        with Path(path).open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, header=encoded, **arrays)

    @classmethod
    def load(cls, path: str | Path) -> "Stream":
        """Read a file that `save` wrote.

        Raises:
            BadInput: it is not a stream, is of a newer format, or its content does not have the hashes it states.
        """
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            header = json.loads(arrays.pop("header").tobytes())
            if header["format"] > FORMAT:
                newer = f"has format {header['format']}, this version reads up to {FORMAT}"
                raise BadInput(f"{path} {newer}: update cooploc")
            world = World(
                **{name: header[name] for name in ("robots", "tick", "t0")},
                motion=_build_model(header["motion"]),
                sensors={channel: _build_model(described) for channel, described in header["sensors"].items()},
                **{name: arrays[name] for name in PLACES},
            )
            about = {name: header[name] for name in ("scenario", "seed", "notes")}
            stream = cls(**about, trial=arrays["trial"], time=arrays["time"], world=world, **_readings(arrays))
            stated = list(zip(header["hashes"], stream.hashes, strict=True))
        except BadInput:
            raise
        except FileNotFoundError:
            raise BadInput(f"there is no file {path}; name a stream that cooploc wrote") from None
        except Exception as e:  # zip, zlib and numpy raise whatever they meet
            why = " ".join(f"{type(e).__name__}: {e}".split())[:200]
            raise BadInput(f"{path} is not a whole stream ({why}); get the file again") from None
        for trial, (written, found) in zip(stream.trial, stated, strict=True):
            if written != found:
                raise BadInput(f"{path}: trial {trial} is not what was written (hash differs); get the file again")
        return stream


def _require_shapes(stream: Stream) -> None:
    """Refuse arrays of another shape or type than the interface states: compiled loops would not notice."""
    world, t, ticks, n = stream.world, len(stream.trial), len(stream.time), stream.robots
    d = 2 if np.shape(stream.prior.x)[2:] == (2,) else 3
    whole = {"prior.x": (t, n, d), "prior.P": (t, n, d, d), "senses.dt": (t, ticks, n), "air.link": (t, ticks, n, n)}
    channels: dict[str, tuple[int, ...]] = {"senses.anchor_rssi": (len(world.anchors),)}
    channels |= {"air.rssi": (n,), "air.range": (n,)}
    for name, things in (("landmark", len(world.landmarks)), ("sighting", n)):
        numbers = len(world.sensors[name].R) if name in world.sensors else 2
        channels[f"senses.{name}"] = things, numbers
    if type(world.motion) in MODELS.values():
        channels["senses.odometry"] = (2,)
    for name, array in stream.arrays().items():
        where = f"stream of {stream.scenario!r}, {_size(t, ticks, n)}: {name}"
        if not isinstance(array, np.ndarray):
            raise BadInput(f"{where} is of type {type(array).__name__}: give a numpy array")
        own = channels.get(name, array.shape[3:])
        shape = whole.get(name, (t, ticks, n, *own))
        if array.shape != shape and (name not in channels or array.shape[:4] != (t, ticks, n, 0)):
            absent = ", or of width 0 in axis 3 where the channel does not exist" * (name in channels)
            raise BadInput(f"{where} has shape {array.shape}; it must be {shape}{absent}")
        kind = bool if name == "air.link" else float
        if not name.startswith("extra.") and not np.issubdtype(array.dtype, kind):
            raise BadInput(f"{where} holds {array.dtype}; write .astype({kind.__name__})")


def find_fault(truth: Truth, stream: Stream, trials: Sequence[int]) -> str:
    """Return a sentence on what cannot be in truth and stream that a scenario gave for these trials, else ""."""
    shape, x, P = (len(trials), len(stream.time), stream.robots), *stream.prior
    for what, one in (("truth", truth), ("stream", stream)):
        if list(map(int, one.trial)) != list(trials):
            return f"its {what} is of trials {list(map(int, one.trial))}, and simulate() was asked for {list(trials)}"
    if truth.valid.shape != shape:
        return f"its truth is {_size(*truth.valid.shape)}, and its stream {_size(*shape)}"
    if not np.isfinite(truth.x[truth.valid][..., :2]).all():
        return "true positions are not finite in ticks that are said to be valid"
    if not (np.diff(stream.time) > 0).all():
        return "its times do not increase"
    if not (stream.senses.dt >= 0).all():
        return "senses.dt is negative or nan; it is the time [s] that the odometry covers"
    if not np.isfinite(x).all() or not np.isfinite(P).all() or (np.linalg.eigvalsh(P) < -1e-9 * np.abs(P).max()).any():
        return "its prior is not finite, or has a covariance that is not positive"
    infinite = [name for name, a in stream.arrays().items() if a.dtype.kind == "f" and np.isinf(a).any()]
    return f"{infinite[0]} is infinite somewhere; write nan for what is absent" if infinite else ""


def _readings(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a stream that `Stream.arrays` takes apart."""
    extra = {name.removeprefix("extra."): a for name, a in arrays.items() if name.startswith("extra.")}
    return {
        "prior": Belief(arrays["prior.x"], arrays["prior.P"]),
        "senses": Senses(**{name: arrays[f"senses.{name}"] for name in Senses._fields[:-1]}, extra=extra),
        "air": Air(*(arrays[f"air.{name}"] for name in Air._fields)),
    }


def _hash_trial(arrays: Mapping[str, Array], i: int, assumed: str) -> str:
    """Return SHA-256 over names, shapes and little-endian values of row `i` of every array, and over `assumed`."""
    digest = hashlib.sha256()
    for name, array in arrays.items():
        one = np.ascontiguousarray(array[i])
        one = one.astype(one.dtype.newbyteorder("<"))
        if one.dtype.kind == "f":
            one[np.isnan(one)] = np.nan  # one nan, whatever its bits
        digest.update(f"{name} {one.dtype.str} {one.shape};".encode())
        digest.update(one.data)
    digest.update(assumed.encode())
    return digest.hexdigest()


def _assumptions(label: str) -> str:
    """Return the assumptions in a scenario's label that differ from the truth; numbers in one form: 2, 2.0 or 2e0."""

    def normalize(value: str) -> str:
        try:
            return repr(float(value))
        except ValueError:
            return value

    found = re.findall(r"[\[,]\s*(assumed\.[^=,\]]+?)\s*=\s*([^,\]]+)", label)
    return ";".join(sorted(f"{key}={normalize(value.strip())}" for key, value in found))


def _describe(model: Any) -> dict[str, Any]:
    name = type(model).__name__
    known: object = MODELS.get(name)
    if known is not type(model):
        raise BadInput(f"a stream with the model {name} cannot be written: only {', '.join(MODELS)} have a description")
    return {"model": name, **asdict(model)}


def _build_model(described: dict[str, Any]) -> Any:
    name = str(described["model"])
    if name not in MODELS:
        raise BadInput(f"the stream names a model {name!r} that this version does not know: update cooploc")
    return TypeAdapter(MODELS[name]).validate_python({k: v for k, v in described.items() if k != "model"})

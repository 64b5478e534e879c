"""What was true, and what was sensed: two objects, so that an estimator can be given one without the other.

A stream is immutable. Each trial has a hash over its readings, links and prior (`stream_hash`); a stream can be kept in
a file that describes itself (`stream_file`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Belief, Indices, Mask, Senses, World
from cooploc.scenarios import stream_file
from cooploc.scenarios.display import facts_table
from cooploc.scenarios.stream_hash import assumptions, hash_of_trial, hash_of_trials


class Air(NamedTuple):
    """Links, signal strengths and ranges between robots in every tick, (trial, tick, receiver, sender)."""

    link: Mask  # True where a packet would arrive
    rssi: Array  # [dBm]
    range: Array  # [m]


@dataclass(frozen=True, eq=False)
class Truth:
    """The true path of every robot, which no estimator ever sees."""

    scenario: str
    trial: Indices  # (t,)
    x: Array  # (t, T, n, 2 or 3)  x [m], y [m], and heading [rad] where it is known
    valid: Mask  # (t, T, n)  False where the truth itself was not recorded
    arena: Array  # (2, 2) [m]
    origin: tuple[str, ...]  # hash per trial of the stream that belongs to it

    def __repr__(self) -> str:
        t, ticks, n, _ = self.x.shape
        return f"Truth({self.scenario!r}, {t} trials of {ticks} ticks, {n} robots)"

    def select(self, trials: slice | list[int]) -> "Truth":
        """Some of the trials."""
        return replace(
            self,
            trial=self.trial[trials],
            x=self.x[trials],
            valid=self.valid[trials],
            origin=tuple(np.array(self.origin)[trials].tolist()),
        )


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
        for array in self.arrays().values():
            array.flags.writeable = False

    def __repr__(self) -> str:
        size = f"{len(self.trial)} trials of {len(self.time)} ticks, {self.robots} robots"
        return f"Stream({self.scenario!r}, seed {self.seed}, {size}, {', '.join(sorted(self.channels()))})"

    def _repr_html_(self) -> str:
        links = self.air.link.sum() / max(1, self.air.link[..., 0].size * (self.robots - 1))
        return facts_table(
            f"stream of {self.scenario}, seed {self.seed}",
            (
                ("trials", len(self.trial)),
                ("ticks", f"{len(self.time)} of {self.world.tick:g} s"),
                ("robots", self.robots),
                ("channels", ", ".join(sorted(self.channels()))),
                ("links that hold", f"{links:.0%}" if self.robots > 1 else "none, there is one robot"),
                ("hash", self.hash[:16]),
            ),
        )

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
        """One SHA-256 per trial over readings, links, prior, and what the label says that the team assumes.

        Not over the world: a stream without a label of its assumptions is that of its readings.
        """
        arrays, assumed = self.arrays(), assumptions(self.scenario)
        return tuple(hash_of_trial(arrays, i, assumed) for i in range(len(self.trial)))

    @cached_property
    def hash(self) -> str:
        """The hash of the trials' hashes."""
        return hash_of_trials(self.hashes)

    def channels(self) -> set[str]:
        """The channels that this stream has."""
        has = {
            name
            for name in ("odometry", "anchor_rssi", "landmark", "sighting")
            if getattr(self.senses, name).shape[3] > 0
        }
        has |= {f"radio_{name}" for name in ("rssi", "range") if getattr(self.air, name).shape[3] > 0}
        return has | set(self.senses.extra)

    def select(self, trials: slice | list[int]) -> "Stream":
        """Some of the trials, bit-identical, in any order."""
        chosen = self.map(lambda array: array[trials])
        return replace(chosen, trial=self.trial[trials])

    def first_ticks(self, ticks: int) -> "Stream":
        """Return the stream of the first ticks only."""
        arrays = {name: a if name.startswith("prior") else a[:, :ticks] for name, a in self.arrays().items()}
        return replace(self.with_arrays(arrays), time=self.time[:ticks])

    def map(self, change: Any) -> "Stream":
        """A stream whose every array with a trial axis went through `change`."""
        arrays = {name: change(array) for name, array in self.arrays().items()}
        return self.with_arrays(arrays)

    def with_arrays(self, arrays: Mapping[str, Any]) -> "Stream":
        """A stream with some of `arrays()` replaced."""
        return replace(self, **_readings({**self.arrays(), **arrays}))

    def save(self, path: str | Path) -> None:
        """Write everything into one file.

        Raises:
            BadInput: the world has a model of another package, which a file cannot describe.

        """
        header = {"scenario": self.scenario, "seed": self.seed, "notes": dict(self.notes), "hashes": self.hashes}
        axes = {"trial": self.trial, "time": self.time}
        stream_file.write(Path(path), header, self.world, axes | self.arrays())

    @classmethod
    def load(cls, path: str | Path) -> "Stream":
        """Read a file that `save` wrote.

        Raises:
            BadInput: it is not a stream, is of a newer format, or its content does not have the hashes it states.

        """
        header, arrays = stream_file.read(Path(path))
        try:
            stream = cls._from_arrays(header, arrays)
            stated = list(zip(header["hashes"], stream.hashes, strict=True))
        except BadInput:
            raise
        except (KeyError, TypeError, ValueError, AttributeError, ArithmeticError) as e:
            raise BadInput(
                f"{path} is incomplete or inconsistent ({type(e).__name__}: {e}); get the file again"
            ) from None
        for i, (written, found) in enumerate(stated):
            if written != found:
                raise BadInput(
                    f"{path}: trial {stream.trial[i]} is not what was written (hash differs); get the file again"
                )
        return stream

    @classmethod
    def _from_arrays(cls, header: dict[str, Any], arrays: dict[str, Any]) -> "Stream":
        return cls(
            scenario=header["scenario"],
            seed=header["seed"],
            trial=arrays["trial"],
            time=arrays["time"],
            world=stream_file.world_of(header, arrays),
            notes=header["notes"],
            **_readings(arrays),
        )


def _readings(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a stream that `Stream.arrays` takes apart."""
    extra = {name.removeprefix("extra."): a for name, a in arrays.items() if name.startswith("extra.")}
    return {
        "prior": Belief(arrays["prior.x"], arrays["prior.P"]),
        "senses": Senses(**{name: arrays[f"senses.{name}"] for name in Senses._fields[:-1]}, extra=extra),
        "air": Air(*(arrays[f"air.{name}"] for name in Air._fields)),
    }


def concatenate(streams: list[Stream]) -> Stream:
    """One stream of the trials of several that describe the same scenario."""
    for other in streams[1:]:
        if (other.scenario, other.seed) != (streams[0].scenario, streams[0].seed):
            raise BadInput(
                f"{streams[0].scenario} (seed {streams[0].seed}) and {other.scenario} (seed {other.seed}) do not join: "
                "concatenate trials of one scenario and seed"
            )
    parts = [s.arrays() for s in streams]
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return replace(streams[0].with_arrays(joined), trial=np.concatenate([s.trial for s in streams]))


def chunks(count: int, size: int) -> Iterator[slice]:
    """Slices of at most `size` that cover `count`."""
    return (slice(start, min(start + size, count)) for start in range(0, count, size))

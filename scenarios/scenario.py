"""A scenario: a world with its parameters, the family that it belongs to, and the object that its label stands for.

A model is a pydantic class of parameters that satisfies `Scenario`. A label is read once, into a `ResolvedScenario`,
which is passed on instead.

The label of any scenario takes one option besides the parameters of its world: in `trajectory[team_priors=true]` every
robot knows the priors of all, by the channel "team_prior".
"""

import os
import re
import reprlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from operator import index
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from pydantic import BaseModel, ValidationError

from cooploc.estimators.errors import BadInput, first_reason, nearest
from cooploc.estimators.interface import TEAM_PRIOR, World
from cooploc.estimators.registry import load_object
from cooploc.scenarios.stream import Stream, Truth, find_fault


class Scenario(Protocol):
    """A world with its parameters.

    A simulated one may have `robots` and `ticks`, its size. Recordings of several trials have `count()`, their number,
    and `at(trials)`, the scenario of some; those with fitted models have `explanations()`, sentences on what was fitted
    and dropped, and `faults()`, those of the sentences that are on what was left out, sorted or repaired while reading.
    """

    def world(self) -> World:
        """Return the world as the team knows it in advance."""
        ...

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Truth and stream of these trials, where the team assumes `world`, which may differ from the true one."""
        ...

    def model_dump(self, *, mode: str = ..., exclude: set[str] = ...) -> dict[str, Any]: ...


@dataclass(frozen=True)
class Family:
    """Scenarios that differ in one thing."""

    about: str
    model: str | type  # "module:Class", or the class
    base: Mapping[str, Any] = field(default_factory=dict)  # parameters that differ from the class's defaults
    sweep: Mapping[str, str] = field(default_factory=dict)  # the label's short name -> parameter
    variants: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # the label's word -> parameters
    recorded: bool = False  # needs a directory of recordings; has one trial, unless its model can `count()`
    word: str = ""  # the parameter that any other word of the label stands for, such as a run's name

    def parameters_of(self, name: str, which: str) -> Mapping[str, Any]:
        """Return the parameters that `which`, the part of a label behind its slash, stands for."""
        if not which:
            return {}
        if which in self.variants:
            return self.variants[which]
        key, equals, value = which.partition("=")
        if equals and key in self.sweep:
            return {self.sweep[key]: value}
        if self.word:
            return {self.word: which}
        known = [*self.variants, *(f"{key}=..." for key in self.sweep)]
        raise BadInput(f"scenario {name!r} has no {which!r}; known are {', '.join(known) or 'none'}")

    def model_class(self, name: str) -> Any:
        """Return the class of parameters."""
        cls: Any = self.model
        if isinstance(cls, str):
            cls = load_object(cls, f"the model {cls} of scenario {name!r}")
        if not hasattr(cls, "model_fields"):
            raise BadInput(f"the model of scenario {name!r} is {cls!r}; it must be a pydantic model")
        if lacking := [method for method in ("world", "simulate") if not hasattr(cls, method)]:
            raise BadInput(f"the model of scenario {name!r} has no method {lacking[0]}(): {cls.__name__} must have it")
        return cls


class StreamOptions(BaseModel):
    """The option of any label that acts on its stream."""

    team_priors: bool = False


def add_team_priors(stream: Stream) -> Stream:
    """Return the stream with a channel (t, T, n, n, d + d d): in every tick, everyone's x and P."""
    x, P = stream.prior
    flat = np.concatenate([x, P.reshape(*x.shape[:-1], -1)], -1)[:, None, None]
    shape = len(x), len(stream.time), stream.robots, *flat.shape[-2:]
    return stream.replace_arrays({f"extra.{TEAM_PRIOR}": np.broadcast_to(flat, shape)})  # one copy for all ticks


MOST_TRIALS = 1_000_000  # of one call
KEPT, DRAWN = 34, 80  # bytes per tick and pair of robots (measured): of every trial, and more while one is drawn


@dataclass(frozen=True, eq=False)
class ResolvedScenario:
    """A scenario as an object. It holds an instance of the family's model: send its label to another process."""

    label: str  # as written, with overrides in brackets
    name: str  # of the family
    family: Family
    parameters: Mapping[str, Any]  # those that differ from the model's defaults
    model: Scenario
    assumed: Mapping[str, Any] = field(default_factory=dict)  # what the team assumes instead of true parameters
    options: StreamOptions = field(default_factory=StreamOptions)

    @property
    def settings(self) -> dict[str, Any]:
        """Every parameter of the model, as JSON, and options of the stream."""
        return self.model.model_dump(mode="json", exclude={"data"}) | self.options.model_dump(exclude_defaults=True)

    @property
    def is_recording(self) -> bool:
        """True for a recording, which is the same for any seed."""
        return self.family.recorded

    @property
    def data(self) -> Path | None:
        """The directory of a recording."""
        return self.parameters["data"] if self.is_recording else None

    @property
    def robots(self) -> int:
        """Number of robots that the model states before it runs, else 1."""
        return getattr(self.model, "robots", 1)

    @property
    def ticks(self) -> int:
        """Number of ticks that the model states before it runs, else 1."""
        return getattr(self.model, "ticks", 1)

    def trials(self, asked: int) -> int:
        """Return the number of trials of a study that asks for `asked`: a recording has its own number."""
        count: int = getattr(self.model, "count", lambda: 1)() if self.is_recording else asked
        return count

    def explanations(self) -> list[str]:
        """Return sentences on fitted models and on what was dropped while reading; empty for simulated worlds."""
        return list(getattr(self.model, "explanations", list)())

    def faults(self) -> list[str]:
        """Return sentences on what was left out, sorted or repaired while reading; empty for simulated worlds."""
        return list(getattr(self.model, "faults", list)())

    def of_length(self, ticks: int) -> "ResolvedScenario":
        """Return the same scenario with so many ticks, where its length can be chosen."""
        return self._override({"ticks": ticks}) if hasattr(self.model, "ticks") and not self.is_recording else self

    def simulate(self, trials: int | Sequence[int], seed: int) -> tuple[Truth, Stream]:
        """Simulate truth and stream of some trials; `scenarios.simulate` says more.

        Raises:
            BadInput: trials or a seed that cannot be, or assumed parameters that would change the readings' shape.
        """
        numbers, seed = _trial_numbers(trials), _whole_number(seed, "seed")
        model = self._model_of(numbers)
        self.require_memory(len(numbers))
        world = self._assume(model.world(), numbers) if self.assumed else model.world()
        truth, stream = self._require_pair(model.simulate(self.label, numbers, seed, world), numbers)
        stream = add_team_priors(stream) if self.options.team_priors else stream
        return replace(truth, origin=stream.hashes), stream  # a model may have changed the stream of another one

    def _require_pair(self, found: Any, numbers: Sequence[int]) -> tuple[Truth, Stream]:
        """Refuse what a model must not return."""
        kinds = [type(one) for one in found] if isinstance(found, tuple | list) else [type(found)]
        if kinds != [Truth, Stream]:
            given = ", ".join(kind.__name__ for kind in kinds)
            raise BadInput(f"scenario {self.label!r}: its simulate() returned {given}; it must be truth, stream")
        truth, stream = (one if one.scenario == self.label else replace(one, scenario=self.label) for one in found)
        if fault := find_fault(truth, stream, numbers):
            raise BadInput(f"scenario {self.label!r}: {fault}")
        return truth, stream

    def require_memory(self, trials: int) -> None:
        """Refuse so many trials at once of a simulation, if this machine or container has not the memory for them."""
        needed = self.robots**2 * self.ticks * (KEPT * trials + DRAWN)
        there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        with suppress(OSError, ValueError):  # no container, or one without a limit
            there = min(there, int(Path("/sys/fs/cgroup/memory.max").read_text()))
        if needed > there:
            raise BadInput(
                f"scenario {self.label!r} takes about {needed / 1e9:.3g} GB of memory ({trials} trials of {self.ticks} "
                f"ticks and {self.robots} robots), and this machine has {there / 1e9:.3g} GB: take fewer"
            )

    def _model_of(self, trials: Sequence[int]) -> Scenario:
        """Return the model of these trials; each recording of several has its own."""
        at: Callable[[Sequence[int]], Scenario] | None = getattr(self.model, "at", None)
        return at(trials) if at else self.model

    def _assume(self, true: World, trials: Sequence[int]) -> World:
        """Return the world of other parameters, which must have the same shape and clock as the true one."""
        world = self._override(self.assumed)._model_of(trials).world()
        for what in ("robots", "tick", "t0", "arena", "anchors", "landmarks"):
            if not np.array_equal(getattr(world, what), getattr(true, what)):
                raise BadInput(
                    f"assumed={dict(self.assumed)!r} would change the world's {what}: make it an override instead"
                )
        return world

    def _override(self, parameters: Mapping[str, Any]) -> "ResolvedScenario":
        return build_scenario(self.label, self.name, self.family, {**self.parameters, **parameters}, self.assumed)


def build_scenario(
    label: str, name: str, family: Family, parameters: Mapping[str, Any], assumed: Mapping[str, Any]
) -> ResolvedScenario:
    """Build a family's scenario with these parameters, whose team assumes other values of some."""
    cls = family.model_class(name)
    known = [*cls.model_fields, *StreamOptions.model_fields]
    if unknown := [key for key in parameters if key not in known]:
        remedy = f"{nearest(unknown[0], known)} (cooploc list {name})"
        raise BadInput(f"scenario {name!r} has no parameter {unknown[0]!r}; {remedy}")
    said = {key: value for key, value in parameters.items() if key not in cls.model_fields}
    if misplaced := [key for key in StreamOptions.model_fields if key in assumed]:
        raise BadInput(f"scenario {label!r}: {misplaced[0]} is of the stream, so it cannot be assumed: leave it out")
    own = {key: value for key, value in parameters.items() if key not in said}
    try:
        return ResolvedScenario(label, name, family, parameters, cls(**own), assumed, StreamOptions(**said))
    except ValidationError as e:
        raise BadInput(f"scenario {label!r}, {first_reason(e.errors())}") from None


def require_no_faults(faults: Sequence[str]) -> None:
    """Refuse a recording of which something was left out, sorted or repaired while reading."""
    if faults:
        others = f", and others ({len(faults) - 1})" if len(faults) > 1 else ""
        raise BadInput(f"{faults[0]}{others}: mend the recording, or leave out --strict")


def split_family(path: str) -> tuple[str, str]:
    """Divide a label without brackets into family and the part behind the slash; a file's path may hold slashes."""
    if path.endswith(".py"):
        return path, ""  # refused by `is_file`, with the remedy
    in_file = re.fullmatch(r"(.+\.py:[^/]*)/?(.*)", path)
    if in_file:
        return in_file[1], in_file[2]
    name, _, which = path.partition("/")
    return name, which


def _trial_numbers(trials: Any) -> list[int]:
    """Return the trials' numbers, each once."""
    each = trials if isinstance(trials, Iterable) else range(_whole_number(trials, "trials"))
    numbers = [_whole_number(k, "one of the trials") for k in islice(each, MOST_TRIALS + 1)]
    if not 1 <= len(numbers) <= MOST_TRIALS:
        raise BadInput(f"trials is {reprlib.repr(trials)}; it must be at least 1, and at most {MOST_TRIALS} at once")
    if len(set(numbers)) < len(numbers):
        raise BadInput(f"trials is {trials!r}; name each trial once, or copies would count as independent")
    return numbers


def _whole_number(value: Any, what: str) -> int:
    try:
        number = index(value)
    except TypeError:
        raise BadInput(f"{what} is {value!r}; it must be a whole number") from None
    if number < 0:
        raise BadInput(f"{what} is {number}; it must not be negative")
    return number

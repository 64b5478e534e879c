"""A scenario whose label has been read: its family, parameters and world. It is passed on instead of the label."""

import re
import reprlib
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from operator import index
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from cooploc.estimators.interface import World
from cooploc.estimators.plugins.errors import BadInput, first_reason, nearest
from cooploc.estimators.plugins.guard import SIMULATED
from cooploc.scenarios import memory
from cooploc.scenarios.interface import ExplainedScenario, Family, RecordedScenario, Scenario, SimulatedScenario
from cooploc.scenarios.stream import Stream, Truth
from cooploc.scenarios.told import Told
from cooploc.scenarios.told import divided as divided_told

MOST_TRIALS = 1_000_000  # of one call


@dataclass(frozen=True, eq=False)
class ResolvedScenario:
    """A scenario as an object. It holds an instance of the family's model: send its label to another process."""

    label: str  # as written, with overrides in brackets
    name: str  # of the family
    family: Family
    parameters: Mapping[str, Any]  # those that differ from the model's defaults
    model: Scenario
    assumed: Mapping[str, Any] = field(default_factory=dict)  # what the team assumes instead of true parameters
    told: Told = field(default_factory=Told)

    @property
    def settings(self) -> dict[str, Any]:
        """Every parameter of the model, as JSON, and what else is said of the stream."""
        return {**self.model.model_dump(mode="json", exclude={"data"}), **self.told.model_dump(exclude_defaults=True)}

    @property
    def recorded(self) -> bool:
        """Whether it is a recording, which is the same for any seed."""
        return self.family.recorded

    @property
    def data(self) -> Path | None:
        """The directory of a recording."""
        return self.parameters["data"] if self.recorded else None

    @property
    def robots(self) -> int:
        """How many robots are simulated; 1 for a recording, whose files are not read for this."""
        return self.model.robots if isinstance(self.model, SimulatedScenario) else 1

    @property
    def ticks(self) -> int:
        """How many ticks are simulated; 1 for a recording, as for `robots`."""
        return self.model.ticks if isinstance(self.model, SimulatedScenario) else 1

    def trials(self, asked: int) -> int:
        """How many trials a study has that asks for so many: a recording has its own number."""
        if not self.recorded:
            return asked
        return self.model.count() if isinstance(self.model, RecordedScenario) else 1

    def explained(self) -> list[str]:
        """What was fitted on what, and what was dropped while reading; nothing where nothing was."""
        return self.model.explained() if isinstance(self.model, ExplainedScenario) else []

    def first_tick(self) -> "ResolvedScenario":
        """The same scenario with one tick, where its length can be chosen."""
        simulated = not self.recorded and isinstance(self.model, SimulatedScenario)
        return self._changed({"ticks": 1}) if simulated else self

    def simulate(self, trials: int | Sequence[int], seed: int) -> tuple[Truth, Stream]:
        """Truth and stream of some trials; `scenarios.simulate` says more.

        Raises:
            BadInput: trials or a seed that cannot be, or assumed parameters that would change the readings' shape.

        """
        sys.audit(SIMULATED, self.label)
        numbers, seed = _numbers(trials), _whole(seed, "seed")
        model = self._of(numbers)
        memory.demand(self.label, self.robots, self.ticks, len(numbers), getattr(model, "at_once", None))
        world = self._assumed(model.world(), numbers) if self.assumed else model.world()
        return self.told.applied(*model.simulate(self.label, numbers, seed, world))

    def _of(self, trials: Sequence[int]) -> Scenario:
        """The model of these trials; each recording of several has its own."""
        return self.model.at(trials) if isinstance(self.model, RecordedScenario) else self.model

    def _assumed(self, true: World, trials: Sequence[int]) -> World:
        """The world of other parameters, which must have the same shape and clock as the true one."""
        world = self._changed(self.assumed)._of(trials).world()
        for what in ("robots", "tick", "t0", "arena", "anchors", "landmarks"):
            if not np.array_equal(getattr(world, what), getattr(true, what)):
                raise BadInput(
                    f"assumed={dict(self.assumed)!r} would change the world's {what}: make it an override instead"
                )
        return world

    def _changed(self, parameters: Mapping[str, Any]) -> "ResolvedScenario":
        return build(self.label, self.name, self.family, {**self.parameters, **parameters}, self.assumed)


def build(
    label: str, name: str, family: Family, parameters: Mapping[str, Any], assumed: Mapping[str, Any]
) -> ResolvedScenario:
    """A family's scenario with these parameters, whose team assumes other values of some.

    Raises:
        BadInput: an unknown parameter, or a value that does not fit.

    """
    cls = family.model_class(name, parameters.get("data") if family.recorded else None)
    own, said = divided_told(parameters, cls.model_fields)
    for key in own:
        if key not in cls.model_fields:
            known = [*cls.model_fields, *Told.model_fields]
            raise BadInput(f"scenario {name!r} has no parameter {key!r}; {nearest(key, known)}")
    if told := divided_told(assumed, cls.model_fields)[1]:
        key = next(iter(told))
        raise BadInput(f"scenario {label!r}: {key} is of the stream, so nobody assumes it: write {key}={told[key]}")
    try:
        return ResolvedScenario(label, name, family, parameters, cls(**own), assumed, Told(**said))
    except ValidationError as e:
        raise BadInput(f"scenario {label!r}, {first_reason(e.errors())}") from None


def divided(path: str) -> tuple[str, str]:
    """The family's name and the part behind the slash, of a label without brackets; a file's path may hold slashes."""
    if path.endswith(".py"):
        return path, ""  # refused by `is_file`, with the remedy
    in_file = re.fullmatch(r"(.+\.py:[^/]*)/?(.*)", path)
    if in_file:
        return in_file[1], in_file[2]
    name, _, which = path.partition("/")
    return name, which


def _numbers(trials: Any) -> list[int]:
    """The trials' numbers, each once."""
    if isinstance(trials, Iterable):
        numbers = [_whole(k, "one of the trials") for k in islice(trials, MOST_TRIALS + 1)]
    else:
        numbers = list(range(min(_whole(trials, "trials"), MOST_TRIALS + 1)))
    if len(numbers) > MOST_TRIALS:
        raise BadInput(f"trials is {reprlib.repr(trials)}; at most {MOST_TRIALS} can be simulated at once")
    if not numbers:
        raise BadInput(f"trials is {trials!r}; it must be at least 1")
    if len(set(numbers)) < len(numbers):
        raise BadInput(f"trials is {trials!r}; name each trial once, or copies would count as independent")
    return numbers


def _whole(value: Any, what: str) -> int:
    try:
        number = index(value)
    except TypeError:
        raise BadInput(f"{what} is {value!r}; it must be a whole number") from None
    if number < 0:
        raise BadInput(f"{what} is {number}; it must not be negative")
    return number

"""What a scenario's model must have, and a family of scenarios: a model with defaults, and what its labels vary.

A model is a pydantic class of parameters that satisfies `Scenario`. Simulated ones have a size, `SimulatedScenario`;
recordings with several trials satisfy `RecordedScenario`, and those that say what was fitted `ExplainedScenario`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from cooploc.estimators.interface import World
from cooploc.estimators.plugins.errors import BadInput
from cooploc.estimators.plugins.registry import loaded
from cooploc.scenarios.stream import Stream, Truth


class Scenario(Protocol):
    """A world with its parameters."""

    def world(self) -> World:
        """What the team knows in advance."""
        ...

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]:
        """Truth and stream of these trials, where the team assumes `world`, which may differ from the true one."""
        ...

    def model_dump(self, *, mode: str = ..., exclude: set[str] = ...) -> dict[str, Any]: ...


@runtime_checkable
class SimulatedScenario(Scenario, Protocol):
    """A scenario whose size is known before it runs."""

    @property
    def robots(self) -> int: ...

    @property
    def ticks(self) -> int: ...


@runtime_checkable
class RecordedScenario(Scenario, Protocol):
    """Several recordings, each a trial with a world of its own."""

    def count(self) -> int:
        """How many trials there are."""
        ...

    def at(self, trials: Sequence[int]) -> Scenario:
        """The recording of these trials.

        Raises:
            BadInput: there are not such trials, or they are not of one recording.

        """
        ...


@runtime_checkable
class ExplainedScenario(Scenario, Protocol):
    """Recordings whose models were fitted."""

    def explained(self) -> list[str]:
        """What was fitted on what, and what was dropped while reading: sentences for the report."""
        ...


@dataclass(frozen=True)
class Family:
    """Scenarios that differ in one thing."""

    about: str
    model: str | type  # "module:Class", or the class
    base: Mapping[str, Any] = field(default_factory=dict)  # parameters that differ from the class's defaults
    sweep: Mapping[str, str] = field(default_factory=dict)  # the label's short name -> parameter
    variants: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # the label's word -> parameters
    recorded: bool = False  # needs a directory of recordings; has one trial, unless it is a `RecordedScenario`
    by_data: str = ""  # "module:function" that says the model for a directory of recordings, where it has several
    word: str = ""  # the parameter that any other word of the label stands for, such as a run's name

    def chosen(self, name: str, which: str) -> Mapping[str, Any]:
        """The parameters that `which`, the part of a label behind its slash, stands for.

        Raises:
            BadInput: the family `name` has no such variant or sweep.

        """
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

    def model_class(self, name: str, data: Path | None = None) -> Any:
        """The class of parameters; that of the recordings in the directory `data`, where the family has several.

        Raises:
            BadInput: it cannot be imported, or is not a pydantic model; or `data` cannot be read.

        """
        cls: Any = self.model
        if self.by_data and data is not None:
            cls = loaded(self.by_data, f"what chooses the model of scenario {name!r}")(data)
        if isinstance(cls, str):
            cls = loaded(cls, f"the model {cls} of scenario {name!r}")
        if not hasattr(cls, "model_fields"):
            raise BadInput(f"the model of scenario {name!r} is {cls!r}; it must be a pydantic model")
        return cls

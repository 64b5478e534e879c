"""A plain class with its parameters and what is said of it: what `PerRobot` and `PerTeam` are made from.

What is not said in the call is read from the class, so that it can be named on the command line as it is:

    class Ukf:
        uses = ("odometry", "anchor_rssi")
        axes = "its sigma points lie along the axes"
        def __init__(self, prior, world, robot, key, alpha: float = cl.tunable(0.5, 0.01, 1, log=True)): ...
"""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import Field, dataclass
from typing import Any, ClassVar, Self

from cooploc.estimators.interface import Keys
from cooploc.estimators.lifting.global_random import keyed
from cooploc.estimators.lifting.parameters import completed, parameters, value

STEPS = ("init", "predict", "correct", "send", "fuse", "exchange", "estimate")


@dataclass(frozen=True, init=False, repr=False)
class Lift:
    """What makes the objects, and what is said of them."""

    make: Callable[..., Any]
    uses: tuple[str, ...]
    axes: str
    counted: tuple[str, ...]  # names of attributes that are shown as notes under the table
    own_random: bool
    stated: tuple[tuple[str, Any], ...]  # parameters that differ from their defaults
    api: ClassVar[int] = 1
    mutable: ClassVar[bool] = True  # exempt from the check that a method leaves the state it is given alone
    given: ClassVar[tuple[str, ...]] = ()  # what `make` takes before its parameters
    own_motion: str
    more: ClassVar[Mapping[str, Any]] = {}  # what else may be said in the class or in the call, with its default

    def __init__(
        self,
        make: Callable[..., Any],
        uses: tuple[str, ...] | None = None,
        *,
        axes: str | None = None,
        notes: tuple[str, ...] | None = None,
        own_random: bool | None = None,
        own_motion: str | None = None,
        **parameters: Any,
    ) -> None:
        called: dict[str, Any] = {"uses": uses, "axes": axes, "notes": notes, "own_random": own_random}
        called |= {"own_motion": own_motion, **{name: parameters.pop(name, None) for name in self.more}}
        defaults: dict[str, Any] = {"uses": ("odometry",), "axes": "", "notes": (), "own_random": False}
        defaults |= {"own_motion": "", **self.more}
        fields: dict[str, Any] = {"make": make, "stated": tuple(sorted(parameters.items()))}
        for name, one in called.items():
            said = getattr(make, name, defaults[name]) if one is None else one
            fields["counted" if name == "notes" else name] = said
        for name, one in fields.items():
            object.__setattr__(self, name, one)  # as the `__init__` of a frozen dataclass does
        self._completed()

    @property
    def name(self) -> str:
        """That of the class."""
        return getattr(self.make, "__name__", type(self.make).__name__)

    @property
    def trained_on(self) -> str:
        """What the class says that it was trained on."""
        said: str = getattr(self.make, "trained_on", "")
        return said

    @property
    def label(self) -> str:
        """The name with the parameters that were stated, as on the command line."""
        written = ",".join(f"{key}={value(one)}" for key, one in self.stated)
        return f"{self.name}[{written}]" if written else self.name

    @property
    def parameters(self) -> dict[str, Any]:
        """Every parameter's value, by name."""
        return {key: value(one) for key, one in self._completed().items()}

    @property
    def fields(self) -> dict[str, Field[Any]]:
        """What `cl.tunable(...)` made, in the class's signature or in the call, by the parameter's name."""
        signed = {key: one.default for key, one in (parameters(self.make, self.given) or {}).items()}
        made = signed | {key: one for key, one in self.stated if isinstance(one, Field)}
        return {key: one for key, one in made.items() if isinstance(one, Field)}

    def with_parameters(self, **changed: Any) -> Self:
        """The same with some parameters changed.

        Raises:
            TypeError: the class has no such parameter.

        """
        said: dict[str, Any] = {"axes": self.axes, "notes": self.counted, "own_random": self.own_random}
        said |= {name: getattr(self, name) for name in ("own_motion", *self.more)}
        return type(self)(self.make, self.uses, **said, **{**dict(self.stated), **changed})

    def random(self, key: Keys, tick: int, step: str) -> AbstractContextManager[None]:
        """Global random numbers of one call; those of the process where the class did not ask for its own."""
        return keyed(key.ravel(), tick + 1, STEPS.index(step)) if self.own_random else nullcontext()

    def _completed(self) -> dict[str, Any]:
        return completed(self.name, parameters(self.make, self.given), dict(self.stated))

    def __repr__(self) -> str:
        written = "".join(f", {key}={value(one)!r}" for key, one in self.stated)
        return f"{type(self).__name__}({self.name}{written})"

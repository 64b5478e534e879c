"""Worlds, the streams they give, and the runner that feeds them to estimators.

A scenario is one world with a fixed team. Its label carries what is swept, `packet-drop/drop=0.7`, and any other
parameter in brackets, `trajectory[ticks=50]`. A scenario's class is a pydantic model of parameters with two methods,
`world()` and `simulate(label, trials, seed, world)`. To add one: write a file like `paper.py` and give it a line in
`BUILTIN`. From outside, register a `Family` under the entry-point group `cooploc.scenarios`, or name one in a file,
`path.py:NAME`, where a label begins with a name.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from importlib.metadata import entry_points
from operator import index
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from pydantic import ValidationError

from cooploc.estimators import nearest, parse
from cooploc.estimators.interface import World
from cooploc.estimators.plugins.entry_points import listed_points, only_one
from cooploc.estimators.plugins.errors import BadInput
from cooploc.estimators.plugins.python_file import found_in_file, is_file
from cooploc.scenarios.stream import Stream, Truth

GROUP = "cooploc.scenarios"


class Scenario(Protocol):
    """A world with its parameters."""

    def world(self) -> World: ...

    def simulate(self, label: str, trials: Sequence[int], seed: int, world: World) -> tuple[Truth, Stream]: ...

    def model_dump(self, *, mode: str = ..., exclude: set[str] = ...) -> dict[str, Any]: ...


@dataclass(frozen=True)
class Family:
    """Scenarios that differ in one thing."""

    about: str
    model: str | type  # "module:Class", or the class
    base: Mapping[str, Any] = field(default_factory=dict)  # parameters that differ from the class's defaults
    sweep: Mapping[str, str] = field(default_factory=dict)  # the label's short name -> parameter
    variants: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # the label's word -> parameters
    recorded: bool = False  # needs a directory of recordings, and has one trial unless it counts them
    word: str = ""  # the parameter that any other word of the label is, such as a run's name


PAPER = "cooploc.scenarios.worlds.radio_arena:Paper"
WALLS = ((2.0, 1.0, 2.0, 3.5), (3.5, 4.0, 5.0, 4.0))
# What the real logs look like: 4.4 dB and lag-1 correlation 0.55 in all, of which 1 dB and the rounding are white.
HARDWARE = {"eta": 1.4, "shadowing": 4.275, "shadow_correlation": 0.583, "rounding": 1.0}

BUILTIN: dict[str, Family] = {
    "robots-1-3": Family("one to three robots in the 6 m arena", PAPER, sweep={"n": "robots"}),
    "trajectory": Family("three robots in the 6 m arena", PAPER),
    "scalability": Family("one to a hundred robots in the 6 m arena", PAPER, sweep={"n": "robots"}),
    "packet-drop": Family("five robots that lose packets", PAPER, {"robots": 5, "drop": 0.7}, {"drop": "drop"}),
    "nlos": Family(
        "three robots, two walls and three wandering obstacles; bias: of ranges without line of sight [m]",
        PAPER,
        {"walls": WALLS, "obstacles": 3},
        {"bias": "nlos_range_bias", "n": "robots"},
    ),
    "arena-60m": Family(
        "three robots in a 60 m arena, by the spread of the prior",
        PAPER,
        {"side": 60.0, "step": 1.0, "odometry_sigma": 0.2},
        {"sd": "prior_sigma"},
    ),
    "asynchrony": Family(
        "three robots that wake in every, every other and every fourth tick; samples: readings averaged in a tick",
        PAPER,
        {"rate": (1.0, 0.5, 0.25), "phase": (0.0, 0.5, 0.25)},
        {"samples": "samples"},
    ),
    "anchors": Family("three robots and 3 to 8 nodes along the rim", PAPER, sweep={"a": "anchors"}),
    "radio-range": Family("three robots that hear nodes and each other up to r [m]", PAPER, sweep={"r": "radio_range"}),
    "hardware": Family(
        "shadowing with memory, rounded readings: what real logs look like", PAPER, HARDWARE, {"n": "robots"}
    ),
    "body-blocking": Family("robots of the team block links too", PAPER, {"body_blocking": True}, {"n": "robots"}),
    "camera": Family(
        "simulated wheeled robots that see landmarks and each other",
        "cooploc.scenarios.worlds.camera_arena:Camera",
        sweep={"n": "robots"},
    ),
    "mrclam": Family(
        "UTIAS MRCLAM: five real robots; all, one or none of them use landmarks",
        "cooploc.scenarios.recordings.mrclam:Mrclam",
        variants={word: {"sees": word} for word in ("all", "one", "none")},
        recorded=True,
    ),
    "log": Family(
        "a user's own recordings of one robot: a run by name, or all; --data DIR holds CSV files and log.toml",
        "cooploc.scenarios.recordings.logs.scenario:Log",
        recorded=True,
        word="run",
    ),
    "wifi": Family(
        "a real robot among four WiFi nodes (Latif & Parasuraman): a run by name, or all",
        "cooploc.scenarios.recordings.logs.scenario:Log",
        {"described": "wifi"},
        recorded=True,
        word="run",
    ),
}


def names() -> list[str]:
    """Every family of scenarios."""
    return [*BUILTIN, *(name for name in sorted(_plugins()) if name not in BUILTIN)]


def family(label: str) -> Family:
    """The family that a label belongs to.

    Raises:
        BadInput: there is none, or its plug-in cannot be imported.

    """
    name, _ = _parts(label)
    if name in BUILTIN:
        return BUILTIN[name]
    if is_file(name):
        found, where = found_in_file(name), f"the scenario {name}"
    else:
        point = _plugin(name)
        where = f"the plug-in scenario {name!r} ({point.value})"
        try:
            found = point.load()
        except (Exception, SystemExit) as e:
            raise BadInput(f"{where} cannot be imported: {type(e).__name__}: {e}") from e
    if not isinstance(found, Family):
        raise BadInput(f"{where} is no cooploc Family")
    return found


def source_of(label: str) -> tuple[str, str]:
    """A label's name, and the module that a plug-in of that name is in; empty for a built-in one and one in a file.

    Raises:
        BadInput: there is no such plug-in, or there are two.

    """
    name, _ = _parts(label)
    return name, "" if name in BUILTIN or is_file(name) else _plugin(name).module


def _parts(label: str) -> tuple[str, str]:
    """The name of a label and what stands behind its slash; a file's path may hold slashes of its own."""
    path = parse(label)[0]
    if path.endswith(".py"):
        return path, ""  # refused by is_file, with the remedy
    in_file = re.fullmatch(r"(.+\.py:[^/]*)/?(.*)", path)
    if in_file:
        return in_file[1], in_file[2]
    name, _, which = path.partition("/")
    return name, which


def _plugin(name: str) -> Any:
    """The entry point of a plug-in."""
    plugins = _plugins()
    if name not in plugins:
        raise BadInput(f"there is no scenario {name!r}; {nearest(name, names())}")
    return only_one("scenario", name, plugins[name])


def scenario(label: str, **overrides: Any) -> Scenario:
    """The world of a label, with parameters overridden.

    Raises:
        BadInput: an unknown scenario, variant or parameter, or a value that does not fit.

    """
    found = family(label)
    _, written = parse(label)
    name, which = _parts(label)
    cls = _class(name, found)
    given: dict[str, Any] = {**found.base, **_chosen(found, name, which), **written, **overrides}
    for key in given:
        if key not in cls.model_fields:
            raise BadInput(f"scenario {name!r} has no parameter {key!r}; {nearest(key, list(cls.model_fields))}")
    try:
        made: Scenario = cls(**given)
    except ValidationError as e:
        first = e.errors()[0]
        raise BadInput(f"scenario {label!r}, {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    return made


def _class(name: str, found: Family) -> Any:
    """The class of a family's parameters.

    Raises:
        BadInput: it cannot be imported, or is no pydantic model.

    """
    cls: Any = found.model
    if isinstance(cls, str):
        module, _, attribute = cls.partition(":")
        try:
            cls = getattr(import_module(module), attribute)
        except (Exception, SystemExit) as e:
            raise BadInput(
                f"the model {found.model} of scenario {name!r} cannot be imported: {type(e).__name__}: {e}"
            ) from e
    if not hasattr(cls, "model_fields"):
        raise BadInput(f"the model of scenario {name!r} is {cls!r}; it must be a pydantic model")
    return cls


def simulate(
    label: str,
    *,
    trials: int | Sequence[int] = 1,
    seed: int = 0,
    assumed: Mapping[str, Any] | None = None,
    data: str | Path | None = None,
    **overrides: Any,
) -> tuple[Truth, Stream]:
    """The truth and the stream of a scenario.

    Args:
        label: a scenario, such as "packet-drop/drop=0.7".
        trials: how many, or which; a recording has one.
        seed: of everything random.
        assumed: parameters that the team is told wrongly; the readings stay bit-identical.
        data: the directory of a recording.
        overrides: parameters of the scenario; they become part of its label.

    Raises:
        BadInput: anything unknown, out of bounds, or missing; one line that says what to do.

    """
    count, seed = _numbers(trials), _whole(seed, "seed")
    if family(label).recorded:
        if data is None:
            raise BadInput(f"scenario {label!r} is a recording; say where it lies with data= (or --data DIR)")
        overrides = {**overrides, "data": data}
    made = _of(scenario(label, **overrides), count)
    told = _told(label, made.world(), overrides, assumed, count) if assumed else made.world()
    return made.simulate(labelled(label, overrides), count, seed, told)


def _numbers(trials: Any) -> list[int]:
    """The trials' numbers, each once."""
    if isinstance(trials, Iterable):
        numbers = [_whole(k, "one of the trials") for k in trials]
    else:
        numbers = list(range(_whole(trials, "trials")))
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


def _of(made: Scenario, trials: Sequence[int]) -> Scenario:
    """The scenario of these trials, where trials differ in what is told: recordings of several runs."""
    chosen: Scenario = made.at(trials) if hasattr(made, "at") else made
    return chosen


def _told(
    label: str, true: World, overrides: Mapping[str, Any], assumed: Mapping[str, Any], trials: Sequence[int]
) -> World:
    """The world of other parameters, where it differs in nothing that the shape or the clock of the readings shows."""
    told = _of(scenario(label, **{**overrides, **assumed}), trials).world()
    for what in ("robots", "tick", "t0", "arena", "anchors", "landmarks"):
        if not np.array_equal(getattr(told, what), getattr(true, what)):
            raise BadInput(f"assumed={dict(assumed)!r} would change the world's {what}: make it an override instead")
    return told


def labelled(label: str, overrides: Mapping[str, Any]) -> str:
    """The label with its overrides in brackets."""
    path, written = parse(label)
    shown = {**written, **{k: v for k, v in overrides.items() if k != "data"}}
    return path + (f"[{','.join(f'{k}={v}' for k, v in sorted(shown.items()))}]" if shown else "")


def plugin_errors() -> dict[str, str]:
    """Installed plug-ins that cannot be used, by name, with the reason."""
    errors = {}
    for name, points in _plugins().items():
        if name in BUILTIN:
            errors[name] = f"the name belongs to a built-in scenario, so {points[0].value} is ignored"
        else:
            try:
                _class(name, family(name))
            except BadInput as e:
                errors[name] = str(e)
    return errors


def _plugins() -> Mapping[str, list[Any]]:
    return listed_points(entry_points(group=GROUP))


def _chosen(found: Family, name: str, which: str) -> Mapping[str, Any]:
    """What stands behind the slash of a label, as parameters."""
    if not which:
        return {}
    if which in found.variants:
        return found.variants[which]
    key, equals, value = which.partition("=")
    if equals and key in found.sweep:
        return {found.sweep[key]: value}
    if found.word:
        return {found.word: which}
    known = [*found.variants, *(f"{key}=..." for key in found.sweep)]
    raise BadInput(f"scenario {name!r} has no {which!r}; known are {', '.join(known) or 'none'}")

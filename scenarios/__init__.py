"""Worlds, the streams they give, and the runner that feeds them to estimators.

A scenario is one world with a fixed team. Its label carries what is swept, `packet-drop/drop=0.7`, and any other
parameter in brackets, `trajectory[ticks=50]`; in `trajectory[assumed.eta=2]` the team assumes another value than the
true one; `scenario.py` lists the options of any label. To add a family: write a model like
`worlds/camera.py`, and give it an entry in `BUILTIN`. From outside, register a `Family` under the entry-point
group `cooploc.scenarios`, or name one in a file, `path.py:NAME`, where a label begins with a name.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cooploc.estimators.errors import BadInput
from cooploc.estimators.label_syntax import parse
from cooploc.estimators.registry import CallablePackage, Registry, source_of
from cooploc.scenarios.scenario import Family as Family
from cooploc.scenarios.scenario import ResolvedScenario, build_scenario, split_family
from cooploc.scenarios.stream import Stream, Truth

if TYPE_CHECKING:
    from pandas import DataFrame

PAPER = "cooploc.scenarios.worlds.radio:Paper"
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
    "arena-28m": Family(
        "three robots in an arena of 800 m^2, whose corners are 40 m apart at most, that hear up to r [m]",
        PAPER,
        {"side": 28.28, "step": 0.5, "odometry_sigma": 0.1},
        {"r": "radio_range"},
    ),
    "asynchrony": Family(
        "three robots that wake in every, every second and every fourth tick; samples: readings averaged in a tick",
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
    "no-compass": Family(
        "wheeled robots in the 6 m arena that do not know their heading; sd: of the prior heading [rad]",
        "cooploc.scenarios.worlds.no_compass:NoCompass",
        sweep={"n": "robots", "sd": "prior_heading"},
    ),
    "uwb": Family(
        "three robots whose ranges err as real ultra-wide-band radios do; outliers: share of late signals",
        "cooploc.scenarios.worlds.uwb:UwbArena",
        sweep={"n": "robots", "outliers": "outliers"},
        variants={word: {"bias": word} for word in ("raw", "removed")},
    ),
    "camera": Family(
        "simulated wheeled robots that see landmarks and each other",
        "cooploc.scenarios.worlds.camera:Camera",
        sweep={"n": "robots"},
    ),
    "mrclam": Family(
        "UTIAS MRCLAM: five real robots; all, one or none of them use landmarks",
        "cooploc.scenarios.recordings.mrclam:Mrclam",
        variants={word: {"sees": word} for word in ("all", "one", "none")},
        recorded=True,
    ),
    "log": Family(
        "your own recordings of one robot or a team: a run by name, or all; --data DIR holds them and log.toml",
        "cooploc.scenarios.recordings.scenario:TeamScenario",
        recorded=True,
        word="run",
    ),
    "wifi": Family(
        "a real robot among four WiFi nodes (Latif & Parasuraman): a run by name, or all",
        "cooploc.scenarios.recordings.scenario:TeamScenario",
        {"described": "wifi"},
        recorded=True,
        word="run",
    ),
}


ASSUMED = "assumed."  # before a parameter of a label: the team assumes this value, and the readings keep the true one
REGISTRY = Registry("scenario", "cooploc.scenarios", BUILTIN)
names, module_of = REGISTRY.names, REGISTRY.module_of


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
        trials: how many, or their numbers; a recording has one.
        seed: random seed; every random number depends on it, on the trial and on nothing else.
        assumed: parameters that the team assumes instead of the true ones, {"eta": 2.0}; the readings stay
            bit-identical. As the overrides, they become part of the label, "trajectory[assumed.eta=2]", and so of the
            stream's hash: rows with other assumptions are not paired.
        data: the directory of a recording.
        overrides: parameters of the scenario, by the names that its label or its table of parameters has; they become
            part of its label. Every scenario has `team_priors=True`, which tells every robot everyone's prior (the
            channel "team_prior", `cl.priors_of`).

    Raises:
        BadInput: anything unknown, out of bounds, or missing; one line that says what to do.
    """
    if several := [key for key, value in overrides.items() if isinstance(value, set | frozenset)]:
        raise BadInput(f"{several[0]} is a set of values; a stream has one: cl.sweep runs estimators at each of them")
    return resolve(label, data, assumed, **overrides).simulate(trials, seed)


def resolve(
    label: str, data: str | Path | None = None, assumed: Mapping[str, Any] | None = None, **overrides: Any
) -> ResolvedScenario:
    """Return the scenario of a label, with parameters overridden, or `assumed` by the team beside those in the label.

    Raises:
        BadInput: an unknown scenario, variant or parameter, a value that does not fit, or a recording without `data`.
    """
    if not isinstance(label, str):
        raise BadInput(
            f"a scenario is named by its label, not by an object of type {type(label).__name__}: write a world of your "
            f"own into a file, in a notebook by %%writefile field.py, and name it 'field.py:NAME'"
        )
    assumed = assumed or {}
    path, written = parse(label)
    name, which = split_family(path)
    found = family(name)
    own = {key: value for key, value in written.items() if not key.startswith(ASSUMED)}
    stated = {key.removeprefix(ASSUMED): value for key, value in written.items() if key not in own}
    own = {found.sweep.get(key, key): value for key, value in {**own, **overrides}.items()}
    parameters = {**found.base, **found.parameters_of(name, which), **own}
    if overrides or assumed:  # an assumed 2.0 is 2 in a label, as in one that is written by hand
        added = {f"{ASSUMED}{key}": str(value).removesuffix(".0") for key, value in assumed.items()}
        shown = {**written, **overrides, **added}
        label = f"{path}[{','.join(f'{key}={shown[key]}' for key in sorted(shown))}]"
    if found.recorded:
        if data is None:
            raise BadInput(f"scenario {label!r} is a recording; say where it is with data= (or --data DIR)")
        parameters["data"] = Path(data)
    return build_scenario(label, name, found, parameters, {**stated, **assumed})


def family(name: str) -> Family:
    """Return the family of a name.

    Raises:
        BadInput: there is none, or its plug-in cannot be imported.
    """
    found = REGISTRY.find(name)
    if not isinstance(found, Family):
        what = f"the class {found.__name__}" if isinstance(found, type) else f"of type {type(found).__name__}"
        remedy = 'name what cooploc.scenarios.Family("what it is", CLASS) makes'
        raise BadInput(f"the scenario {name!r} is {what} and no Family: {remedy}")
    return found


def plugin_errors() -> dict[str, str]:
    """Return installed plug-ins that cannot be used, by name, with the reason."""

    def reason(name: str) -> str:
        try:
            family(name).model_class(name)
        except BadInput as e:
            return str(e)
        return ""

    return REGISTRY.errors(reason)


def list_scenarios() -> "DataFrame":
    """Return a table with a row for each family of scenarios, the built-in ones first.

    Columns: `name`; `about`, in a sentence; `labels`, how its members are written; `parameters`, what can be set in
    brackets or by keyword; `source`, the paper or data set; `problem`, why a plug-in cannot be used, else empty.
    """
    from pandas import DataFrame

    problems, rows = plugin_errors(), []
    for name in names():
        if name in problems:
            continue
        known = family(name)
        model = known.model_class(name)
        parameters = ", ".join(field for field in model.model_fields if field != "data")
        rows.append([name, known.about, labels_of(name, known), parameters, source_of(model), ""])
    rows += [[name, "", "", "", "", why] for name, why in problems.items()]
    return DataFrame(rows, columns=["name", "about", "labels", "parameters", "source", "problem"])


def labels_of(name: str, known: Family) -> str:
    """Return how the members of a family of scenarios are written."""
    labels = [f"{name}/{key}=…" for key in known.sweep] + [f"{name}/{word}" for word in known.variants]
    labels += [f"{name}/{known.word.upper()}"] if known.word else []
    return ", ".join(labels or [name])


sys.modules[__name__].__class__ = CallablePackage

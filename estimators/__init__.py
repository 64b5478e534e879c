"""What a robot runs. An estimator imports nothing of the world it is judged in.

To add one: write a file like `ekf_local.py`, and give it a line in `BUILTIN`. From outside, register a class under the
entry-point group `cooploc.estimators`, or pass an instance to `cl.run`.
"""

import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

from pydantic import TypeAdapter, ValidationError

from cooploc.estimators.bad_input import BadInput

GROUP = "cooploc.estimators"

# name -> where it is, and the parameters that make it that
BUILTIN: dict[str, tuple[str, dict[str, Any]]] = {
    "dead-reckoning": ("cooploc.estimators.dead_reckoning:DeadReckoning", {}),
    "arl": ("cooploc.estimators.arl:Arl", {}),
    "rssi-pf": ("cooploc.estimators.arl:Arl", {"own": "rssi"}),
    "mrsl-rssi": ("cooploc.estimators.mrsl:Mrsl", {"reading": "rssi"}),
    "mrsl-distance": ("cooploc.estimators.mrsl:Mrsl", {"reading": "range"}),
    "ctrn": ("cooploc.estimators.ctrn:Ctrn", {}),
    "ekf-local": ("cooploc.estimators.ekf_local:EkfLocal", {}),
    "ekf-joint": ("cooploc.estimators.ekf_joint:EkfJoint", {}),
    "ekf-naive": ("cooploc.estimators.ekf_naive:EkfNaive", {}),
    "ekf-ci": ("cooploc.estimators.ekf_ci:EkfCi", {}),
    "ekf-split-ci": ("cooploc.estimators.ekf_split_ci:EkfSplitCi", {}),
    "ekf-luft": ("cooploc.estimators.ekf_luft:EkfLuft", {}),
    "ekf-interim": ("cooploc.estimators.ekf_interim:EkfInterim", {}),
    "ukf-joint": ("cooploc.estimators.ukf_joint:UkfJoint", {}),
}


def names() -> list[str]:
    """Every estimator that can be made by name: the built-in ones, then those of installed plug-ins."""
    return [*BUILTIN, *(name for name in sorted(_plugins()) if name not in BUILTIN)]


def make(name: str, **parameters: Any) -> Any:
    """An estimator by name, `make("mrsl-rssi", particles=500)` or `make("mrsl-rssi[particles=500]")`.

    Raises:
        BadInput: an unknown name or parameter, or a value that does not fit; says the nearest known one.

    """
    name, written = parse(name)
    cls, preset = _find(name)
    given = {**preset, **written, **parameters}
    if not (is_dataclass(cls) and isinstance(cls, type)):
        raise BadInput(f"estimator {name!r} is not a dataclass of parameters: pass an instance to cl.run instead")
    known = [f.name for f in fields(cls) if f.init and f.name != "uses"]
    for key in given:
        if key not in known:
            raise BadInput(f"estimator {name!r} has no parameter {key!r}; {nearest(key, known)}")
    try:
        return TypeAdapter(cls).validate_python(given)
    except ValidationError as e:
        first = e.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "its parameters"
        raise BadInput(f"estimator {name!r}, {where}: {first['msg']}") from None


def parse(configured: str) -> tuple[str, dict[str, str]]:
    """`mrsl-rssi[particles=500,own=rssi]` as its name and its parameters."""
    match = re.fullmatch(r"\s*([^\[\]\s]+)\s*(?:\[([^\[\]]*)\])?\s*", configured)
    if match is None:
        raise BadInput(f"cannot read the estimator {configured!r}; write it like mrsl-rssi[particles=500,own=rssi]")
    parameters = {}
    for item in filter(None, (part.strip() for part in (match[2] or "").split(","))):
        key, equals, value = (part.strip() for part in item.partition("="))
        if not (key and equals and value):
            raise BadInput(f"cannot read {item!r} in the estimator {configured!r}; write name=value")
        parameters[key] = value
    return match[1], parameters


def split(listed: str) -> list[str]:
    """A comma-separated list of configured estimators, commas inside brackets left alone."""
    return [part.strip() for part in re.split(r",(?![^\[]*\])", listed) if part.strip()]


def nearest(name: str, known: list[str]) -> str:
    """The end of an error message: the nearest known name, or all of them."""
    close = get_close_matches(name, known, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}?" if close else f"known are {', '.join(known)}"


def plugin_errors() -> dict[str, str]:
    """Installed plug-ins that cannot be used, by name, with the reason."""
    errors = {
        name: f"the name belongs to a built-in estimator, so {p.value} is ignored"
        for name, p in _plugins().items()
        if name in BUILTIN
    }
    for name, point in _plugins().items():
        if name not in errors:
            try:
                point.load()
            except Exception as e:  # a plug-in may fail in any way
                errors[name] = f"{point.value} cannot be imported: {type(e).__name__}: {e}"
    return errors


def _plugins() -> Mapping[str, Any]:
    return {point.name: point for point in entry_points(group=GROUP)}


def _find(name: str) -> tuple[Any, dict[str, Any]]:
    if name in BUILTIN:
        path, preset = BUILTIN[name]
        module, _, attribute = path.partition(":")
        return getattr(import_module(module), attribute), preset
    plugins = _plugins()
    if name not in plugins:
        raise BadInput(f"there is no estimator {name!r}; {nearest(name, names())}")
    try:
        return plugins[name].load(), {}
    except Exception as e:
        raise BadInput(f"the plug-in estimator {name!r} ({plugins[name].value}) cannot be imported: {e}") from e

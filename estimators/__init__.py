"""What a robot runs. An estimator imports nothing of the world it is judged in.

To add one: write a file like `ekf_local.py`, and give it a line in `BUILTIN`. From outside, name it `path.py:Name`,
register a class under the entry-point group `cooploc.estimators`, or pass an instance to `cl.run`.
"""

import re
import warnings
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

from pydantic import TypeAdapter, ValidationError
from pydantic.errors import PydanticUserError

from cooploc.estimators.interface import API
from cooploc.estimators.plugins.entry_points import listed_points, only_one
from cooploc.estimators.plugins.errors import BadInput
from cooploc.estimators.plugins.errors import nearest as nearest
from cooploc.estimators.plugins.python_file import found_in_file, is_file

GROUP = "cooploc.estimators"
RENAMED = {"own": "anchor_reading"}  # old spellings of parameters

# name -> where it is, and the parameters that make it that
BUILTIN: dict[str, tuple[str, dict[str, Any]]] = {
    "dead-reckoning": ("cooploc.estimators.dead_reckoning:DeadReckoning", {}),
    "arl": ("cooploc.estimators.arl:Arl", {}),
    "rssi-pf": ("cooploc.estimators.arl:Arl", {"anchor_reading": "rssi"}),
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

    Args:
        name: of a built-in or a plug-in, or `path.py:Name`, where Name is a class or an instance.
        parameters: those that differ from the defaults.

    Raises:
        BadInput: an unknown name or parameter, or a value that does not fit; says the nearest known one.

    """
    name, written = parse(name)
    found, preset = (found_in_file(name), {}) if is_file(name) else _find(name)
    given = {**preset, **written, **parameters}
    if not isinstance(found, type):
        if given:
            raise BadInput(f"{name} is an instance and takes no parameters: name its class instead")
        return found
    if not is_dataclass(found):
        if given:
            raise BadInput(f"estimator {name!r} is not a dataclass, so it has no parameters: decorate its class")
        return _called(name, found, {})
    known = [f.name for f in fields(found) if f.init and f.name != "uses"]
    given = {_today(name, key, known): value for key, value in given.items()}
    for key in given:
        if key not in known:
            raise BadInput(f"estimator {name!r} has no parameter {key!r}; {nearest(key, known)}")
    return _validated(name, found, given)


def _today(name: str, key: str, known: list[str]) -> str:
    """The parameter's name today; an old spelling is accepted for one version, with a warning."""
    new = RENAMED.get(key, "")
    if key in known or new not in known:
        return key
    warnings.warn(f"estimator {name!r}: write {new}= instead of {key}=", FutureWarning, stacklevel=3)
    return new


def _validated(name: str, cls: type, given: dict[str, Any]) -> Any:
    """A dataclass of parameters, each made what its annotation says."""
    try:
        return TypeAdapter(cls).validate_python(given)
    except ValidationError as e:
        first = e.errors()[0]
        if first["type"] == "missing":
            raise BadInput(
                f"{name} cannot be made without arguments (it needs {first['loc'][0]}); give its parameters defaults, "
                f"or name an instance"
            ) from None
        where = ".".join(str(part) for part in first["loc"]) or "its parameters"
        raise BadInput(f"estimator {name!r}, {where}: {first['msg']}") from None
    except PydanticUserError:  # an annotation that only its author understands
        return _called(name, cls, given)


def _called(name: str, cls: type, given: dict[str, Any]) -> Any:
    try:
        return cls(**given)
    except Exception as e:  # a constructor may fail in any way
        raise BadInput(
            f"{name} cannot be made without arguments ({type(e).__name__}: {e}); give its parameters defaults, or name "
            f"an instance"
        ) from e


def parse(configured: str) -> tuple[str, dict[str, str]]:
    """`mrsl-rssi[particles=500,own=rssi]` as its name and its parameters."""
    match = re.fullmatch(r"\s*([^\[\]]*[^\[\]\s])\s*(?:\[([^\[\]]*)\])?\s*", configured)
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


def module_of(name: str) -> str:
    """The module that an installed plug-in's estimator is in; empty for a built-in one, and for one in a file.

    Raises:
        BadInput: there is no such plug-in, or there are two.

    """
    if name in BUILTIN or is_file(name):
        return ""
    module: str = _plugin(name).module
    return module


def plugin_errors() -> dict[str, str]:
    """Installed plug-ins that cannot be used, by name, with the reason."""
    errors = {
        name: f"the name belongs to a built-in estimator, so {points[0].value} is ignored"
        for name, points in _plugins().items()
        if name in BUILTIN
    }
    for name in _plugins():
        if name not in errors and (reason := _unusable(name)):
            errors[name] = reason
    return errors


def _unusable(name: str) -> str:
    """Why a plug-in cannot be used, in a line; empty where it can."""
    try:
        made = make(name)
        api, uses = getattr(made, "api", None), getattr(made, "uses", None)
    except BadInput as e:
        return str(e)
    except Exception as e:  # a plug-in may fail in any way
        return f"{type(e).__name__}: {e}"
    if api != API:
        return f"it is written for interface {api!r}, this is version {API}: set api = {API}"
    if not (isinstance(uses, tuple) and all(isinstance(channel, str) for channel in uses)):
        return f"uses is {uses!r}; it must be a tuple of channel names"
    return ""


def _plugins() -> Mapping[str, list[Any]]:
    return listed_points(entry_points(group=GROUP))


def _plugin(name: str) -> Any:
    """The entry point of a plug-in."""
    plugins = _plugins()
    if name not in plugins:
        raise BadInput(f"there is no estimator {name!r}; {nearest(name, names())}")
    return only_one("estimator", name, plugins[name])


def _find(name: str) -> tuple[Any, dict[str, Any]]:
    if name in BUILTIN:
        path, preset = BUILTIN[name]
        module, _, attribute = path.partition(":")
        return getattr(import_module(module), attribute), preset
    point = _plugin(name)
    try:
        return point.load(), {}
    except (Exception, SystemExit) as e:
        raise BadInput(
            f"the plug-in estimator {name!r} ({point.value}) cannot be imported: {type(e).__name__}: {e}"
        ) from e

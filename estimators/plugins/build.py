"""An instance of an estimator's class from parameters that a user wrote, each converted to what its annotation says."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from typing import Any

from pydantic import TypeAdapter, ValidationError
from pydantic.errors import PydanticUserError

from cooploc.estimators.plugins.errors import BadInput, first_reason, nearest, one_line

RENAMED = {"own": "anchor_reading"}  # old spellings of parameters, accepted for one version


@dataclass(frozen=True)
class ConfiguredEstimator:
    """An estimator's label that has been read: passed on instead of the label."""

    label: str  # as written
    name: str
    parameters: Mapping[str, str]  # as written
    builtin: bool


def build(name: str, found: Any, given: Mapping[str, Any]) -> Any:
    """An instance of the class `found`, or `found` itself where it is an instance.

    Raises:
        BadInput: an unknown parameter, a value that does not fit, or a class that cannot be instantiated.

    """
    if not isinstance(found, type):
        if given:
            raise BadInput(f"{name} is an instance and takes no parameters: name its class instead")
        return found
    if not is_dataclass(found):
        if given:
            raise BadInput(f"estimator {name!r} is not a dataclass, so it has no parameters: decorate its class")
        return _called(name, found, {})
    known = [f.name for f in fields(found) if f.init and f.name != "uses"]
    given = {_current(name, key, known): value for key, value in given.items()}
    for key in given:
        if key not in known:
            raise BadInput(f"estimator {name!r} has no parameter {key!r}; {nearest(key, known)}")
    return _validated(name, found, given)


def _current(name: str, key: str, known: list[str]) -> str:
    """The parameter's present name; an old spelling is accepted, with a warning."""
    new = RENAMED.get(key, "")
    if key in known or new not in known:
        return key
    warnings.warn(f"estimator {name!r}: write {new}= instead of {key}=", FutureWarning, stacklevel=4)
    return new


def _validated(name: str, cls: type, given: dict[str, Any]) -> Any:
    try:
        return _adapter(cls).validate_python(given)
    except ValidationError as e:
        first = e.errors()[0]
        if first["type"] == "missing":
            raise BadInput(_needs_arguments(name, f"it needs {first['loc'][0]}")) from None
        why = first_reason(e.errors()) if first["loc"] else first["msg"].removeprefix("Value error, ")
        raise BadInput(f"estimator {name!r}, {why}") from None
    except PydanticUserError:  # an annotation that pydantic does not know
        return _called(name, cls, given)


@cache
def _adapter(cls: type) -> TypeAdapter[Any]:
    """Made once for each class: it takes milliseconds."""
    return TypeAdapter(cls)


def _called(name: str, cls: type, given: dict[str, Any]) -> Any:
    try:
        return cls(**given)
    except (Exception, SystemExit, GeneratorExit) as e:  # a constructor may fail in any way
        raise BadInput(_needs_arguments(name, one_line(e))) from e


def _needs_arguments(name: str, why: str) -> str:
    return f"{name} cannot be made without arguments ({why}); give its parameters defaults, or name an instance"

"""An instance of an estimator's class from parameters that a user wrote, each converted to what its annotation says."""

import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import InitVar, dataclass, fields, is_dataclass
from functools import cache
from inspect import Parameter, signature
from typing import Any, get_type_hints

from pydantic import TypeAdapter, ValidationError
from pydantic.errors import PydanticUserError

from cooploc.estimators.plugins.errors import BadInput, first_reason, message, nearest, one_line

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
    parameters = _parameters(found)
    given = {_current(name, key, list(parameters)): value for key, value in given.items()}
    for key in given:
        if key not in parameters:
            raise BadInput(f"estimator {name!r} has no parameter {key!r}; {nearest(key, list(parameters))}")
    missing = [key for key, one in parameters.items() if one.default is Parameter.empty and key not in given]
    if missing:
        raise BadInput(_needs_arguments(name, f"it needs {missing[0]}"))
    return _called(name, found, {key: _validated(name, found, key, value) for key, value in given.items()})


def _parameters(cls: type) -> dict[str, Parameter]:
    """What its `__init__` takes, which may be the class's own; with `**rest`, its fields too."""
    taken = signature(cls).parameters
    named = {key: one for key, one in taken.items() if one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY)}
    if any(one.kind is one.VAR_KEYWORD for one in taken.values()):
        rest = [f.name for f in fields(cls) if f.init and f.name not in named]
        named |= {key: Parameter(key, Parameter.KEYWORD_ONLY, default=None) for key in rest}
    return {key: one for key, one in named.items() if key != "uses"}


def _current(name: str, key: str, known: list[str]) -> str:
    """The parameter's present name; an old spelling is accepted, with a warning."""
    new = RENAMED.get(key, "")
    if key in known or new not in known:
        return key
    warnings.warn(f"estimator {name!r}: write {new}= instead of {key}=", FutureWarning, stacklevel=4)
    return new


def _validated(name: str, cls: type, key: str, value: Any) -> Any:
    """A parameter's value, converted to the type of its annotation where it has one."""
    try:
        return _adapter(cls, key).validate_python(value)
    except ValidationError as e:
        first = e.errors()[0]
        raise BadInput(f"estimator {name!r}, {first_reason([{**first, 'loc': (key, *first['loc'])}])}") from None
    except (PydanticUserError, NameError):  # an annotation that pydantic does not know
        return value


@cache
def _adapter(cls: Any, key: str) -> TypeAdapter[Any]:
    """Made once for each parameter: it takes milliseconds."""
    hints = get_type_hints(cls, include_extras=True)
    with suppress(NameError):  # the `__init__` of a dataclass may repeat names of another module
        hints |= get_type_hints(cls.__init__, include_extras=True)
    hint = hints.get(key, Any)
    return TypeAdapter(hint.type if isinstance(hint, InitVar) else hint)


def _called(name: str, cls: type, given: dict[str, Any]) -> Any:
    """The class called, as Python would: no `__init__` is left out."""
    try:
        return cls(**given)
    except MemoryError:  # of the machine, not of the class
        raise
    except ValueError as e:  # a parameter that does not fit
        raise BadInput(f"estimator {name!r}, {message(e)}") from e
    except (Exception, SystemExit, GeneratorExit) as e:  # a constructor may fail in any way
        raise BadInput(_needs_arguments(name, one_line(e))) from e


def _needs_arguments(name: str, why: str) -> str:
    return f"{name} cannot be made without arguments ({why}); give its parameters defaults, or name an instance"

"""Make an estimator from its class and the parameters that a user wrote, each converted to its annotation."""

import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import InitVar, dataclass, fields, is_dataclass
from functools import cache
from inspect import Parameter, isfunction, signature
from typing import Annotated, Any, get_type_hints

from pydantic import Field, TypeAdapter, ValidationError
from pydantic.errors import PydanticUserError

from cooploc.estimators.adapters import Adapter, PerRobot, PerTeam
from cooploc.estimators.adapters import parameters as taken_by
from cooploc.estimators.adapters import value as unpacked
from cooploc.estimators.errors import BadInput, first_reason, message, nearest, one_line


def is_plain(found: Any) -> bool:
    """Return whether it is a class for one robot or one team, to be lifted."""
    return (
        isinstance(found, type)
        and not hasattr(found, "init")
        and hasattr(found, "predict")
        and hasattr(found, "correct")
    )


def adapt(name: str, plain: Any) -> PerRobot | PerTeam:
    """The plain class as an estimator: of a team where it has `exchange`, else of one robot.

    Raises:
        BadInput: it does not say what it reads, or cannot be called as `PerRobot` or `PerTeam` calls it.

    """
    lift: type[PerRobot | PerTeam] = PerTeam if hasattr(plain, "exchange") else PerRobot
    if not hasattr(plain, "uses"):
        raise BadInput(
            f'{name} is a plain class and does not say what it reads: write uses = ("odometry", ...) in it, or name '
            f"what cl.{lift.__name__}({plain.__name__}, uses=(...)) makes"
        )
    try:
        return lift(plain)
    except TypeError as e:
        raise BadInput(f"{name} cannot be lifted by cl.{lift.__name__}: {e}") from None


# What a parameter without an annotation is converted to, by the type of its default; else to the first that fits a word
WORD = Annotated[int | float | bool | str, Field(union_mode="left_to_right")]
UNSAID: dict[type, Any] = {bool: bool, int: Annotated[int | float, Field(union_mode="left_to_right")], float: float}
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

    A plain class for one robot, or for a team, is lifted; of what `PerRobot` and `PerTeam` made, parameters are those
    of the class inside; a function is called with the parameters.

    Raises:
        BadInput: an unknown parameter, a value that does not fit, or a class that cannot be instantiated.

    """
    found = adapt(name, found) if is_plain(found) else found
    if isinstance(found, Adapter):
        known = taken_by(found.make, found.given)
        return found.with_parameters(**_check_parameters(name, found.make, known, given)) if given else found
    if isfunction(found):
        return _instantiate(name, found, _check_parameters(name, found, dict(signature(found).parameters), given))
    if isinstance(found, type) and is_dataclass(found):
        known = _parameters(found)
        given = {_current(name, key, list(known)): value for key, value in given.items()}
        return _instantiate(name, found, _check_parameters(name, found, known, given))
    if given:
        if isinstance(found, type):
            raise BadInput(f"estimator {name!r} is not a dataclass, so it has no parameters: decorate its class")
        raise BadInput(f"{name} is an instance and takes no parameters: name its class instead")
    return _instantiate(name, found, {}) if isinstance(found, type) else found


def _check_parameters(
    name: str, make: Any, known: Mapping[str, Parameter] | None, given: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the given parameters, converted; `known` is None where any name is taken.

    Raises:
        BadInput: an unknown parameter, one that is missing, or a value that does not fit.

    """
    for key in given:
        if known is not None and key not in known:
            has = nearest(key, list(known)) if known else "it has none"
            raise BadInput(f"estimator {name!r} has no parameter {key!r}; {has}")
    missing = [key for key, one in (known or {}).items() if one.default is Parameter.empty and key not in given]
    if missing:
        raise BadInput(_needs_arguments(name, f"it needs {missing[0]}"))
    defaults = {key: one.default for key, one in (known or {}).items()}
    return {key: _convert_value(name, make, key, value, defaults.get(key)) for key, value in given.items()}


def _parameters(cls: type) -> dict[str, Parameter]:
    """Return the parameters of its `__init__`, which may be the class's own; with `**rest`, its fields too."""
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


def _convert_value(name: str, make: Any, key: str, value: Any, default: Any) -> Any:
    """A parameter's value, converted to the type of its annotation; where it has none, to what its default is."""
    try:
        kind: Any = type(unpacked(default))
        return _adapter(make, key, kind).validate_python(value)
    except ValidationError as e:
        first = e.errors()[0]
        where = (part for part in first["loc"] if part not in ("int", "float"))  # of a union: no key that was given
        raise BadInput(f"estimator {name!r}, {first_reason([{**first, 'loc': (key, *where)}])}") from None
    except (PydanticUserError, NameError):  # an annotation that pydantic does not know
        return value


@cache
def _adapter(make: Any, key: str, default: type) -> TypeAdapter[Any]:
    """Made once for each parameter: it takes milliseconds."""
    hints: dict[str, Any] = {}
    for annotated in (make, getattr(make, "__init__", None)):
        with suppress(NameError, TypeError):  # a dataclass's may repeat names of another module; a partial has none
            hints |= get_type_hints(annotated, include_extras=True)
    hint = hints.get(key, UNSAID.get(default, WORD))
    return TypeAdapter(hint.type if isinstance(hint, InitVar) else hint)


def _instantiate(name: str, cls: Any, given: dict[str, Any]) -> Any:
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

"""Make an estimator from its class and the parameters that a user wrote, each converted to its annotation."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from inspect import isfunction
from typing import Annotated, Any, get_type_hints

from pydantic import Field, TypeAdapter, ValidationError
from pydantic.errors import PydanticUserError

from cooploc.estimators.adapters import Adapter, PerRobot, PerTeam, unpack_default
from cooploc.estimators.adapters import parameters as taken_by
from cooploc.estimators.errors import BadInput, first_reason, message, nearest, one_line


def is_plain(found: Any) -> bool:
    """Return whether it is a class for one robot or one team, to be adapted."""
    has = {method: hasattr(found, method) for method in ("init", "predict", "correct")}
    return isinstance(found, type) and has["predict"] and has["correct"] and not has["init"]


def adapt(name: str, plain: Any) -> PerRobot | PerTeam:
    """Return a plain class as an estimator: of a team with `exchange`, else of a robot; BadInput where it is unfit."""
    adapter: type[PerRobot | PerTeam] = PerTeam if hasattr(plain, "exchange") else PerRobot
    if not hasattr(plain, "uses"):
        raise BadInput(
            f'{name} is a plain class and does not say what it reads: write uses = ("odometry", ...) in it, or name '
            f"what cl.{adapter.__name__}({plain.__name__}, uses=(...)) makes"
        )
    try:
        return adapter(plain)
    except TypeError as e:
        team = "; one that holds the whole team has exchange(z, radio), too" if "keys" in str(e) else ""
        raise BadInput(f"{name} cannot be wrapped by cl.{adapter.__name__}: {e}{team}") from None


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
    """Return an instance of the class `found`, what a function returns, or `found` itself where it is an instance.

    A plain class is adapted; what `PerRobot` or `PerTeam` made takes the parameters of the class inside. BadInput: an
    unknown parameter, a value that does not fit, or a class that cannot be instantiated.
    """
    found = adapt(name, found) if is_plain(found) else found
    if isinstance(found, type) and not any(hasattr(found, method) for method in ("init", "smooth")):
        lacking = " and no ".join(method for method in ("predict", "correct") if not hasattr(found, method))
        methods = "a filter of one robot has predict(z) and correct(z); of all at once init, predict, correct, send,"
        raise BadInput(f"{name} has no {lacking}: {methods} fuse, estimate; `cooploc new-estimator NAME` writes one")
    if isinstance(found, Adapter):
        return found.with_parameters(**_check_parameters(name, found.make, found.given, given)) if given else found
    if not (isfunction(found) or isinstance(found, type)):
        if given:
            raise BadInput(f"{name} is an instance and takes no parameters: name its class instead")
        return found
    checked = _check_parameters(name, found, (), given)
    try:
        return found(**checked)
    except MemoryError:  # of the machine, not of the class
        raise
    except ValueError as e:  # a parameter that does not fit
        raise BadInput(f"estimator {name!r}, {message(e)}") from e
    except (Exception, SystemExit, GeneratorExit) as e:  # a constructor may fail in any way
        raise BadInput(_needs_arguments(name, one_line(e))) from e


def _check_parameters(name: str, make: Any, always: tuple[str, ...], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the given parameters, converted; `make` is called with those named in `always`, too."""
    known = taken_by(make, always)  # None: it takes any name
    if known is not None:
        known.pop("uses", None)
        given = {key if key in known else RENAMED.get(key, key): value for key, value in given.items()}
        if unknown := [key for key in given if key not in known]:
            has = nearest(unknown[0], list(known)) if known else "it has none"
            raise BadInput(f"estimator {name!r} has no parameter {unknown[0]!r}; {has} (cooploc list {name})")
        if missing := [key for key, one in known.items() if one.default is one.empty and key not in given]:
            if missing[0] == "prior" and isfunction(make):
                raise BadInput(
                    f"{name} is a function that makes filters: name what cl.PerRobot({make.__name__}, uses=(...)) makes"
                )
            raise BadInput(_needs_arguments(name, f"it needs {missing[0]}"))
    kinds = {key: type(unpack_default(known[key].default)) if known else type(None) for key in given}
    return {key: _convert_value(name, make, key, value, kinds[key]) for key, value in given.items()}


def _convert_value(name: str, make: Any, key: str, value: Any, default: type) -> Any:
    """Return a parameter's value, converted to its annotation; where it has none, to the type of its default."""
    try:
        return _type_adapter(make, key, default).validate_python(value)
    except ValidationError as e:
        first = e.errors()[0]
        where = (part for part in first["loc"] if part not in ("int", "float"))  # of a union: no key that was given
        raise BadInput(f"estimator {name!r}, {first_reason([{**first, 'loc': (key, *where)}])}") from None
    except (PydanticUserError, NameError):  # an annotation that pydantic does not know
        return value


@cache
def _type_adapter(make: Any, key: str, default: type) -> TypeAdapter[Any]:
    """Return what converts a parameter; made once, as it takes milliseconds."""
    hints: dict[str, Any] = {}
    for annotated in (make, getattr(make, "__init__", None)):
        with suppress(NameError, TypeError):  # a dataclass's may repeat names of another module; a partial has none
            hints |= get_type_hints(annotated, include_extras=True)
    return TypeAdapter(hints.get(key, UNSAID.get(default, WORD)))


def _needs_arguments(name: str, why: str) -> str:
    return f"{name} cannot be made without arguments ({why}); give its parameters defaults, or name an instance"

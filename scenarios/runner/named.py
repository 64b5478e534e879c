"""What a user may hand to `cl.run` as estimators: names, classes, instances, lists of them, and mappings."""

from collections.abc import Iterable, Mapping
from typing import Any

from cooploc.estimators import is_builtin, make, split
from cooploc.estimators.lifting.lift import Lift
from cooploc.estimators.plugins.errors import BadInput, message
from cooploc.estimators.plugins.lifted import is_plain, lifted
from cooploc.scenarios.stream import Stream, Truth

ROBOT = ("init", "predict", "correct", "send", "fuse", "estimate")
TEAM = ("init", "predict", "correct", "exchange", "estimate")
OFFLINE = ("smooth",)
LIFT = "a filter written for one robot is lifted by cl.PerRobot, one for a whole team by cl.PerTeam"
ORDER = "write cl.run(estimators, stream)"


def named(estimators: Any, isolate: bool = False) -> dict[str, Any]:
    """Instances by name; with `isolate`, a name or class that is not built in stays one, for a process of its own.

    Args:
        estimators: a name, configured or not ("arl", "mrsl-rssi[particles=500]", "path.py:Name"), several of them
            separated by commas, a class that needs no arguments, an instance, a list of these, or a mapping of your own
            names to these.

    Raises:
        BadInput: one of them is not an estimator, or two have the same name.

    """
    if isinstance(estimators, Stream | Truth):
        raise BadInput(f"the first argument is a {type(estimators).__name__}, not estimators: {ORDER}")
    if isinstance(estimators, Mapping):
        return {str(name): estimator(one, f"{name!r}", isolate) for name, one in estimators.items()}
    found: dict[str, Any] = {}
    for one in _listed(estimators):
        name = label(one)
        if name in found:
            raise BadInput(f"two estimators are called {name!r}: give them names, {{{name!r}: ..., 'other': ...}}")
        found[name] = estimator(one, "one of the estimators", isolate)
    return found


def demand_stream(stream: Any) -> None:
    """Refuse what is not a stream.

    Raises:
        BadInput: it is the truth, or both, or something else.

    """
    if not isinstance(stream, Stream):
        raise BadInput(
            f"the second argument is a {type(stream).__name__}, not a Stream: write truth, stream = cl.simulate(...), "
            f"then cl.run(estimators, stream)"
        )


def label(estimator: Any) -> str:
    """What an estimator is called that was given without a name."""
    if isinstance(estimator, str):
        return estimator
    if isinstance(estimator, Lift):
        return estimator.label
    return estimator.__name__ if isinstance(estimator, type) else type(estimator).__name__


def instance(estimator: Any) -> Any:
    """An estimator of a name or of a class; an instance is returned as it is.

    Raises:
        BadInput: an unknown name, or a class that needs arguments.

    """
    if isinstance(estimator, str):
        return make(estimator)
    if not isinstance(estimator, type):
        return estimator
    name = estimator.__name__
    if is_plain(estimator):
        return lifted(name, estimator)
    try:
        return estimator()
    except (Exception, SystemExit, GeneratorExit) as e:  # a constructor may fail in any way
        remedy = f"pass an instance, {name}(...)" if hasattr(estimator, "init") else LIFT
        raise BadInput(f"{name} cannot be made without arguments ({message(e)}): {remedy}") from e


def _listed(estimators: Any) -> Iterable[Any]:
    if isinstance(estimators, str):
        return split(estimators)
    several = isinstance(estimators, Iterable) and not isinstance(estimators, type)
    several = several and not any(hasattr(estimators, method) for method in ("init", "smooth"))
    return estimators if several else [estimators]


def estimator(given: Any, where: str, isolate: bool = False) -> Any:
    """An instance that has an estimator's methods; with `isolate`, a name or class that is not built in stays one.

    Raises:
        BadInput: it is not an estimator.

    """
    if isolate and isinstance(given, str | type) and not is_builtin(given):
        return given
    made = instance(given)
    whole = OFFLINE if getattr(made, "offline", False) else TEAM if hasattr(made, "exchange") else ROBOT
    missing = [method for method in whole if not hasattr(made, method)]
    if missing == list(ROBOT):
        raise BadInput(
            f"{where} is of type {type(made).__name__}, not an estimator: give a name, a class or an instance"
        )
    if missing:
        lacking = ", ".join(f"{method}()" for method in missing)
        raise BadInput(f"estimator {type(made).__name__} lacks {lacking}: help(cl.Estimator) says what to do; {LIFT}")
    return made

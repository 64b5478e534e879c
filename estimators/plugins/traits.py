"""What an estimator says of itself beyond the methods that every estimator has; all of it is optional."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from cooploc.estimators.interface import API, Array
from cooploc.estimators.plugins.artifacts import plainly


class Traits(NamedTuple):
    """The optional members of an estimator, with their defaults filled in."""

    team: bool  # it holds the whole team: it has `exchange`, and neither `send` nor `fuse`; or it is offline
    centralised: bool  # `centralised`, `bound` or `offline`: every reading reaches one computer
    bound: bool  # `bound`: of the centralised ones, one that uses all readings as well as any estimator could
    mutable: bool  # `mutable`: its state changes in place
    axes: str  # `axes`: why its estimates do not turn with the world; empty where they do
    own_motion: str  # `own_motion`: why it does not move as dead reckoning does; empty where it does
    notes: Callable[[Any], Mapping[str, Array]]  # `notes(state)`: what it counted, by name; empty by default
    trained_on: str  # `trained_on`: what its artifacts were learned from; empty where it learned nothing
    offline: bool  # `offline`: it has `smooth`, and is given all readings of all ticks at once, as no robot could be


def traits(estimator: Any) -> Traits:
    """The optional members of an estimator."""
    bound = bool(getattr(estimator, "bound", False))
    offline = bool(getattr(estimator, "offline", False))
    return Traits(
        team=offline or hasattr(estimator, "exchange"),
        centralised=bound or offline or bool(getattr(estimator, "centralised", False)),
        bound=bound,
        mutable=bool(getattr(estimator, "mutable", False)),
        axes=getattr(estimator, "axes", ""),
        own_motion=getattr(estimator, "own_motion", ""),
        notes=getattr(estimator, "notes", _no_notes),
        trained_on=plainly(str(getattr(estimator, "trained_on", "") or "")),
        offline=offline,
    )


def refusal(estimator: Any) -> str:
    """Why an estimator does not fit this version of the interface; empty where it does."""
    uses = getattr(estimator, "uses", None)
    if reason := wrong_version(estimator):
        return reason
    if not (isinstance(uses, tuple) and all(isinstance(channel, str) for channel in uses)):
        return f"uses is {uses!r}; it must be a tuple of channel names, such as ('odometry', 'anchor_rssi')"
    return ""


def wrong_version(estimator: Any) -> str:
    """Why an estimator does not fit this version of the interface by its number alone; empty where it does."""
    api = getattr(estimator, "api", None)
    return "" if api == API else f"it is written for interface {api!r}, this is version {API}: set api = {API}"


def _no_notes(state: Any) -> Mapping[str, Array]:
    return {}

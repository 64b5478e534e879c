"""What the header of a stream's file must hold, and the shapes that its arrays must have."""

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, StrictInt, StrictStr, ValidationError

from cooploc.estimators.plugins.errors import first_reason
from cooploc.scenarios.sealed import Damaged

PLACES = ("arena", "anchors", "landmarks")  # what a world has as arrays
SHAPES = {  # t trials, T ticks, n robots, d of a state, 2; any number where there is a *
    "trial": ("i", "t"),
    "time": ("f", "T"),
    "arena": ("f", "2", "2"),
    "anchors": ("f", "*", "2"),
    "landmarks": ("f", "*", "2"),
    "prior.x": ("f", "t", "n", "d"),
    "prior.P": ("f", "t", "n", "d", "d"),
    "senses.odometry": ("f", "t", "T", "n", "*"),
    "senses.dt": ("f", "t", "T", "n"),
    "senses.anchor_rssi": ("f", "t", "T", "n", "*"),
    "senses.landmark": ("f", "t", "T", "n", "*", "2"),
    "senses.sighting": ("f", "t", "T", "n", "*", "2"),
    "air.link": ("b", "t", "T", "n", "n"),
    "air.rssi": ("f", "t", "T", "n", "*"),
    "air.range": ("f", "t", "T", "n", "*"),
}
EXTRA = "extra."  # channels of plug-in scenarios: (t, T, n, ...) of any numbers

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Model = dict[StrictStr, Any]


class StreamHeader(BaseModel):
    """The header of a stream's file."""

    model_config = ConfigDict(extra="forbid")

    format: StrictInt
    what: StrictStr = ""
    scenario: StrictStr
    seed: StrictInt
    robots: Annotated[int, Field(strict=True, ge=1)]
    tick: Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
    t0: Finite
    motion: Model
    sensors: dict[StrictStr, Model]
    notes: dict[StrictStr, Any]
    hashes: list[StrictStr]
    digests: dict[StrictStr, StrictStr] = {}  # of the arrays that `hashes` leave out


def demand_header(content: Mapping[str, Any]) -> None:
    """Refuse a header that lacks something or holds something else.

    Raises:
        Damaged: says what.

    """
    try:
        StreamHeader.model_validate(content)
    except ValidationError as e:
        raise Damaged(f"header, {first_reason(e.errors())}") from None


def demand_shapes(header: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Refuse arrays that do not belong together.

    Raises:
        Damaged: an array is missing, of another type, or of another shape than the others; names it.

    """
    sizes = {"n": header["robots"], "t": len(header["hashes"]), "2": 2}
    channels = [name for name in arrays if name.startswith(EXTRA)]
    for name, (kind, *axes) in SHAPES.items():
        if name not in arrays:
            raise Damaged(f"it has no array {name!r}")
        _demand_shape(name, arrays[name], kind, axes, sizes)
    for name in channels:
        _demand_shape(name, arrays[name], "fiub", ["t", "T", "n", *"*" * (arrays[name].ndim - 3)], sizes)
    unknown = set(arrays) - set(SHAPES) - set(channels)
    if unknown:
        raise Damaged(f"it has an unknown array {min(unknown)!r}")


def _demand_shape(name: str, array: Any, kinds: str, axes: list[str], sizes: dict[str, int]) -> None:
    """Compare a shape with the axes that are known; an axis that is not known yet is what this array says."""
    fits = array.ndim == len(axes) and all(
        axis == "*" or sizes.setdefault(axis, size) == size for axis, size in zip(axes, array.shape, strict=True)
    )
    if array.dtype.kind not in kinds or not fits:
        raise Damaged(f"its array {name!r} has the type {array.dtype} and the shape {np.shape(array)}")

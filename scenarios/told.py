"""Two options that the label of any scenario takes, besides the parameters of its world.

    trajectory[team_priors=true]         every robot is told the priors of all: the channel "team_prior"
    camera/n=3[short_ranges=refused]     no range below 0.2 m, nor a sighting with one, is in the stream

Both act on the stream, so they are the same for every estimator; a stream without them keeps its bits. The shipped
models refuse short ranges themselves, so estimates are the same where the stream refuses them first; the bytes that
a centralised estimator uploads are fewer.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from cooploc.estimators.interface import TEAM_PRIOR, Array
from cooploc.estimators.lifting.handed import without_short
from cooploc.scenarios.stream import Stream, Truth


class Told(BaseModel):
    """The two options and their defaults."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    team_priors: bool = False
    short_ranges: Literal["kept", "refused"] = "kept"

    def applied(self, truth: Truth, stream: Stream) -> tuple[Truth, Stream]:
        """Truth and stream with both options applied."""
        changed: dict[str, Array] = {}
        if self.short_ranges == "refused":
            changed |= _far(stream)
        if self.team_priors:
            changed[f"extra.{TEAM_PRIOR}"] = _priors(stream)
        if not changed:
            return truth, stream
        stream = stream.with_arrays(changed)
        return replace(truth, origin=stream.hashes), stream


def divided(parameters: Mapping[str, Any], own: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Divide options into those of a model, whose fields are `own`, and those of `Told`."""
    told = {key: value for key, value in parameters.items() if key in Told.model_fields and key not in own}
    return {key: value for key, value in parameters.items() if key not in told}, told


def _priors(stream: Stream) -> Array:
    """(t, T, n, n, d + d d): of each robot, in every tick, everyone's prior x and P; one copy for all ticks."""
    x, P = stream.prior
    flat = np.concatenate([x, P.reshape(*x.shape[:-1], -1)], -1)[:, None, None]
    shape = len(x), len(stream.time), stream.robots, *flat.shape[-2:]
    return np.broadcast_to(flat, shape)


def _far(stream: Stream) -> dict[str, Array]:
    arrays = stream.arrays()
    found = {f"senses.{name}": arrays[f"senses.{name}"] for name in ("landmark", "sighting")}
    found = {name: without_short(a, a[..., :1]) for name, a in found.items()}
    ranges = {name: arrays[name] for name in ("air.range", "extra.anchor_range") if name in arrays}
    return found | {name: without_short(a, a) for name, a in ranges.items()}

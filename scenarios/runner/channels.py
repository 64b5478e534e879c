"""What an estimator's `uses` selects of a stream. Everything else is hidden from it, so the declaration is enforced."""

from dataclasses import replace
from typing import Any

from cooploc.estimators.interface import TEAM_PRIOR
from cooploc.estimators.plugins.errors import BadInput
from cooploc.estimators.plugins.traits import wrong_version
from cooploc.scenarios.stream import Stream

WORDS = {
    "anchor_rssi": "RSSI",
    "anchor_range": "anchor ranges",
    "landmark": "landmarks",
    "sighting": "sightings",
    "radio_rssi": "team RSSI",
    "radio_range": "team ranges",
    TEAM_PRIOR: "team priors",
}
DERIVED = {"doa": "DOA", "doa-constant": "DOA", "gradient": "gradient"}  # by the parameter `anchor_reading`
SENSED = ("odometry", "anchor_rssi", "landmark", "sighting")


class IncompatibleEstimator(BadInput):
    """An estimator that cannot run on a stream, with the reason."""


def visible(name: str, estimator: Any, stream: Stream) -> Stream:
    """The stream with everything hidden that the estimator does not declare.

    Raises:
        IncompatibleEstimator: it declares a channel that the stream lacks, or another version of the interface.

    """
    if reason := wrong_version(estimator):
        raise IncompatibleEstimator(f"{name} cannot run: {reason}")
    used = selected(name, tuple(estimator.uses), stream)
    senses = stream.senses
    shown = senses._replace(
        **{c: getattr(senses, c) if c in used else getattr(senses, c)[:, :, :, :0] for c in SENSED},
        extra={c: a for c, a in senses.extra.items() if c in used},
    )
    air = stream.air
    air = air._replace(
        **{c: getattr(air, c) if f"radio_{c}" in used else getattr(air, c)[..., :0] for c in ("rssi", "range")}
    )
    sensors = {c: s for c, s in stream.world.sensors.items() if c in used}
    return replace(stream, senses=shown, air=air, world=replace(stream.world, sensors=sensors))


def senses(estimator: Any, stream: Stream) -> str:
    """What an estimator reads of a stream beside odometry, in a few words: "DOA, team ranges"."""
    used = selected("", tuple(estimator.uses), stream)
    own = DERIVED.get(str(getattr(estimator, "anchor_reading", "")), WORDS["anchor_rssi"])
    words = {**WORDS, "anchor_rssi": own} | {channel: channel for channel in sorted(used) if channel not in WORDS}
    found = [word for channel, word in words.items() if channel in used and channel != "odometry"]
    return ", ".join(found) or "odometry"


def selected(name: str, uses: tuple[str, ...], stream: Stream) -> set[str]:
    """The channels that a declaration selects: "a|b" the first that exists, "a?" if it exists.

    Raises:
        IncompatibleEstimator: the stream lacks one that is needed.

    """
    has, used = stream.channels(), set()
    for wish in uses:
        options = wish.rstrip("?").split("|")
        found = next((channel for channel in options if channel in has), None)
        if found is not None:
            used.add(found)
        elif not wish.endswith("?"):
            needed = " or ".join(repr(channel) for channel in options)
            there = ", ".join(sorted(has))
            raise IncompatibleEstimator(f"{name} needs channel {needed}; scenario {stream.scenario!r} has {there}")
    return used

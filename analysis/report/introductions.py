"""What a page says of each estimator: what it is, what it reads and knows, its source, and its parameters.

Only built-in classes are looked at: to write a report runs no code that a run names.
"""

from collections.abc import Iterable
from dataclasses import fields
from typing import Any, NamedTuple

import pandas as pd

from cooploc.analysis.metrics.errors import SENSES
from cooploc.estimators import configure, make
from cooploc.estimators.errors import BadInput
from cooploc.estimators.listing import standing
from cooploc.estimators.registry import source_of

READ = "estimator", "messages", "centralised", "bound", "offline", SENSES


class Configuration(NamedTuple):
    """One configuration of a method, as it ran."""

    label: str
    anchor: str
    given: str  # the parameters in which it differs from the defaults
    standing: str  # "as published", "at its best", or nothing


class Introduction(NamedTuple):
    """A method with the configurations of it that ran."""

    name: str
    about: str
    senses: str  # what it read beside odometry, in any scenario
    knows: str  # whose readings it has
    source: str
    defaults: list[tuple[str, str]]  # every parameter with its default
    configurations: list[Configuration]


def introductions(rows: pd.DataFrame, certificates: dict[str, Any]) -> list[Introduction]:
    """One per method, in the order in which they ran."""
    anchors = anchors_of(rows["estimator"].unique())
    rows = rows[[name for name in READ if name in rows]]  # a method's rows are copied
    methods: dict[str, list[str]] = {}
    for label in anchors:
        methods.setdefault(label.partition("[")[0], []).append(label)
    return [
        _method(name, labels, rows[rows["estimator"].isin(labels)], anchors, certificates)
        for name, labels in methods.items()
    ]


def anchors_of(estimators: Iterable[Any]) -> dict[str, str]:
    """Where each estimator is introduced."""
    return {str(label): f"estimator-{i}" for i, label in enumerate(estimators, 1)}


def _method(
    name: str, labels: list[str], rows: pd.DataFrame, anchors: dict[str, str], certificates: dict[str, Any]
) -> Introduction:
    made = _built_in(labels[0])
    cls = type(made)
    foreign = next((certificates[label]["found"] for label in labels if label in certificates), "")
    about = (cls.__doc__ or "").strip().partition("\n")[0] if made is not None else _foreign(foreign)
    senses: Iterable[Any] = rows[SENSES].dropna().unique() if SENSES in rows else ()
    return Introduction(
        name,
        about,
        " or ".join(map(str, filter(None, senses))) or _uses(made),
        _knows(rows),
        source_of(cls) if made is not None else "",
        _defaults(name) if made is not None else [],
        [Configuration(label, anchors[label], _given(label), standing(label)) for label in labels],
    )


def _uses(made: Any) -> str:
    """The channels that it declares, for runs of former versions, which did not note what was read."""
    return "" if made is None else ", ".join(made.uses).replace("|", " or ").replace("_", " ")


def _foreign(found: str) -> str:
    return f"Not built in. Its checks: {found}." if found else "Not built in."


def _built_in(label: str) -> Any:
    """The estimator of a label, or None where it is not built in or no longer known."""
    try:
        return make(label) if configure(label).builtin else None
    except BadInput:
        return None


def _knows(rows: pd.DataFrame) -> str:
    """Which readings reach it, of a robot that runs it."""
    if "offline" in rows and rows["offline"].eq(True).any():
        return "every reading of every robot, of later ticks too: a bound that no robot could run"
    if rows["bound"].eq(True).any():
        return "every reading of every robot: a bound on all others"
    if rows["centralised"].eq(True).any():
        return "every reading of every robot, on one computer"
    return (
        "its own readings, and nothing of teammates"
        if not rows["messages"].gt(0).any()
        else ("its own readings, and what teammates send")
    )


def _defaults(name: str) -> list[tuple[str, str]]:
    made = _built_in(name)
    if made is None:
        return []
    return [(one.name, _plain(getattr(made, one.name))) for one in fields(made) if one.init and one.name != "uses"]


def _given(label: str) -> str:
    return label.partition("[")[2].removesuffix("]").replace(",", ", ")


def _plain(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}".replace("inf", "∞")
    return str(value)

"""Which table of log.toml the columns of a file belong to."""

from typing import NamedTuple

from cooploc.scenarios.recordings.inspect.csv_look import CsvLook
from cooploc.scenarios.recordings.inspect.guesses import Guess
from cooploc.scenarios.recordings.inspect.names import ANCHORS, LANDMARKS, words_of

ODOMETRY = {  # kind -> its quantities; the first kind that a file has all of
    "velocity": ("speed", "turn_rate"),
    "path": ("length", "turn_rate"),
    "displacement": ("dx", "dy"),
    "pose": ("x", "y", "heading"),
}
SIDES = ("", "truth", "odometry")


class Part(NamedTuple):
    """Columns of one file that belong to one table."""

    look: CsvLook
    table: str  # "odometry", "truth", "ranges", "rssi", "sightings", "anchors" or "landmarks"
    kind: str  # of odometry; else ""
    columns: dict[str, Guess]  # quantity -> column; with time, robot and other where the file has them
    each: tuple[Guess, ...] = ()  # a column for each thing that is measured


def parts_of(look: CsvLook, found: tuple[Guess, ...]) -> list[Part]:
    """The tables that a file's columns belong to; a file without stamps can only hold places."""
    shared = {g.quantity: g for g in reversed(found) if g.quantity in ("time", "sec", "nsec", "robot", "other")}
    if "time" in shared and "sec" in shared:
        del shared["sec"]
        shared.pop("nsec", None)
    if not shared.keys() & {"time", "sec"}:
        return _places(look, found)
    wheels = _odometry(look, found, shared)
    used = {g.column for part in wheels for g in part.columns.values()} - {g.column for g in shared.values()}
    left = tuple(g for g in found if g.column not in used)
    return [*wheels, *_truth(look, left, shared), *_readings(look, left, shared)]


def _odometry(look: CsvLook, found: tuple[Guess, ...], shared: dict[str, Guess]) -> list[Part]:
    """Odometry: the first kind of which every quantity is there, on the side of odometry or on no side."""
    for kind, needed in ODOMETRY.items():
        own = _first(found, "odometry" if kind == "pose" else "not truth")
        if all(quantity in own for quantity in needed):
            return [Part(look, "odometry", kind, shared | {q: own[q] for q in needed})]
    return []


def _truth(look: CsvLook, found: tuple[Guess, ...], shared: dict[str, Guess]) -> list[Part]:
    named = any(g.side == "truth" and g.quantity == "x" for g in found)
    own = _first(found, "truth" if named else "none")
    if "x" not in own or "y" not in own:
        return []
    return [Part(look, "truth", "", shared | {q: own[q] for q in ("x", "y", "heading") if q in own})]


def _readings(look: CsvLook, found: tuple[Guess, ...], shared: dict[str, Guess]) -> list[Part]:
    """Ranges, bearings and signal strength; several columns of one quantity are one for each thing measured."""
    parts = []
    of = {q: [g for g in found if g.quantity == q] for q in ("range", "bearing", "rssi")}
    own = _first(found, "any")
    if of["bearing"] and of["range"]:
        parts.append(Part(look, "sightings", "", shared | {q: own[q] for q in ("range", "bearing")}))
    for quantity, table in (("range", "ranges"), ("rssi", "rssi")):
        if len(of[quantity]) > 1:
            alone = {q: g for q, g in shared.items() if q != "other"}
            parts.append(Part(look, table, "", alone, tuple(of[quantity])))
        elif of[quantity] and not (quantity == "range" and of["bearing"]):
            parts.append(Part(look, table, "", shared | {quantity: own[quantity]}))
    return parts


def _places(look: CsvLook, found: tuple[Guess, ...]) -> list[Part]:
    """A file of names and places; anchors, where its name does not speak of landmarks."""
    own = _first(found, "any")
    label = own.get("robot") or own.get("other") or next((g for g in found if g.column not in ("x", "y")), None)
    if "x" not in own or "y" not in own or label is None:
        return []
    words = {*words_of(look.path.stem), *words_of(label.column)}
    table = "landmarks" if words & set(LANDMARKS) and not words & set(ANCHORS) else "anchors"
    return [Part(look, table, "", {"name": label, "x": own["x"], "y": own["y"]})]


def _first(found: tuple[Guess, ...], side: str) -> dict[str, Guess]:
    """The first column of each quantity: on one side, on no side ("none"), on any, or on any but truth's."""
    sides = {"any": SIDES, "none": ("",), "not truth": ("", "odometry"), "odometry": ("odometry",), "truth": ("truth",)}
    return {g.quantity: g for g in reversed(found) if g.quantity and g.side in sides[side]}

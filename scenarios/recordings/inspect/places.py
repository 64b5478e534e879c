"""Where anchors and landmarks are: files of places, and places beside measurements."""

from collections.abc import Sequence
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from cooploc.scenarios.recordings.inspect import naming
from cooploc.scenarios.recordings.inspect.columns import CsvTable, infer_columns
from cooploc.scenarios.recordings.text_files import is_text


def kind_of_places(path: Path) -> str:
    """Return "anchors" or "landmarks" of a file of YAML, JSON or XML that holds them by its name; else ""."""
    words = naming.words_of(path.stem) if path.suffix.lower() in (".yaml", ".yml", ".json", ".xml") else []
    return next((kind for kind in map(naming.OTHERS.get, words) if kind in ("anchors", "landmarks")), "") or ""


def read_places(path: Path, name: str) -> CsvTable | None:
    """Read places in YAML or JSON: names with [x, y] or with x and y, or a list with name or id, x and y; else None."""

    def below_title(content: Any) -> Any:
        only = next(iter(content.values())) if isinstance(content, dict) and len(content) == 1 else None
        if isinstance(only, dict):
            return content if {"x", "position"} & only.keys() else below_title(only)
        return only if isinstance(only, list) and isinstance(only[0], dict) else content

    try:
        content, found = below_title(YAML(typ="safe").load(path)), dict[str, list[float]]()  # JSON is YAML, too
        named = content.items() if isinstance(content, dict) else ((p.get("name") or p["id"], p) for p in content)
        for key, one in named:
            at = one.get("position", one) if isinstance(one, dict) else one
            if str(key) in found:
                raise ValueError  # of several lines about one, as a log has them
            found[str(key)] = [float(at[q]) for q in ("xy" if isinstance(at, dict) else (0, 1))]
        x, y = np.array([*found.values()]).T
    except Exception:  # whatever YAML raises on what is none
        return None
    table = CsvTable(name, {"name": (*found,), "x": x, "y": y})
    return table._replace(guesses=infer_columns(table)) if np.isfinite([x, y]).all() else None


def is_table(path: Path) -> bool:
    """Return whether a file may hold a table by its name: a text, or places."""
    return is_text(path) or bool(kind_of_places(path))


def split_places(files: Sequence[CsvTable]) -> tuple[list[CsvTable], list[CsvTable]]:
    """Return the files without the places that stand beside each reading, and a table of these places, if any.

    They are in columns such as anchor_x and anchor_y: the same for one name in every line, and not for all names.
    """
    kept, found = list[CsvTable](), list[CsvTable]()
    for file in files:
        names = [g for g in file.guesses if g.quantity == "other"]
        names += [g for g in file.guesses if g.quantity == "robot" and naming.is_anchor(g.column)]
        other = names[0].column if names else ""
        named = file.words(other) if other else ()
        for x in [c for c in file.columns if named and "x" in naming.words_of(c)]:
            y = "y".join(x.rsplit("x", 1))
            at = [v for c in (x, y) if not isinstance(v := file.columns.get(c, ()), tuple)]
            if len(at) < 2:
                continue
            there = np.isfinite(at).min(axis=0) & [name != "" for name in named]
            lines = sorted({*compress(zip(named, *at, strict=True), there)})
            places = {name: place for name, *place in lines}
            if len(places) != len(lines) or 2 * len(lines) > len(named) or len({*map(tuple, places.values())}) < 2:
                continue
            at_x, at_y = np.array([*places.values()]).T
            found.append(CsvTable(file.name, {other: (*places,), x: at_x, y: at_y}, units=file.units))
            left = {c: values for c, values in file.columns.items() if c not in (x, y)}
            file = file._replace(columns=left, guesses=tuple(g for g in file.guesses if g.column in left))
        kept.append(file)
    return kept, [table._replace(guesses=infer_columns(table)) for table in found[:1]]

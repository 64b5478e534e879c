"""A log.toml as text, each line with a comment that says where its value comes from and how sure that is."""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

MOST = 100  # characters in a line before its comment moves above it


class Entry(NamedTuple):
    """One line: a key, its value, and where the value comes from."""

    key: str
    value: Any
    why: str
    sure: str = "sure"  # or "likely", "perhaps"


class Table(NamedTuple):
    """A table; several may have the same name."""

    name: str
    entries: tuple[Entry, ...]
    remarks: tuple[str, ...] = ()  # comments above its lines
    repeated: bool = False  # one of several tables of this name


def written(head: tuple[str, ...], top: tuple[Entry, ...], tables: tuple[Table, ...]) -> str:
    """The whole file: comments at its head, its keys outside of tables, its tables."""
    blocks = ["\n".join(f"# {line}" for line in head), "\n".join(_line(entry) for entry in top)]
    for table in tables:
        name = f"[[{table.name}]]" if table.repeated else f"[{table.name}]"
        remarks = [f"# {remark}" for remark in table.remarks]
        blocks.append("\n".join([name, *remarks, *(_line(entry) for entry in table.entries)]))
    return "\n\n".join(blocks) + "\n"


def toml(value: Any) -> str:
    """A value as TOML: text, a number, a list, or an inline table."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return json.dumps(value)


def _key(key: str) -> str:
    plain = key and all(c.isascii() and (c.isalnum() or c in "_-") for c in key)
    return key if plain else toml(key)


def _line(entry: Entry) -> str:
    line = f"{_key(entry.key)} = {toml(entry.value)}"
    comment = f"# {entry.sure}: {one_line(entry.why)}"
    return f"{line}  {comment}" if len(line) + len(comment) <= MOST else f"{comment}\n{line}"


def one_line(text: str) -> str:
    """Text without line ends or other control characters, which would end a comment."""
    return "".join(c if c.isprintable() else " " for c in text)

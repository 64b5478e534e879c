"""What is wrong with a description in TOML: the line, the key and the remedy, in one line."""

import re
import tomllib
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput

Root = TypeVar("Root", bound=BaseModel)


def parse(path: Any, text: str, root: type[Root], tables: Mapping[str, type[BaseModel]], example: str) -> Root:
    """A description from the text of a file at `path`; `tables` are the models of its tables.

    Raises:
        BadInput: it is not TOML, or a key or value is wrong; names the line and the key.

    """
    try:
        return root.model_validate(tomllib.loads(text))
    except ValidationError as e:
        raise BadInput(f"{path}{_explained(text, e, root, tables, example)}") from None
    except (tomllib.TOMLDecodeError, RecursionError) as e:
        raise BadInput(f"{path}: cannot be read as TOML ({e}); correct it") from None


def _explained(
    text: str, e: ValidationError, root: type[BaseModel], tables: Mapping[str, type[BaseModel]], example: str
) -> str:
    """Line, key and remedy of an error; an unknown key comes first, as it explains one that is missing."""
    first = min(e.errors(), key=lambda error: error["type"] != "extra_forbidden")
    path = [str(part) for part in first["loc"] if str(part).isidentifier() or isinstance(part, int)]
    table, key = path[:2] if len(path) > 1 and path[0] in tables else ["", *path, ""][:2]
    if key.isdigit() and len(path) > 2 and table in tables:  # one of several tables of a name
        path = [table, *path[2:]]
        key = path[1]
    line = _line(text, table, key)
    if first["type"] == "extra_forbidden":
        known = list((tables[table] if table else root).model_fields)
        return f"{line}: there is no key {key!r}{f' in [{table}]' if table else ''}; {nearest(key, known)}"
    hint = f"; {example}" if first["type"] == "missing" else ""
    return f"{line}: {'.'.join(path)}{': ' if path else ''}{first['msg'].removeprefix('Value error, ')}{hint}"


def _line(text: str, table: str, key: str) -> str:
    """ ", line N" of a key's first appearance in a table of the file; of the table's own where key is not in it."""
    found, inside = "", not table
    for i, line in enumerate(text.splitlines(), 1):
        if header := re.match(r"\s*\[+\s*([\w.]+)", line):
            inside = header[1] == (table or key)
            if inside:
                found = f", line {i}"
        elif inside and re.match(rf"\s*[\"']?{re.escape(key)}[\"']?\s*=", line):
            return f", line {i}"
    return found

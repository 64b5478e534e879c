"""The BibTeX entries of the estimators and recordings that a run used, from `sources.toml`."""

import tomllib
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from typing import Any

from cooploc.estimators import BUILTIN

NOT_FIELDS = ("type", "estimators", "scenarios")


@cache
def sources() -> dict[str, dict[str, Any]]:
    """Every source by its key: its type, its fields, and the estimators or families of scenarios that rest on it."""
    return tomllib.loads((files(__package__) / "sources.toml").read_text("utf-8"))


def keys(estimator: str) -> list[str]:
    """The keys of what an estimator rests on, its own paper first; none of one that is not built in."""
    method = estimator.partition("[")[0]
    return [key for key, source in sources().items() if method in source.get("estimators", ())]


def bibtex(estimators: Iterable[str], scenarios: Iterable[str] = ()) -> str:
    """The entries of these estimators and scenarios, and of cooploc, as a .bib file."""
    names = list(dict.fromkeys(name.partition("[")[0] for name in estimators))
    families = {label.partition("/")[0].partition("[")[0] for label in scenarios}
    used = {key for name in names for key in keys(name)}
    used |= {key for key, source in sources().items() if families & set(source.get("scenarios", ()))}
    entries = [_entry(key, source) for key, source in sources().items() if key in used or key == "cooploc"]
    missing = [f"% {' '.join(name.split())} is not built in: add its source\n" for name in names if name not in BUILTIN]
    return "\n".join([*entries, *missing])


def _entry(key: str, source: dict[str, Any]) -> str:
    fields = {name: value for name, value in source.items() if name not in NOT_FIELDS}
    if key == "cooploc":
        fields["note"] = f"Version {version('cooploc')}"
    lines = [f"  {name} = {{{value}}}," for name, value in fields.items()]
    return "\n".join([f"@{source['type']}{{{key},", *lines, "}"]) + "\n"

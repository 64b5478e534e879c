"""What is printed of names: lists of what there is, and what one name stands for, with its parameters."""

import inspect
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from importlib.resources import files
from textwrap import fill
from typing import Any

import pandas as pd

from cooploc import estimators, scenarios
from cooploc.analysis.formats import duration
from cooploc.analysis.report.result_tables import parameter_table, parameter_text
from cooploc.analysis.report.tables import frame
from cooploc.estimators.label_syntax import parse
from cooploc.estimators.plugin_files import is_file
from cooploc.estimators.registry import source_of
from cooploc.scenarios.scenario import split_family
from cooploc.scenarios.studies import study as studies
from cooploc.terminal.console import make_console

NOTES = (
    '  uses: of "a or b" the first that a scenario has; a? is used where it is there\n'
    "  with hindsight, from Python alone: cl.Smoother(), offline: neither ranked nor best"
)
NAMED = {"published": "to its letter", "best": "at its best"}
ROLES = {"offline": "offline: neither ranked nor best", "bound": "a bound", "centralised": "centralised"}


def show_list(kind: str, listed: pd.DataFrame) -> None:
    """Print the table of `cl.list_estimators()`, or of another kind, then plug-ins that cannot be used."""
    broken = listed["problem"] != "" if "problem" in listed else pd.Series(False, listed.index)
    rows, console = [], make_console()
    for row in listed[~broken].to_dict("records"):
        shown: dict[Any, Any] = {"name": row.get("labels", row["name"])}
        if kind == "studies":
            shown["takes"] = duration(60 * row["minutes"]) if row["minutes"] > 0 else ""
        notes = [f"({text})" for key, text in ROLES.items() if row.get(key)][:1]
        other = {word: row[key] for key, word in NAMED.items() if row.get(key, row["name"]) != row["name"]}
        notes += [f"{word}: {label.replace(',', ', ')}." for word, label in other.items()]  # it breaks at spaces
        shown["what it is"] = " ".join([row["about"], *notes])
        shown |= {key: row[key] for key in ("trials", "seed") if key in row}
        shown |= {"uses": row["uses"].replace("|", " or ")} if "uses" in row else {}
        if "streams" in row:
            hashes = {name: [one] if isinstance(one, str) else one for name, one in row["streams"].items()}
            shown["streams"] = ", ".join(f"{name} {' or '.join(some)}" for name, some in hashes.items())
        rows.append(shown)
    console.print(frame(kind, pd.DataFrame(rows)).terminal())
    for row in listed[broken].to_dict("records"):
        console.print(f"  {row['name']}: not usable, {row['problem']}")
    console.print(f"{NOTES}\n" if kind == "estimators" else "")


def show_name(name: str) -> bool:
    """Print what a name stands for, and return whether anything is called so.

    Of an estimator or a scenario it is what its parameters mean, of a study its file, of a problem its row.
    """
    console, own, problems, found = make_console(), parse(name)[0], studies.list_problems(), list[Any]()
    family = split_family(own)[0]
    has_world = is_file(family) and isinstance(scenarios.REGISTRY.find(family), scenarios.Family)
    if own in estimators.names() or (is_file(own) and not has_world):
        found += [_wrap(text, console.width) for text in about_estimator(name)]
    if has_world or family in scenarios.names():
        found += about_scenario(name)
    if name in studies.names():
        content = (files(studies.__package__) / f"{name}.toml").read_text(encoding="utf-8")
        found += [f"study {name}, a file like this:\n", content]
    for one in found:
        console.print(one)
    if is_problem := name in set(problems["name"]):
        show_list("problem", problems[problems["name"] == name])
    return is_problem or bool(found)


def all_names() -> list[str]:
    """Return every name that can be explained."""
    return [*estimators.names(), *scenarios.names(), *studies.names(), *studies.problem_tables()]


def about_estimator(label: str) -> Iterator[str]:
    """Yield what an estimator is, what its parameters mean, and which values they have."""
    made = estimators.make(label)
    names = [f.name for f in fields(made) if f.name != "uses"] if is_dataclass(made) else []
    values = {name: getattr(made, name) for name in names}
    written = (f"{key}={str(value).lower() if isinstance(value, bool) else value}" for key, value in values.items())
    about = (inspect.getdoc(type(made)) or "").replace("\nArgs:\n", "\nParameters:\n").replace("\n\n\n", "\n\n")
    one_line_each = re.sub(r"\n {8,}", " ", about.rstrip())
    yield f"estimator {label}: {one_line_each}\n"
    yield f"values: {', '.join(written) or 'it has no parameters'}"
    yield f"uses: {', '.join(made.uses).replace('|', ' or ')}"
    yield f"source: {source_of(type(made)) or 'not said'}\n"


def _wrap(text: str, width: int) -> str:
    """Return a text in lines of that width, of which those of a parameter are indented."""
    lines = ((line, " " * 8 * line.startswith(" ")) for line in text.split("\n"))
    return "\n".join(fill(line, width, subsequent_indent=more, break_on_hyphens=False) for line, more in lines)


def about_scenario(label: str) -> Iterator[Any]:
    """Yield what a scenario is, and its parameters with their values, units and meanings."""
    name = split_family(parse(label)[0])[0]
    known = scenarios.family(name)
    model = known.model_class(name)
    yield f"scenario {label}: {known.about}\n"
    yield f"labels: {scenarios.labels_of(name, known)}"
    yield f"source: {source_of(model) or 'not said'}"
    if known.recorded:  # which is not read here
        settings = {key: one.default for key, one in model.model_fields.items() if not one.is_required()}
    else:
        settings = scenarios.resolve(label).settings
    yield parameter_table({key: parameter_text(value) for key, value in settings.items()}, "parameters").terminal()
    yield ""

"""What log.toml would say of a recording that nobody has described, format by format."""

from pathlib import Path
from typing import NamedTuple

from cooploc.scenarios.recordings.inspect.bag_draft import bag_draft
from cooploc.scenarios.recordings.inspect.csv_draft import csv_draft, run_folder
from cooploc.scenarios.recordings.inspect.csv_folder import relative
from cooploc.scenarios.recordings.inspect.guesses import Guess
from cooploc.scenarios.recordings.inspect.one_robot import Files
from cooploc.scenarios.recordings.inspect.recognized import Recognized
from cooploc.scenarios.recordings.inspect.toml_text import Entry, Table


class Draft(NamedTuple):
    """What is thought of a recording before its numbers are read."""

    entries: tuple[Entry, ...]  # outside of tables
    tables: tuple[Table, ...]
    columns: tuple[tuple[str, str, str, str], ...]  # file or topic, column, what it probably is, why
    unused: tuple[str, ...]  # what went nowhere, and why


def draft_of(path: Path, found: Recognized) -> Draft:
    """The draft for a path of a known format.

    Raises:
        BadInput: nothing in it can be used; one line.

    """
    if found.format == "csv":
        folder = run_folder(path)
        drafted = csv_draft(folder, path)
        return Draft(drafted.entries, drafted.tables, columns_of(folder, drafted.files), drafted.unused)
    if found.format == "bag":
        return Draft(*bag_draft(path))
    return Draft((Entry("format", found.format, found.why),), (), (), ())


def columns_of(folder: Path, files: Files) -> tuple[tuple[str, str, str, str], ...]:
    """A row for each column: file, column, what it probably is, why."""
    return tuple(
        (relative(look.path, folder), g.column, _quantity(g), g.reason) for look, found in files for g in found
    )


def _quantity(guess: Guess) -> str:
    unit = f" [{guess.unit}]" if guess.unit else ""
    return f"{guess.quantity or 'not known'}{unit}"

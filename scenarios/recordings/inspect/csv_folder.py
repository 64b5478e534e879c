"""The CSV files of a directory, and which of its directories are runs."""

from collections import Counter
from pathlib import Path
from typing import NamedTuple

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.inspect.csv_look import ENDINGS, CsvLook, look_at_csv
from cooploc.scenarios.recordings.inspect.guesses import Guess, guesses


class CsvFolder(NamedTuple):
    """The text files of a directory."""

    files: tuple[tuple[CsvLook, tuple[Guess, ...]], ...]  # with a guess for each column
    unread: tuple[str, ...]  # texts that are no tables


def csv_files(folder: Path, shared: Path | None = None) -> CsvFolder:
    """Every CSV file of a directory, looked at; a .txt that is no table is somebody's notes.

    Those in `shared` itself, such as the places of anchors, are of all runs.

    Raises:
        BadInput: there is none, or one cannot be read.

    """
    paths = text_files(folder)
    if shared is not None and shared != folder:
        paths += [path for path in text_files(shared) if path.parent == shared]
    looks, unread = [], []
    for path in paths:
        try:
            looks.append(look_at_csv(path))
        except BadInput:
            if path.suffix.lower() != ".txt":
                raise
            unread.append(f"{relative(path, folder)}: a text, and no table")
    if not looks:
        raise BadInput(f"{folder}: there is no CSV file, bag, PyFG file or MRCLAM text in it; name another directory")
    delimiters = Counter(look.delimiter for look in looks)
    if strange := next((look for look in looks if look.delimiter != delimiters.most_common(1)[0][0]), None):
        raise BadInput(
            f"{strange.path}, line 1: {strange.delimiter!r} between the names, and "
            f"{delimiters.most_common(1)[0][0]!r} in most files; save it as the others"
        )
    return CsvFolder(tuple((look, guesses(look)) for look in looks), tuple(unread))


def text_files(folder: Path) -> list[Path]:
    """Every file of a directory, and of those in it, that may be a table."""
    return sorted(p for p in folder.rglob("*") if p.is_file() and p.suffix.lower() in ENDINGS)


def has_stamps(path: Path) -> bool:
    """Whether a file is a table with a column of stamps, and so of a run; one without may be of all runs."""
    try:
        return any(guess.quantity in ("time", "sec") for guess in guesses(look_at_csv(path)))
    except BadInput:
        return False


def relative(path: Path, folder: Path) -> str:
    """The name of a file in log.toml: from the run's directory, or from the one above for what all runs share."""
    home = folder if path.is_relative_to(folder) else folder.parent
    return path.relative_to(home).as_posix()

"""Which format a path holds, by the names of its files."""

from pathlib import Path
from typing import NamedTuple

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.inspect.csv_look import ENDINGS

BAGS = (".db3", ".mcap", ".bag")


class Recognized(NamedTuple):
    """A format and the reason."""

    format: str  # as in log.toml
    why: str


def recognized(path: Path) -> Recognized:
    """The format of a recording that nobody has described.

    Raises:
        BadInput: there is nothing at the path, or nothing that is known.

    """
    if not path.exists():
        raise BadInput(f"{path}: there is no such file or directory; name one with a recording")
    if path.is_file() and path.suffix.lower() in ENDINGS:
        raise BadInput(f"{path}: this is one file; name the directory with the files of all robots, odometry and truth")
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    if bag := next((p for p in files if p.suffix.lower() in BAGS), None):
        return Recognized("bag", f"{bag.name} is a bag")
    if graph := next((p for p in files if p.suffix.lower() in (".pyfg", ".fg")), None):
        return Recognized("pyfg", f"{graph.name} is a factor graph")
    if any(p.name == "Barcodes.dat" for p in files):
        return Recognized("mrclam", "Barcodes.dat is of MRCLAM")
    if any(p.suffix.lower() in ENDINGS for p in files):
        return Recognized("csv", "text files with columns")
    raise BadInput(f"{path}: there is no CSV file, bag, PyFG file or MRCLAM text in it; name another directory")

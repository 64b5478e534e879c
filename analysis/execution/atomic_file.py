"""Files that are whole or not there: written under a temporary name, flushed to the disk, renamed."""

import os
from collections.abc import Callable
from pathlib import Path


def replace(path: Path, write: Callable[[Path], object]) -> None:
    """Write under a temporary name, flush to the disk, rename.

    Raises:
        OSError: it cannot be done; with the file's name, which not every library gives.

    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        write(temporary)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as e:
        raise OSError(e.errno, e.strerror or str(e), str(path)) from e
    finally:
        temporary.unlink(missing_ok=True)


def remove_temporary(folder: Path) -> None:
    """Remove what a process that was killed left half written."""
    for left in folder.glob(".*.tmp"):
        left.unlink()

"""Links from a report to the files that it rests on: those of the run, and those beside the page."""

import os
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote


class FileLink(NamedTuple):
    """A file, and its address from the page; empty where the page lies elsewhere and only the name can be given."""

    name: str
    address: str


class Folder(NamedTuple):
    """Files of one kind."""

    about: str
    files: list[FileLink]


ABOUT = {
    "": "The run: what was asked and what the results depend on",
    "parts": "Every trial's numbers (parquet), a file for some trials of an estimator in a scenario",
    "receipts": "A checksum for each of them",
}


def run_files(run: Path, out: Path) -> list[Folder]:
    """The files of a run's directory, by folder."""
    way = _way(run, out)
    found = []
    for folder, about in ABOUT.items():
        place = run / folder if folder else run
        names = sorted(p.name for p in place.iterdir() if p.is_file() and p.name[0] != ".") if place.is_dir() else []
        where = [f"{folder}/{name}" if folder else name for name in names]
        links = [FileLink(name, f"{way}/{quote(name)}" if way else "") for name in where]
        found += [Folder(about, links)] if links else []
    return found


def own_files(out: Path, *folders: str) -> list[Folder]:
    """The files beside the page."""
    about = {"tables": "Tables for LaTeX, Markdown and programs", "trials": "RMSE of every trial, by scenario"}
    return [Folder(about[folder], [_beside(folder, p.name) for p in _sorted(out / folder)]) for folder in folders]


def _beside(folder: str, name: str) -> FileLink:
    return FileLink(f"{folder}/{name}", f"{folder}/{quote(name)}")


def _sorted(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.is_file())


def _way(run: Path, out: Path) -> str:
    """From the page to the run, where both are in one tree: the page in the run, or both in the working directory.

    Anything else would write the names of directories of this machine into the page.
    """
    run, out, here = run.resolve(), out.resolve(), Path.cwd().resolve()
    together = out.is_relative_to(run) or (run.is_relative_to(here) and out.is_relative_to(here))
    return quote(Path(os.path.relpath(run, out)).as_posix()) if together else ""

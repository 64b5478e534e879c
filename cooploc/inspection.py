"""`cl.inspect(path)`: look at a recording before anything is fitted, sketch it, and write a log.toml to start from."""

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from cooploc.analysis.execution import run_directory
from cooploc.analysis.report.section_pages import inspection_page
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.inspect.draft_toml import toml
from cooploc.scenarios.recordings.inspect.inspection import Inspected, SeriesRow, inspect_recording
from cooploc.scenarios.recordings.schema import NAME

SKETCH, SANITY = "inspect.png", "inspect.html"


@dataclass(frozen=True, eq=False, repr=False)
class Inspection:
    """The result of an inspection: tables, a sketch, and a log.toml."""

    inspected: Inspected

    @property
    def series(self) -> pd.DataFrame:
        """A row for each series: samples, rate [Hz], first and last stamp [s], gaps, longest interval [s], source."""
        return pd.DataFrame(self.inspected.rows, columns=SeriesRow._fields).drop(columns="time")

    @property
    def findings(self) -> pd.DataFrame:
        """A row for each finding: kind, robot, source, fact, how sure, and the setting of log.toml to change."""
        names = ["kind", "robot", "source", "fact", "sure", "change"]
        return pd.DataFrame([[getattr(f, name) for name in names] for f in self.inspected.findings], columns=names)

    @property
    def columns(self) -> pd.DataFrame:
        """A row for each column or topic: what it probably is, and why; empty where log.toml says so."""
        return pd.DataFrame(self.inspected.columns, columns=["file", "column", "probably", "why"])

    @property
    def log_toml(self) -> str:
        """The text of log.toml: the one that is there, or a draft with a comment on each line."""
        return self.inspected.text

    def __repr__(self) -> str:
        found = self.inspected
        robots, findings = len(found.log.robots), len(found.findings)
        return f"Inspection({str(found.path)!r}, {found.format}, {robots} robots, {findings} findings)"

    def _repr_html_(self) -> str:
        shown = self.findings if len(self.findings) else self.series.round(3)
        return str(shown.to_html(index=False))

    def sketch(self, path: str | Path | None = None) -> Figure:
        """Draw tracks, who measured whom, and what was recorded when; a path gets a PNG.

        The figure is closed for pyplot: as the last line of a notebook's cell it is shown, and only once.
        """
        from matplotlib import pyplot

        from cooploc.analysis.plot.worlds import recording

        found = self.inspected
        note = " (drawn with the findings corrected)" if found.findings else ""
        figure = recording(found.corrected, found.log.name + note)
        if path is not None:
            run_directory.replace_file(Path(path), lambda temporary: figure.savefig(temporary, format="png", dpi=120))
        pyplot.close(figure)
        return figure

    def write(self, folder: str | Path | None = None, force: bool = False) -> list[Path]:
        """Write log.toml, the sketch and a page beside the recording, or into a directory; returns what was written.

        Elsewhere, log.toml says where the recording is. A log.toml that is there stays as it is, unless `force`.

        Raises:
            BadInput: the directory cannot be written to.

        """
        found = self.inspected.path
        beside = found if found.is_dir() else found.parent
        home = Path(folder) if folder is not None else beside
        target, written, text = home / NAME, [], self.log_toml
        if home.resolve() != beside.resolve() and "recordings" not in tomllib.loads(text):
            text = re.sub(r"^(?!#|\s*$)", f"recordings = {toml(str(beside.resolve()))}\n", text, count=1, flags=re.M)
        try:
            home.mkdir(parents=True, exist_ok=True)
            if force or not target.exists():
                run_directory.replace_file(target, lambda temporary: temporary.write_text(text, encoding="utf-8"))
                written.append(target)
            self.sketch(home / SKETCH)
            page = inspection_page(self.inspected, (home / SKETCH).read_bytes())
            run_directory.replace_file(home / SANITY, lambda temporary: temporary.write_text(page, encoding="utf-8"))
        except OSError as e:
            raise BadInput(
                f"{home}: cannot be written to ({e.strerror}); name another directory by --out, in Python out="
            ) from None
        return [*written, home / SKETCH, home / SANITY]


def inspect(path: str | Path, run: str = "", again: bool = False) -> Inspection:
    """Look at a recording before anything is fitted: series, gaps, units, clocks, frames.

    Args:
        path: a directory of CSV files, a ROS bag, a PyFG file, or MRCLAM text; a log.toml there is believed.
        run: which recording of several; the first if empty.
        again: guess everything once more, whatever log.toml says.

    Raises:
        BadInput: nothing there can be read; one line that says what to do.

    """
    if not isinstance(path, str | Path):
        raise BadInput(f"path is a {type(path).__name__}: write CSV files into a folder, and name it")
    return Inspection(inspect_recording(Path(path), run, again))

"""What a run has for a paper in LaTeX: `cl.paper`, and `cooploc report --paper`."""

from collections.abc import Iterable
from pathlib import Path

from cooploc.analysis.paper.fitted_table import DEFAULT
from cooploc.analysis.paper.write import EXAMPLE, write
from cooploc.estimators import split
from cooploc.runs import Results, kept


def paper(
    run: Results | str | Path,
    out: str | Path | None = None,
    columns: str | Iterable[str] = DEFAULT,
    scenarios: str | Iterable[str] = (),
) -> Path:
    """Write a run's figures, tables and references for a two-column paper; returns the path of an example document.

    `figures/` has every figure as PDF and SVG, one column wide (3.5 in) and two (7.16 in), with text of 8 pt and
    embedded fonts; `tables/` LaTeX tables that fit, with caption, label and notes; `estimators.bib` the sources of what
    was run; `example.tex` includes them all. Every sweep is drawn; of scenarios that sweep nothing, the first, the
    middle and the last of each experiment.

    Args:
        run: from `run_study` or `load_run`, or a run directory.
        out: the directory; `paper` in the run directory where not given.
        columns: of the tables, by the names that the report's CSV tables have, as a list or separated by commas; one
            with an interval brings it along.
        scenarios: write figures and tables of these alone, and draw each.

    Raises:
        BadInput: the run cannot be read, a column or a scenario is unknown, or the columns do not fit a page.
        OSError: a file cannot be written.

    """
    stored = kept(run)
    folder = stored.folder / "paper" if out is None else Path(out)
    write(stored, folder, _names(columns), _names(scenarios))
    return folder / EXAMPLE


def _names(given: str | Iterable[str]) -> list[str]:
    return split(given) if isinstance(given, str) else list(given)

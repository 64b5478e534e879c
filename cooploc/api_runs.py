"""A run's results from Python: verdicts on a paper's claims, what readings are worth, what results depend on, LaTeX."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd

from cooploc.analysis.claims import multiverse
from cooploc.analysis.claims.ledger import Ledger
from cooploc.analysis.claims.verdicts import judge_run, verdict_sentence
from cooploc.analysis.metrics import run_tables
from cooploc.analysis.metrics.sequential import ANYTIME, FIXED
from cooploc.analysis.report.paper import DEFAULT, EXAMPLE, write
from cooploc.estimators import split_labels
from cooploc.runs import Results, kept, ledger_of, looks_of, rows_of


def verdicts(run: Results | str | Path | pd.DataFrame, ledger: Ledger | str | Path | None = None) -> pd.DataFrame:
    """Judge the claims of a paper by a run: one row per claim, variant and case.

    `cooploc.analysis.claims.verdicts.COLUMNS` says what the columns mean; `map` says in how many readings of the paper
    the claim holds, where more than one was run; `sentence` is each row in words. Of a run until decided, verdicts are
    those of its confidence sequences, and `look` says after how many trials each was reached; else it is 0.

    Args:
        run: from `run_study` or `load_run`, a run directory, or rows of `errors`.
        ledger: the TOML file of the claims; without it, those of Latif & Parasuraman (2022).

    Raises:
        BadInput: the run or the ledger cannot be read, or estimators of one scenario ran on different streams.

    """
    return verdicts_and_readings(run, ledger)[0]


def readings(run: Results | str | Path | pd.DataFrame, ledger: Ledger | str | Path | None = None) -> pd.DataFrame:
    """Judge the claims of a paper in every reading of it that was run: one row per claim and specification.

    `cooploc.analysis.claims.multiverse.judge` says what the columns mean, and `shares` counts the rows by claim;
    `cl.plot.readings` and `cl.plot.specification_curve` draw them. The study `readings` runs all readings.

    Args:
        run: from `run_study` or `load_run`, a run directory, or rows of `errors`.
        ledger: the TOML file of the claims; without it, those of Latif & Parasuraman (2022).

    Raises:
        BadInput: the run or the ledger cannot be read, or estimators of one scenario ran on different streams.

    """
    return multiverse.judge(ledger_of(ledger), rows_of(run), ANYTIME if looks_of(run) else FIXED)


def verdicts_and_readings(run: Any, ledger: Any = None) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return what `verdicts` and `readings` return, computed once."""
    found, mapped = judge_run(ledger_of(ledger), rows_of(run), looks_of(run)), readings(run, ledger)
    maps = multiverse.sentences(mapped)
    said = [verdict_sentence(row) for _, row in found.iterrows()]
    return found.assign(map=[maps.get(claim, "") for claim in found["claim"]], sentence=said), mapped


def information(run: Results | str | Path) -> pd.DataFrame:
    """Return what readings are worth: own ones by those between robots, for every rule of fusion, with their floors.

    `cooploc.analysis.metrics.run_tables.information` says what the columns mean; `cl.plot.information` draws them. The
    study `information` runs all cells. The floors of ten robots take a minute or two.

    Args:
        run: from `run_study` or `load_run`, or a run directory.

    Raises:
        BadInput: the run cannot be read, or no estimator has a cell.

    """
    stored = kept(run)
    return run_tables.information(stored.rows, stored.manifest["seed"])


def sensitivity(run: Results | str | Path, baseline: str = "arl") -> pd.DataFrame:
    """Return how errors depend on each parameter that a run sweeps, with the floor where it exists.

    `cooploc.analysis.metrics.run_tables.sensitivity` says what the columns mean; `cl.plot.sensitivity` draws them. The
    study `sensitivity` is such a run. Its floors take a few minutes.

    Args:
        run: from `run_study` or `load_run`, or a run directory.
        baseline: the estimator that others are compared with.

    Raises:
        BadInput: the run cannot be read, sweeps nothing, or lacks the baseline.

    """
    stored = kept(run)
    return run_tables.sensitivity(stored.rows, stored.manifest["seed"], baseline)


def paper(
    run: Results | str | Path,
    out: str | Path | None = None,
    columns: str | Iterable[str] = DEFAULT,
    scenarios: str | Iterable[str] = (),
) -> Path:
    """Write a run's figures, tables and references for a two-column paper; return the path of an example document.

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
    names = [split_labels(given) if isinstance(given, str) else list(given) for given in (columns, scenarios)]
    write(stored, folder, *names)
    return folder / EXAMPLE

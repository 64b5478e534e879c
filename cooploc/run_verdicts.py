"""What a run says of a paper's claims, from Python: `verdicts` and `readings`."""

from pathlib import Path
from typing import Any

import pandas as pd

from cooploc.analysis.claims import at_looks, multiverse, wording
from cooploc.analysis.claims import ledger as ledgers
from cooploc.analysis.metrics.stopping import ANYTIME, FIXED
from cooploc.runs import Results, ledger_of, looks_of, rows_of


def verdicts(
    run: Results | str | Path | pd.DataFrame, ledger: ledgers.Ledger | str | Path | None = None
) -> pd.DataFrame:
    """Which claims of a paper a run supports, contradicts or leaves open: one row per claim, reading and case.

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


def verdicts_and_readings(run: Any, ledger: Any = None) -> tuple[pd.DataFrame, pd.DataFrame]:
    """What `verdicts` and `readings` return, computed once."""
    asked, rows, looks = ledger_of(ledger), rows_of(run), looks_of(run)
    found, mapped = at_looks.judged(asked, rows, looks), multiverse.judge(asked, rows, ANYTIME if looks else FIXED)
    maps = multiverse.sentences(mapped)
    said = [wording.sentence(row) for _, row in found.iterrows()]
    return found.assign(map=[maps.get(claim, "") for claim in found["claim"]], sentence=said), mapped


def readings(
    run: Results | str | Path | pd.DataFrame, ledger: ledgers.Ledger | str | Path | None = None
) -> pd.DataFrame:
    """The verdicts on a paper's claims in every reading of it that was run: one row per claim and specification.

    `cooploc.analysis.claims.multiverse.judge` says what the columns mean, and `shares` counts the rows by claim;
    `cl.plot.readings` and `cl.plot.specification_curve` draw them. The study `readings` runs all readings.

    Args:
        run: from `run_study` or `load_run`, a run directory, or rows of `errors`.
        ledger: the TOML file of the claims; without it, those of Latif & Parasuraman (2022).

    Raises:
        BadInput: the run or the ledger cannot be read, or estimators of one scenario ran on different streams.

    """
    return multiverse.judge(ledger_of(ledger), rows_of(run), ANYTIME if looks_of(run) else FIXED)

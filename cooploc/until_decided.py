"""Run a study until its questions are decided: `run_until`."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Unpack

import pandas as pd

from cooploc.analysis.claims.at_looks import judge_at, lasting, open_cells
from cooploc.analysis.claims.ledger import Ledger
from cooploc.analysis.execution.until_decided import Answers, run_until_decided
from cooploc.estimators.plugins.errors import BadInput
from cooploc.run_options import How
from cooploc.runs import Results, ledger_of, ran, run_study

MOST = 1000  # trials of what stays open
KEPT = ["claim", "variant", "scenario", "of", "than", "verdict", "look"]


def run_until(
    study: str | Path,
    *,
    max_trials: int = MOST,
    ledger: Ledger | str | Path | None = None,
    **how: Unpack[How],
) -> Results:
    """Run a study until its comparisons and claims are decided, as `cooploc run --until-decided` does.

    Trials come in blocks, up to 10, 20, 40, ... of each scenario. After each, every comparison with the scenario's
    baseline is looked at by a confidence sequence, which holds however one stops: it is decided where the change of
    RMSE is not 0, or lies within 5 % (a tie). So is every claim of the ledger whose estimators and scenarios the study
    has, but for claims about computing time. What is decided stops, what is open goes on.

    Sizes keep the intervals of a fixed number of trials, and are marked where a row stopped early, for stopping makes
    them a little too large. Verdicts come from the sequences.

    Args:
        study: as of `run_study`.
        max_trials: trials at which what is still open ends.
        ledger: the TOML file of the claims; without it, those of Latif & Parasuraman (2022).
        how: seed, estimators, jobs, scheduler, data, out, check, retry_failed, isolate: as of `run_study`.

    Raises:
        BadInput: the study cannot be run as it stands; nothing was computed.
        OSError: a file could not be written; what was finished is kept.

    """
    begin = partial(run_until_decided, ask=[Claims(ledger_of(ledger))])
    return ran(begin, study, max_trials, decided=True, **how)


def runner(until_decided: bool, trials: int | None, max_trials: int | None) -> Callable[..., Results]:
    """`run_until` or `run_study` with its number of trials, as the options of the command say.

    Raises:
        BadInput: the number of the other one was given.

    """
    if until_decided and trials is not None:
        raise BadInput("--trials is for a fixed number: with --until-decided, give --max-trials")
    if not until_decided and max_trials is not None:
        raise BadInput("--max-trials is given without --until-decided: add it, or give --trials")
    if until_decided:
        return partial(run_until, max_trials=MOST if max_trials is None else max_trials)
    return partial(run_study, trials=trials)


class Claims:
    """Asks at every look which claims of a ledger are decided."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._found: pd.DataFrame | None = None

    def __call__(self, rows: pd.DataFrame, n: int) -> Answers:
        """What the trials below n say."""
        self._found = found = judge_at(self._ledger, rows, n, self._found)
        judged = lasting(self._ledger, found)
        still = int((judged["verdict"] == "undecided").sum())
        cells = frozenset(open_cells(self._ledger, rows, found))
        records = [{key: row[key] for key in KEPT} for _, row in judged[KEPT].fillna("").iterrows()]
        return Answers("claim", cells, len(judged) - still, still, records)

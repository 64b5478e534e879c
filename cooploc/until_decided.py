"""Run a study until its questions are decided: `run_until`."""

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

import pandas as pd

from cooploc.analysis.claims.at_looks import judge_at, lasting, open_cells
from cooploc.analysis.claims.ledger import Ledger
from cooploc.analysis.execution.decisions_file import comparisons, read_decisions
from cooploc.analysis.execution.until_decided import Answers, run_until_decided
from cooploc.estimators.plugins.errors import BadInput
from cooploc.runs import Results, compared, ledger_of, prepared, run_study
from cooploc.terminal import results as printed
from cooploc.terminal.progress import TerminalProgress

MOST = 1000  # trials of what stays open
KEPT = ["claim", "variant", "scenario", "of", "than", "verdict", "look"]


def run_until(
    study: str | Path,
    *,
    max_trials: int = MOST,
    ledger: Ledger | str | Path | None = None,
    seed: int | None = None,
    estimators: str | Iterable[str] | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    data: str | Path | None = None,
    out: str | Path | None = None,
    check: bool = True,
    retry_failed: bool = False,
    isolate: bool = True,
) -> Results:
    """Run a study until its comparisons and claims are decided, as `cooploc run --until-decided` does.

    Trials come in blocks, up to 10, 20, 40, ... of each scenario. After each, every comparison with the scenario's
    baseline is looked at by a confidence sequence, which holds however one stops: it is decided where the change of
    RMSE is not 0, or lies within 5 % (a tie). So is every claim of the ledger whose estimators and scenarios the study
    has, but for claims about computing time. What is decided stops, what is open goes on.

    Sizes keep the intervals of a fixed number of trials, and are marked where a row stopped early, for stopping makes
    them a little too large. Verdicts come from the sequences.

    Args:
        study: as of `run_study`, like the arguments that are not named here.
        max_trials: trials at which what is still open ends.
        ledger: the TOML file of the claims; without it, those of Latif & Parasuraman (2022).
        seed, estimators, jobs, scheduler, data, out, check, retry_failed, isolate: as of `run_study`.

    Raises:
        BadInput: the study cannot be run as it stands; nothing was computed.
        OSError: a file could not be written; what was finished is kept.

    """
    asked, folder = prepared(study, max_trials, seed, estimators, out)
    with TerminalProgress() as progress:
        rows = run_until_decided(
            asked,
            folder,
            [Claims(ledger_of(ledger))],
            progress,
            data=None if data is None else Path(data),
            jobs=jobs,
            scheduler=scheduler,
            check=check,
            retry_failed=retry_failed,
            isolate=isolate,
        )
    results = Results(folder, rows, *compared(rows, asked.baselines(), comparisons(read_decisions(folder))))
    printed.keep(results.table, rows, folder)
    return results


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

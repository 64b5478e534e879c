"""`cl.tune`: every estimator of a study with the same budget of tuning, as published and tuned side by side."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from cooploc.analysis.execution.stored_run import read
from cooploc.analysis.report.csv_text import csv_text, read_csv_text
from cooploc.analysis.tuning import order as orders
from cooploc.analysis.tuning.record_file import read_record, write_record
from cooploc.analysis.tuning.tables import VALUE
from cooploc.analysis.tuning.tune import FILE, Options, Tuning
from cooploc.analysis.tuning.tune import tune as search_and_compare
from cooploc.runs import prepared
from cooploc.terminal.progress import TerminalProgress

TABLES = "history.csv", "published-and-tuned.csv"


@dataclass(frozen=True, eq=False, repr=False)
class Tuned:
    """What a tuning found, and the directory that holds it."""

    folder: Path
    history: pd.DataFrame  # one row per configuration that was tried
    table: pd.DataFrame  # one row per scenario and estimator, as published and tuned on fresh streams
    rows: pd.DataFrame  # as `cl.errors`, of the fresh streams
    tuned: dict[str, str]  # the tuned label of every estimator
    record: dict[str, Any]  # budget, seeds, hashes of the streams that tuning used

    @property
    def study(self) -> Path:
        """The study file with the tuned configurations, for `cooploc run`."""
        return self.folder / FILE

    def order(self, by: str = "rmse") -> pd.DataFrame:
        """Whether the order of every pair of estimators changes; `analysis.tuning.order.order` names the columns."""
        return orders.order(self.rows, self.tuned, by)

    def __repr__(self) -> str:
        return f"Tuned({str(self.folder)!r}, {len(self.tuned)} estimators, budget {self.record['budget']})"


def tune(
    study: str | Path,
    budget: int = 100,
    *,
    estimators: str | Iterable[str] | None = None,
    trials: int | None = None,
    seed: int | None = None,
    objective: str = "nll",
    jobs: int = 1,
    data: str | Path | None = None,
    out: str | Path | None = None,
    check: bool = True,
    isolate: bool = True,
) -> Tuned:
    """Tune every estimator with the same budget, and compare it as published and tuned, as `cooploc tune` does.

    What is tuned are the parameters that an estimator's class declares by `cl.tunable`, but for those that its label
    states. The streams of the search come from another seed than those of the comparison.

    Args:
        study: a shipped study (`cl.studies()`), or the path of a study's TOML file.
        budget: training trials that each estimator may use; one trial of every scenario is the least.
        estimators: names to tune instead of the study's, as a list or separated by commas.
        trials: fresh trials of each scenario in the comparison; the study's where not given.
        seed: the random seed of the comparison, from which that of the search is derived.
        objective: "nll", mean negative log-likelihood of the true position, with a robust cap; or "rmse".
        jobs: processes; the result is bit-identical for any number.
        data: the directory of recordings, for scenarios that need one.
        out: the directory; `runs/STUDY-seedN-tuned` where not given. The same call goes on with what it holds.
        check: whether estimators that are not built in are checked before they are compared.
        isolate: False keeps everything in this process, for a debugger.

    Raises:
        BadInput: the study cannot be tuned as it stands; nothing was computed.

    """
    asked, folder = prepared(study, trials, seed, estimators, out, suffix="-tuned")
    options = Options(None if data is None else Path(data), jobs, check, isolate)
    with TerminalProgress() as progress:
        found = search_and_compare(asked, folder, budget, objective, options, progress)
    return _kept(folder, found)


def load_tuned(folder: str | Path) -> Tuned:
    """What a finished tuning left in its directory.

    Raises:
        BadInput: it is not the directory of a tuning, one that has not finished, or one whose files are damaged.

    """
    where = Path(folder)
    record, texts = read_record(where, TABLES)
    history, table = (read_csv_text(texts[name]) for name in TABLES)
    return Tuned(where, history, table, read(where / "fresh").rows, record["tuned"], record)


def _kept(folder: Path, found: Tuning) -> Tuned:
    tables = map(csv_text, (found.history, found.gains))
    write_record(folder, found.record, dict(zip(TABLES, tables, strict=True)))
    _draw(folder, found.history)
    return Tuned(folder, found.history, found.gains, found.rows, found.tuned, found.record)


def _draw(folder: Path, history: pd.DataFrame) -> None:
    """The score against the budget, and of every estimator that has parameters, what each of them did."""
    import matplotlib.pyplot as plt

    from cooploc.analysis.plot import tuned_parameters, tuning

    drawn = {"score-against-budget": tuning(history)}
    for name, part in history.groupby("estimator", sort=False):
        if part.filter(like=VALUE).notna().any(axis=None):
            drawn[f"parameters-{re.sub(r'[^A-Za-z0-9.=]+', '-', str(name)).strip('-')}"] = tuned_parameters(
                history, str(name)
            )
    for name, ax in drawn.items():
        figure: Any = ax.figure
        figure.savefig(folder / f"{name}.png", dpi=130)
        plt.close(figure)

"""Studies from Python beyond `run_study`: run until decided, plan, sweep, tune."""

import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import pandas as pd

from cooploc.analysis.claims.ledger import Ledger
from cooploc.analysis.claims.verdicts import judge_at_look, lasting, open_cells
from cooploc.analysis.execution.until_decided import Answers, run_until_decided, trial_seconds
from cooploc.analysis.metrics.errors import errors
from cooploc.analysis.metrics.sequential import PILOT, trials_to_exclude, trials_until_decided
from cooploc.analysis.metrics.statistics import Interval
from cooploc.analysis.tuning.tables import VALUE
from cooploc.analysis.tuning.tune import Tuned
from cooploc.analysis.tuning.tune import tune as tune_study
from cooploc.estimators.errors import BadInput
from cooploc.run_options import How
from cooploc.runs import Results, ledger_of, prepared, ran, run_study
from cooploc.scenarios import family, simulate
from cooploc.scenarios.runner.run import run
from cooploc.scenarios.scenario import split_family
from cooploc.terminal.console import TerminalProgress

MOST_TRIALS = 1000  # of what stays open in a run until decided
DIFFERENCE = 0.1


def run_until(
    study: str | Path,
    *,
    max_trials: int = MOST_TRIALS,
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
        how: seed, estimators, jobs, scheduler, data, out, check, retry_failed, isolate, strict: as of `run_study`.

    Raises:
        BadInput: the study cannot be run as it stands; nothing was computed.
        OSError: a file could not be written; what was finished is kept.

    """
    begin = partial(run_until_decided, ask=[_OpenClaims(ledger_of(ledger))])
    return ran(begin, study, max_trials, decided=True, **how)


class _OpenClaims:
    """Asks at every look which claims of a ledger are decided."""

    COLUMNS = ("claim", "variant", "scenario", "of", "than", "verdict", "look")

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._found: pd.DataFrame | None = None

    def __call__(self, rows: pd.DataFrame, n: int) -> Answers:
        """Judge by the trials below n."""
        self._found = found = judge_at_look(self._ledger, rows, n, self._found)
        judged = lasting(self._ledger, found)
        still = int((judged["verdict"] == "undecided").sum())
        cells = frozenset(open_cells(self._ledger, rows, found))
        records = [dict(row) for _, row in judged[list(self.COLUMNS)].fillna("").iterrows()]
        return Answers("claim", cells, len(judged) - still, still, records)


def choose_runner(until_decided: bool, trials: int | None, max_trials: int | None) -> Callable[..., Results]:
    """Return `run_until` or `run_study` with its number of trials, as the options of the command say.

    Raises:
        BadInput: the number of the other one was given.

    """
    if until_decided and trials is not None:
        raise BadInput("--trials is for a fixed number: with --until-decided, give --max-trials")
    if not until_decided and max_trials is not None:
        raise BadInput("--max-trials is given without --until-decided: add it, or give --trials")
    if until_decided:
        return partial(run_until, max_trials=MOST_TRIALS if max_trials is None else max_trials)
    return partial(run_study, trials=trials)


def plan(
    study: str | Path,
    *,
    difference: float = DIFFERENCE,
    seed: int | None = None,
    estimators: str | Iterable[str] | None = None,
    jobs: int = 1,
    data: str | Path | None = None,
    out: str | Path | None = None,
    isolate: bool = True,
) -> pd.DataFrame:
    """Plan how many trials each comparison needs to show a difference in four of five runs (80 % power).

    Runs ten trials of the study, which its run directory keeps: a run of the study goes on from there. Ten trials know
    a spread to about a quarter, so the numbers of trials are right to about a factor of two.

    Columns:
        scenario, estimator, baseline: what is compared
        change: of RMSE, in the pilot
        trials: for one look, with the 95 % interval, to exclude a change of 0 where it is `difference`
        until_decided: the same with `cooploc run --until-decided`; a change that is twice as large needs a quarter
        seconds, baseline_seconds: computing time of one trial of each [s] on one process, without its stream;
            `analysis.metrics.sequential.minutes` adds them up

    Args:
        study: a shipped study, or the path of a study's TOML file.
        difference: the change of RMSE that is to be shown, such as 0.1 for 10 %.
        seed, estimators, jobs, data, out, isolate: as of `run_study`.

    Raises:
        BadInput: the study cannot be run as it stands, or the difference is not above 0.

    """
    if not difference > 0:
        raise BadInput(f"difference is {difference}; it must lie above 0, such as {DIFFERENCE} for 10 %")
    options: dict[str, Any] = {"seed": seed, "estimators": estimators, "jobs": jobs, "data": data, "out": out}
    pilot = run_study(study, trials=PILOT, isolate=isolate, **options)
    cost, distance = trial_seconds(pilot.rows), float(np.log1p(difference))
    found = []
    for row in pilot.table[pilot.table["estimator"] != pilot.table["baseline"]].to_dict("records"):
        log = Interval(*np.log1p([row["change"], row["change_low"], row["change_high"]]))
        found.append(
            {
                **{key: row[key] for key in ("scenario", "estimator", "baseline", "change")},
                "trials": trials_to_exclude(log, row["pairs"], distance),
                "until_decided": trials_until_decided(log, row["pairs"], distance),
                "seconds": cost[row["scenario"], row["estimator"]],
                "baseline_seconds": cost[row["scenario"], row["baseline"]],
            }
        )
    columns = ["scenario", "estimator", "baseline", "change", "trials", "until_decided", "seconds", "baseline_seconds"]
    return pd.DataFrame(found, columns=columns)


def sweep(
    scenario: str,
    estimators: Any,
    *,
    trials: int = 1,
    seed: int = 0,
    jobs: int = 1,
    data: str | Path | None = None,
    **parameters: Any,
) -> pd.DataFrame:
    """Return the errors of estimators over a sweep: `cl.sweep("packet-drop", ["arl", "ctrn"], drop={0, 0.5, 0.9})`.

    Every parameter of which a set, a list, a range or an array is given takes each of these values; of several, all
    combinations are run. Trials are paired over the sweep, too: they start from the same random numbers.

    Columns: those of `cl.errors`, and one for each swept parameter.

    Args:
        scenario: its label, such as "packet-drop".
        estimators: as for `cl.run`.
        trials: how many.
        seed: random seed.
        jobs: processes, as for `cl.run`.
        data: the directory of a recording.
        parameters: of the scenario, by the names that its label or its table of parameters has.

    Raises:
        BadInput: nothing is swept, a sweep is empty, or a parameter is unknown.

    """
    several = (set, frozenset, list, range, np.ndarray)
    swept = {name: _values(name, value) for name, value in parameters.items() if isinstance(value, several)}
    if not swept:
        raise BadInput("nothing is swept: give several values of a parameter, such as drop={0, 0.5}")
    fixed = {name: value for name, value in parameters.items() if name not in swept}
    tables = []
    for values in product(*swept.values()):
        chosen = dict(zip(swept, values, strict=True))
        label, overrides = _label_with(scenario, {**fixed, **chosen})
        truth, stream = simulate(label, trials=trials, seed=seed, data=data, **overrides)
        table = errors(truth, run(estimators, stream, jobs=jobs))
        tables.append(table.assign(**{name: value for name, value in chosen.items() if name not in table}))
    return pd.concat(tables, ignore_index=True)


def _values(name: str, given: Iterable[Any]) -> list[Any]:
    values = [value.item() if isinstance(value, np.generic) else value for value in given]
    if not values:
        raise BadInput(f"{name} is empty: there is nothing to sweep")
    return sorted(values) if isinstance(given, set | frozenset) else values


def _label_with(scenario: str, parameters: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return the label with the parameter that its family sweeps, as studies write it, and all others as overrides."""
    path, bracket, options = scenario.partition("[")
    name, which = split_family(path)
    words = family(name).sweep
    first = next((key for key in parameters if key in words and not which), None)
    others = {words.get(key, key): value for key, value in parameters.items() if key != first}
    return (scenario if first is None else f"{path}/{first}={parameters[first]}{bracket}{options}"), others


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
    where = None if data is None else Path(data)
    with TerminalProgress() as progress:
        found = tune_study(
            asked, folder, budget, objective, data=where, jobs=jobs, check=check, isolate=isolate, progress=progress
        )
    _draw_tuning(folder, found.history)
    return found


def _draw_tuning(folder: Path, history: pd.DataFrame) -> None:
    """Draw the score against the budget, and of every estimator that has parameters, what each of them did."""
    import matplotlib.pyplot as plt

    from cooploc.analysis.plot import tuned_parameters, tuning

    drawn = {"score-against-budget": tuning(history)}
    for name, part in history.groupby("estimator", sort=False):
        if part.filter(like=VALUE).notna().any(axis=None):
            safe = re.sub(r"[^A-Za-z0-9.=]+", "-", str(name)).strip("-")
            drawn[f"parameters-{safe}"] = tuned_parameters(history, str(name))
    for name, ax in drawn.items():
        figure: Any = ax.figure
        figure.savefig(folder / f"{name}.png", dpi=130)
        plt.close(figure)

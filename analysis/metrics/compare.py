"""Tables over trials: what each estimator achieves, and how it differs from a baseline on the same streams.

To add a statistic, write one entry in `STATISTICS`. Errors over time are below.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.formats import interval, metres, percent
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.consistency import COLLAPSED, band, consistency
from cooploc.analysis.metrics.errors import (
    CELL,
    COLUMNS,
    SENSES,
    demand_same_streams,
    describe_columns,
    drop_failed,
    is_offline,
    position_errors,
    stream_hash,
    trial_means,
)
from cooploc.analysis.metrics.statistics import FIXED, Interval
from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput, first_of
from cooploc.estimators.interface import Array
from cooploc.estimators.label_syntax import drop_folders, shorten_labels
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.stream import Truth

FAR = 5.0  # times the median trial's RMSE


# ---- statistics of an estimator in a scenario


class CellRows(NamedTuple):
    """The results of one estimator in one scenario, in trials that succeeded."""

    rows: pd.DataFrame  # of `errors`
    trials: pd.DataFrame  # as of `trial_means`


class Statistic(NamedTuple):
    """A number over trials; an `Interval` makes the columns `_low` and `_high`, too."""

    meaning: str
    of: Callable[[CellRows], float | Interval]
    unit: str = ""
    short: bool = False  # whether `compare` shows it unless it is asked for all


def _share(cell: CellRows, column: str) -> Interval:
    """Return the mean of a share over trials with its interval (Wilson)."""
    return statistics.share(cell.trials[column].dropna().to_numpy(float))


def mark_outliers(mse: Array) -> Array:
    """Return 1.0 for a trial whose RMSE exceeds `FAR` times that of the median trial, else 0.0; from squared errors."""
    return (mse > FAR**2 * np.median(mse)).astype(float) if len(mse) else np.zeros(0)


def _trial_mean(column: str) -> Callable[[CellRows], float]:
    return lambda cell: cell.trials[column].mean()


def _robot_mean(column: str) -> Callable[[CellRows], float]:
    return lambda cell: cell.rows[column].mean()


STATISTICS = {
    "rmse": Statistic(
        "square root of the mean over trials of the trial's mean squared position error",
        lambda cell: Interval(*np.sqrt(FIXED.mean_of_positive(cell.trials["mse"].to_numpy(float)))), "m",
    ),
    "rmse_median": Statistic(
        "median over trials of the trial's RMSE", lambda cell: np.sqrt(cell.trials["mse"]).median(), "m", short=True
    ),
    "outlying": Statistic(
        f"share of trials whose RMSE exceeds {FAR:g} times that median (Wilson); RMSE's interval is then too narrow",
        lambda cell: statistics.share(mark_outliers(cell.trials["mse"].dropna().to_numpy(float))), short=True,
    ),
    "anees": Statistic(
        "position NEES / 2, per trial first, then over trials; 1 is consistent",
        lambda cell: FIXED.mean_of_positive(cell.trials["anees"].to_numpy(float)), short=True,
    ),
    "anees_median": Statistic(
        "median over trials of the trial's ANEES", lambda cell: cell.trials["anees"].median(), short=True
    ),
    "collapsed": Statistic(
        f"share of trials whose ANEES exceeds {COLLAPSED:g} (Wilson)",
        lambda cell: statistics.share(np.asarray(cell.trials["anees"].dropna() > COLLAPSED, float)), short=True,
    ),
    "coverage95": Statistic(
        "share of true positions inside the 95 % ellipse",
        lambda cell: _share(cell, "coverage95")._replace(value=cell.trials["coverage95"].mean()), short=True,
    ),
    "nll": Statistic("mean negative log-likelihood, as of `errors`", _trial_mean("nll"), "nats", short=True),
    "diverged": Statistic(
        "share of (trial, robot) whose last-quarter RMSE exceeds a quarter of the arena's side",
        lambda cell: _share(cell, "diverged")._replace(value=cell.rows["diverged"].mean()), short=True,
    ),
    "messages": Statistic("messages per robot and tick, as sent", _robot_mean("messages")),
    "bytes": Statistic("bytes per robot and tick, as sent", _robot_mean("bytes"), short=True),
    "seconds": Statistic("computing time per robot and tick", _robot_mean("seconds"), "s", short=True),
    "outside": Statistic("share of ticks whose estimate lies outside of the arena", _trial_mean("outside")),
    "area95": Statistic("mean area of the 95 % ellipse", _trial_mean("area95"), "m^2"),
    "mean_error": Statistic("mean Euclidean position error", _trial_mean("mean_error"), "m"),
    "median_error": Statistic("a robot's median position error in a trial, averaged", _trial_mean("median_error"), "m"),
    "final_error": Statistic("position error at the last tick, averaged", _trial_mean("final_error"), "m"),
    "max_error": Statistic("a robot's largest position error in a trial, averaged", _trial_mean("max_error"), "m"),
}  # fmt: skip


def summarize(errors: pd.DataFrame) -> pd.DataFrame:
    """Return one row per (scenario, estimator), in order of appearance; a trial that failed counts as `failed` alone.

    A trial whose error is not finite has failed, too. An estimator that failed in a trial does not qualify as best, is
    not ranked, and no difference in its favour is significant.

    Columns, with `_low` and `_high` the ends of a 95 % interval over trials where there is one, nan below five trials:
        scenario, estimator: their labels
        robots: robots in the team
        trials: trials that succeeded
        failed: trials that failed
        {statistics}
        stream: hash of the scenario's stream, over its trials
        certificate: one line on the estimator's checks; empty for a built-in one, and where none were asked for

    Raises:
        BadInput: `errors` is neither from `errors` nor the rows of a run directory.

    """
    errors = require_errors(errors)
    return _summary(errors, trial_means(errors))


summarize.__doc__ = (summarize.__doc__ or "").replace("{statistics}", describe_columns(STATISTICS))


def _summary(errors: pd.DataFrame, cells: dict[tuple[str, str], pd.DataFrame]) -> pd.DataFrame:
    """Return the table of `summarize`, from the trials of every cell."""
    rows = []
    for (scenario, estimator), group in errors.groupby(CELL, sort=False):
        cell = CellRows(drop_failed(group), cells[str(scenario), str(estimator)])
        row: dict[str, Any] = {"scenario": str(scenario), "estimator": str(estimator)}
        row |= {"robots": int(group["robots"].iloc[0]), "trials": len(cell.trials)}
        row["failed"] = group["trial"].nunique() - len(cell.trials)
        for name, one in STATISTICS.items():
            value = one.of(cell)
            row |= value.columns(name) if isinstance(value, Interval) else {name: value}
        lines = list(group["certificate"].dropna()) if "certificate" in group else []
        rows.append({**row, "stream": stream_hash(group), "certificate": str(lines[0]) if lines else ""})
    return pd.DataFrame(rows)


# ---- an estimator against its baseline

# What `compare` shows unless it is asked for all.
SHORT = (
    *("scenario", "estimator", "trials", "rmse", "rmse_low", "rmse_high", "change", "change_low", "change_high"),
    *("p_holm", "consistency", *(name for name, one in STATISTICS.items() if one.short)),
    *("failed", "centralised", "bound", "senses", "certificate"),
)


def compare(errors: pd.DataFrame, baseline: str | Mapping[str, str], full: bool = False) -> pd.DataFrame:
    """Compare every estimator with a baseline, trial by trial on the same streams; one row per (scenario, estimator).

    A change or difference is negative where the estimator's error is smaller than the baseline's. The table has those
    columns of `summarize` that are read most, and these.

    Columns:
        change: RMSE / the baseline's RMSE - 1, with its interval (`FIXED.change`); -0.2 is an error 20 % smaller
        p_holm: p of the test of `change`, adjusted by Holm over all rows of the table
        consistency: as of `consistency.flag`: over-confident, consistent, conservative, over-wide, ...
        centralised: True for an estimator whose readings all reach one computer
        bound: True for a centralised one that bounds all others
        senses: what it reads beside odometry, in words

    With `full=True` it has all columns of `summarize`, and these.

    More columns:
        offline: True for an estimator that saw the readings of later ticks, too; never best, and not ranked
        baseline: the estimator that the row is compared with
        pairs: trials in which both succeeded
        difference [m]: mean over trials of RMSE minus the baseline's, with its t interval
        mark: in words, on a recording: whether it is worse than `constant`, or leaves the arena
        decisive_trial: the number of the trial that alone decides `change`, see `statistics.decisive_trial`; nan: none
        p: p against equal RMSE, not adjusted; 1 where the one that looks better failed in a trial
        effect: matched-pairs rank-biserial correlation in [-1, 1]: in how many trials errors are smaller (negative)
        p_equal: p of the equivalence test on the RMSE; small where the two tie within 5 %; 1 where one failed
        p_equal_holm: p_equal, adjusted by Holm

    Args:
        errors: from `errors`, or the rows of a run directory; or a table of your own with columns estimator, trial and
            rmse [m], nan where a trial failed, and scenario and robot where there are several.
        baseline: an estimator's label, or one for each scenario's label.
        full: all columns instead of those that are read most.

    Raises:
        BadInput: `errors` is not such a table, the baseline is not in it, or rows to be paired are of different
            streams or ticks.

    """
    errors = require_errors(errors)
    known, scenarios = list(errors["estimator"].unique()), list(errors["scenario"].unique())
    given = baseline if isinstance(baseline, Mapping) else dict.fromkeys(scenarios, baseline)
    against = {str(scenario): str(name) for scenario, name in given.items()}
    for scenario in scenarios:
        if scenario not in against:
            raise BadInput(f"baseline names none for scenario {scenario!r}: add it")
        if (name := against[scenario]) not in known:
            raise BadInput(f"there is no estimator {name!r} to compare with; {nearest(name, known)}")
    demand_same_streams(errors)
    cells = trial_means(errors)
    table = _summary(errors, cells)
    table["consistency"] = consistency(table)
    senses = errors.get(SENSES, "")  # results of former versions lack it
    groups = errors.assign(offline=is_offline(errors), senses=senses).groupby(CELL, sort=False)
    for standing in ("centralised", "bound", "offline"):
        table[standing] = groups[standing].any().to_numpy()
    constant = table["scenario"].map(table[table["estimator"] == "constant"].set_index("scenario")["rmse"])
    marks = {"worse than a constant": table["rmse"] > constant, "leaves the arena": table["outside"] > 0}
    held = [[mark for mark, holds in marks.items() if holds[i]] for i in table.index]
    table["mark"] = [", ".join(some) * bool(one == one) for some, one in zip(held, constant, strict=True)]
    table[SENSES] = groups[SENSES].first().fillna("").to_numpy()
    failed = dict(zip(zip(table["scenario"], table["estimator"], strict=True), table["failed"] > 0, strict=True))
    pairs = pd.DataFrame([_against(cells, failed, cell, against[cell[0]]) for cell in failed])
    for test in ("p", "p_equal"):
        pairs[f"{test}_holm"] = statistics.holm(pairs[test].to_numpy())
    last = ["stream", "certificate"]
    everything = pd.concat([table.drop(columns=last), pairs, table[last]], axis=1)
    return everything if full else everything[list(SHORT)]


OWN = ("estimator", "trial", "rmse")  # columns that a table made elsewhere must have
NOT_A_NUMBER = {"", "nan", "na", "none"}  # which stand for a trial that failed


def require_errors(errors: object) -> pd.DataFrame:
    """Return a table of `cl.errors`, whatever a user has made its index; refuse what is none, or has no rows.

    Of a table made elsewhere three columns are enough, `OWN`.
    """
    wanted = f"it must be the table that cl.errors returns, results.rows of a study, or one with {', '.join(OWN)} [m]"
    if not isinstance(errors, pd.DataFrame):
        raise BadInput(f"errors is of type {type(errors).__name__}; {wanted}")
    errors = errors.reset_index([name for name in errors.index.names if name in OWN and name not in errors])
    if missing := [name for name in (COLUMNS if "mse" in errors else OWN) if name not in errors]:
        raise BadInput(f"errors has no column {missing[0]!r}; {wanted}")
    if errors.empty:
        raise BadInput("errors has no rows: select some")
    rows = errors.reset_index(drop=True)
    return rows if "mse" in rows else _complete(rows)


def _complete(own: pd.DataFrame) -> pd.DataFrame:
    """Return a table with `OWN`, and any other columns of `errors`, with all of them: nan is what is not known.

    Rows of a trial are paired, as if they were of one stream; a trial without a number has failed.
    """
    if lacking := [
        name for name in ("scenario", "estimator", "trial", "robot") if name in own and own[name].isna().any()
    ]:
        raise BadInput(f"{lacking[0]} is empty in some rows: fill it in, or leave these rows out")
    rmse = pd.to_numeric(own["rmse"], errors="coerce")
    for text in own["rmse"][rmse.isna() & own["rmse"].notna()].astype(str):
        if text.strip().lower() not in NOT_A_NUMBER:
            raise BadInput(f"rmse has {text!r}, which is no number: write root mean squared errors [m]")
    if (rmse < 0).any() or rmse.isna().all():
        raise BadInput(
            "rmse has a negative number, or none: write root mean squared errors [m], nan where a trial failed"
        )
    single: dict[str, Any] = {"scenario": "results", "robot": 0, "ticks": 1, "centralised": False, "bound": False}
    rows = own.assign(**{name: value for name, value in single.items() if name not in own}, rmse=rmse, mse=rmse**2)
    rows = rows.astype({"scenario": str, "estimator": str})
    rows["robots"] = rows.groupby("scenario")["robot"].transform("nunique")
    rows["stream"] = "trial " + rows["trial"].astype(str)
    return rows.reindex(columns=[*COLUMNS, *(name for name in rows if name not in COLUMNS)])


def _against(
    cells: dict[tuple[str, str], pd.DataFrame],
    failed: dict[tuple[str, str], bool],
    cell: tuple[str, str],
    baseline: str,
) -> dict[str, object]:
    """Return the columns that `compare` adds to a row, from the trials that an estimator and its baseline both have."""
    scenario, estimator = cell
    base = cells[scenario, baseline]["mse"] if (scenario, baseline) in cells else pd.Series(dtype=float)
    both = pd.concat([base, cells[cell]["mse"]], axis=1, join="inner", keys=["base", "mine"]).dropna()
    a, b = both["base"].to_numpy(), both["mine"].to_numpy()
    change, n = FIXED.change(a, b), len(both)
    other = estimator != baseline
    tested = other and n >= statistics.LEAST_TRIALS
    decisive = statistics.decisive_trial(a, b)
    lost = failed.get((scenario, baseline), False), failed[cell]
    p = FIXED.p_of_difference(a, b) if tested else np.nan
    p_equal = statistics.equivalence(a, b) if tested else np.nan
    return {
        "baseline": baseline,
        "pairs": n,
        **FIXED.mean(np.sqrt(b) - np.sqrt(a)).columns("difference"),
        **change.columns("change"),
        "decisive_trial": both.index[decisive] if decisive is not None and other else np.nan,
        "p": 1.0 if p == p and lost[int(change.value < 0)] else p,
        "effect": statistics.rank_biserial(np.sqrt(a), np.sqrt(b)) if tested else np.nan,
        "p_equal": 1.0 if p_equal == p_equal and any(lost) else p_equal,
    }


OF_TEAM = ("team ", "sightings")  # what readings of teammates begin with


def table_warnings(table: pd.DataFrame) -> list[str]:
    """Return what a reader must know of a table of `compare`: other readings, fewer trials, trials that decide."""
    return [*reading_warnings(table), *trial_warnings(table), *outlier_warnings(table)]


def trial_warnings(table: pd.DataFrame) -> list[str]:
    """Return a sentence on each estimator that lacks trials which others of its scenario have.

    A run that stops what is decided does so on purpose.
    """
    there = table["trials"] + table["failed"]
    rows = table.assign(there=there, most=there.groupby(table["scenario"]).transform("max"))
    return [
        f"{row['scenario']}, {shorten_labels(row['estimator'])}: {row['there']} trials, and others {row['most']}: its "
        "RMSE is of these, its change of those that it shares with the baseline"
        for row in rows[rows["there"] < rows["most"]].to_dict("records") * ("look" not in table)
    ]


def outlier_warnings(table: pd.DataFrame) -> list[str]:
    """Return a sentence on each row of `summarize` or `compare` whose RMSE a few trials decide."""
    ends = interval(percent)
    return [
        f"{row['scenario']}, {shorten_labels(row['estimator'])}: {round(row['outlying'] * row['trials'])} of "
        f"{row['trials']} trials ({ends(row['outlying_low'], row['outlying_high']) or 'no interval'}) err more than "
        f"{FAR:g} times as much as the median trial, {metres(row['rmse_median'])} m; they decide the RMSE, "
        f"{metres(row['rmse'])} m, and its interval is too narrow; diverged: {percent(row['diverged'])} of robots"
        for row in table[table["outlying"] > 0].to_dict("records")
    ]


def reading_warnings(table: pd.DataFrame) -> list[str]:
    """Return a sentence where estimators of a scenario read different things of their own, as RSSI or its direction."""
    own = [", ".join(w for w in text.split(", ") if not w.startswith(OF_TEAM)) for text in table["senses"].fillna("")]
    rows = table.assign(own=own)[["scenario", "estimator", "own"]]
    rows = rows[~rows["own"].isin(["", "odometry"])]
    differ = rows[rows.groupby("scenario")["own"].transform("nunique") > 1]
    if differ.empty:
        return []
    named = differ.groupby("own", sort=False)["estimator"].unique()
    parts = [f"{read} ({first_of(map(drop_folders, names))})" for read, names in named.items()]
    return [f"estimators differ in what they read, not in their methods alone: {', '.join(parts)}"]


# ---- over time


def over_time(truth: Truth, run: Run, step: int = 1) -> pd.DataFrame:
    """Return `rmse` [m] and `anees` by (estimator, tick), with 95 % intervals over trials, and the chi-square band.

    With a `step` of 2 every second tick is there, the first one among them.
    Robots are pooled within a trial first. `band_low` and `band_high` hold the ANEES of a consistent estimator in
    95 % of the ticks if errors are Gaussian and the robots of a trial count as one: a guide, not a test.
    """
    rows: list[dict[str, Any]] = []
    for name, trace in run.traces.items():
        d2, nees = position_errors(truth, run, trace)
        for k in range(0, d2.shape[1], step):
            mse, anees = (np.nanmean(a[~np.isnan(a).all(1)], axis=1) for a in (d2[:, k], nees[:, k] / 2))
            rmse = Interval(*np.sqrt(FIXED.mean_of_positive(mse)))
            row = {"scenario": run.scenario, "estimator": name, "tick": k, **rmse.columns("rmse")}
            row |= FIXED.mean_of_positive(anees).columns("anees")
            rows.append(row | dict(zip(("band_low", "band_high"), band(len(anees), 2), strict=True)))
    return pd.DataFrame(rows)

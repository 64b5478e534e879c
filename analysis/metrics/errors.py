"""From traces and truth to one tidy row per (scenario, estimator, trial, robot), and to means over a trial's robots.

Ticks without truth, and a declared burn-in, do not count. To add a number, write one entry in `MEASURES`.
"""

import hashlib
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Mask
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.runner.trace import Trace
from cooploc.scenarios.stream import Truth

INSIDE_95 = -2 * np.log(0.05)  # chi-square quantile, two degrees of freedom
COLUMNS = (  # that every table of errors has; `errors` says what they mean
    *("scenario", "estimator", "trial", "robot", "robots", "ticks", "mse", "rmse", "mean_error", "median_error"),
    *("max_error", "final_error", "anees", "coverage95", "diverged", "pose_nees", "messages", "bytes", "seconds"),
    *("centralised", "bound", "stream"),
)
SENSES = "senses"  # after those; lacking in former versions
TRAINED = "; trained on: "  # in a certificate's line, before what an estimator says that it was trained on
UNCHECKED = "unchecked: cl.run does not check estimators, cl.check_estimator does"
OFFLINE = "offline"  # a column after those, of an estimator that saw later readings too
NOTE = "note: "  # columns after those: what an estimator counted; a name that begins with "largest" is a maximum
CELL = ["scenario", "estimator"]
TRIAL = [*CELL, "trial"]
LARGEST = 1e100  # [m^2] the square of a larger error overflows in a variance


class TickErrors(NamedTuple):
    """Errors of an estimator at every tick; nan at ticks that do not count."""

    d2: Array  # (t, T, n) squared position error [m^2]
    d: Array  # (t, T, n) position error [m]
    nees: Array  # (t, T, n) position NEES
    pose_nees: Array  # (t, T, n) NEES of position and heading; nan where there is no heading
    det: Array  # (t, T, n) determinant of the position's covariance [m^4], 0 where it is not positive
    valid: Mask  # (t, T, n) ticks that count
    side: float  # longest side of the arena [m]
    outside: Array  # (t, T, n) 1.0 where the estimate lies outside of the arena, else 0.0


class Measure(NamedTuple):
    """A number of one robot in one trial."""

    meaning: str
    of: Callable[[TickErrors], Array]  # (t, n)
    unit: str = ""
    mean: str = ""  # over a trial's robots: weighted by "ticks", or of all "robots" alike; empty: not averaged


def _nll(e: TickErrors) -> Array:
    """-log N(e; 0, P) = log 2 pi + (log det P + e' P^-1 e) / 2 [nats], averaged over ticks; infinite for a singular P.

    A proper score (Gneiting & Raftery, J. American Statistical Association 102, 2007).
    """
    with np.errstate(divide="ignore"):
        log_det = np.where(e.det > 0, np.log(e.det), 0.0)
    nll = np.where(e.det > 0, np.log(2 * np.pi) + (log_det + e.nees) / 2, np.inf)
    return _mean_with_covariance(e, nll)


def _mean_with_covariance(e: TickErrors, values: Array) -> Array:
    return over_ticks(np.nanmean, np.where(np.isnan(e.nees), np.nan, values))


def _divergence(e: TickErrors) -> Array:
    count = e.valid.cumsum(1)
    late = e.valid & (count > 0.75 * count[:, -1:])
    tail = over_ticks(np.nanmean, np.where(late, e.d2, np.nan))
    return np.where(np.isnan(tail), np.nan, np.sqrt(tail) > e.side / 4)


def _final_error(e: TickErrors) -> Array:
    there = ~np.isnan(e.d)
    last = e.d.shape[1] - 1 - there[:, ::-1].argmax(1)
    return np.take_along_axis(e.d, last[:, None], 1)[:, 0]


def over_ticks(reduce: Any, values: Array) -> Array:
    """Reduce (t, T, n) over the ticks that count; nan where none does."""
    t, _, n = values.shape
    out = np.full((t, n), np.nan)
    some = ~np.isnan(values).all(1)
    if some.any():
        out[some] = reduce(values.swapaxes(1, 2)[some], axis=-1)
    return out


MEASURES = {
    "mse": Measure("mean squared position error", lambda e: over_ticks(np.nanmean, e.d2), "m^2", "ticks"),
    "rmse": Measure("its square root", lambda e: np.sqrt(over_ticks(np.nanmean, e.d2)), "m"),
    "mean_error": Measure("mean Euclidean position error", lambda e: over_ticks(np.nanmean, e.d), "m", "ticks"),
    "median_error": Measure("median Euclidean position error", lambda e: over_ticks(np.nanmedian, e.d), "m", "robots"),
    "max_error": Measure("largest position error", lambda e: over_ticks(np.nanmax, e.d), "m", "robots"),
    "final_error": Measure("position error at the last tick that counts", _final_error, "m", "robots"),
    "anees": Measure(
        "mean position NEES / 2; 1 is consistent", lambda e: over_ticks(np.nanmean, e.nees) / 2, "", "ticks"
    ),
    "coverage95": Measure(
        "share of true positions inside the 95 % ellipse",
        lambda e: _mean_with_covariance(e, e.nees <= INSIDE_95), "", "ticks",
    ),
    "diverged": Measure(
        "1 where the last quarter's RMSE exceeds a quarter of the arena's side, else 0", _divergence, "", "robots"
    ),
    "pose_nees": Measure(
        "mean NEES of position and heading / 3; nan where the truth has no heading",
        lambda e: over_ticks(np.nanmean, e.pose_nees) / 3,
    ),
    "nll": Measure(
        "mean negative log-likelihood of the true position under the estimate, per tick; smaller is better, and a "
        "covariance that is too small or too large makes it larger", _nll, "nats", "ticks",
    ),
    "area95": Measure(
        "mean area of the 95 % ellipse",
        lambda e: _mean_with_covariance(e, np.pi * INSIDE_95 * np.sqrt(e.det)), "m^2", "ticks",
    ),
    "outside": Measure(
        "share of ticks whose estimate lies outside of the arena",
        lambda e: over_ticks(np.nanmean, e.outside), "", "ticks",
    ),
}  # fmt: skip
OPTIONAL_COLUMNS = tuple(name for name in MEASURES if name not in COLUMNS)  # results of former versions lack them


def errors(truth: Truth, run: Run, burn_in: int = 0) -> pd.DataFrame:
    """Return errors, consistency and cost of every estimator of a run, one row per (scenario, estimator, trial, robot).

    Columns:
        scenario, estimator: their labels
        trial, robot: their numbers
        robots: robots in the team
        ticks: ticks that count
        {measures}
        messages, bytes: per tick, as sent
        seconds [s]: computing time per robot and tick, averaged over the run
        centralised: True for an estimator whose readings all reach one computer, which knows more than any robot
        bound: True for a centralised one that bounds all others
        stream: hash of the trial's stream; rows of equal hashes are paired
        senses: what the estimator reads beside odometry, such as "DOA, team ranges"
        certificate: "unchecked: ..." for what is not built in, which `cl.run` does not check, and what it says that it
            was trained on; only where there is such
        offline: True for an estimator that saw the readings of later ticks, too; only where there is such
        "note: NAME": what an estimator counted itself, if anything; a NAME that begins with "largest" is a maximum

    Ticks before `burn_in` do not count.

    Raises:
        BadInput: truth and run are swapped or of different streams, or no tick is left to count.

    """
    demand_same(truth, run)
    if not run.traces:
        raise BadInput("the run has no estimator: name one, such as 'arl'")
    if not 0 <= burn_in < truth.x.shape[1]:
        raise BadInput(f"burn_in is {burn_in}; it must lie between 0 and {truth.x.shape[1] - 1}")
    valid = truth.valid.copy()
    valid[:, :burn_in] = False
    return pd.concat([_frame(truth, run, name, trace, valid) for name, trace in run.traces.items()], ignore_index=True)


def describe_columns(columns: Mapping[str, Any]) -> str:
    """Return the lines of a docstring that say what columns mean, from entries with `unit` and `meaning`."""
    units = {name: f" [{one.unit}]" if one.unit else "" for name, one in columns.items()}
    return "\n        ".join(f"{name}{units[name]}: {one.meaning}" for name, one in columns.items())


errors.__doc__ = (errors.__doc__ or "").replace("{measures}", describe_columns(MEASURES))


def position_errors(truth: Truth, run: Run, trace: Trace) -> tuple[Array, Array]:
    """Return squared position error [m^2] and position NEES (t, T, n) of one trace; nan where the truth is unknown."""
    demand_same(truth, run)
    ticks = _tick_errors(truth, trace, truth.valid)
    return ticks.d2, ticks.nees


def demand_same(truth: object, run: object) -> None:
    """Refuse what is not a truth and a run of the same stream."""
    if not (isinstance(truth, Truth) and isinstance(run, Run)):
        kinds = [one.__name__ if isinstance(one, type) else type(one).__name__ for one in (truth, run)]
        raise BadInput(
            f"truth and run are {' and '.join(kinds)}; pass the truth of cl.simulate first, then what cl.run gave"
        )
    if truth.origin != run.hashes:
        raise BadInput(
            f"this truth ({truth.scenario}) and run ({run.scenario}) are of different streams: simulate again"
        )


def _det(P: Array) -> Array:
    """Return the determinants of covariances (..., d, d), also of singular and of very large ones."""
    with np.errstate(all="ignore"):
        return np.asarray(np.linalg.det(P))


def _nees(e: Array, P: Array) -> Array:
    """e' P^-1 e; infinite where P is singular and e is not zero; nan where there is no P."""
    d = e.shape[-1]
    known = np.where(np.isnan(P), 0.0, P)[..., :d, :d]
    sound = _det(known) > 0
    safe = np.where(sound[..., None, None], known, np.eye(d))
    q: Array = np.einsum("...i,...i->...", e, np.linalg.solve(safe, e[..., None])[..., 0])
    q = np.where(sound | np.isnan(q), q, np.where((e == 0).all(-1), 0.0, np.inf))
    return np.where(np.isnan(P[..., 0, 0]), np.nan, q)


def _tick_errors(truth: Truth, trace: Trace, valid: Mask) -> TickErrors:
    d = min(truth.x.shape[-1], trace.x.shape[-1])
    e = np.where(valid[..., None], trace.x[..., :d] - truth.x[..., :d], np.nan)
    d2, nees, pose_nees = (e[..., :2] ** 2).sum(-1), _nees(e[..., :2], trace.P), np.full(valid.shape, np.nan)
    if d == 3:
        e[..., 2] = np.pi - np.mod(np.pi - e[..., 2], 2 * np.pi)
        pose_nees = _nees(e, trace.P)
    det = _det(np.where(np.isnan(trace.P), 0.0, trace.P)[..., :2, :2])
    side = float(np.max(truth.arena[1] - truth.arena[0]))
    beyond = ((trace.x[..., :2] < truth.arena[0]) | (trace.x[..., :2] > truth.arena[1])).any(-1)
    outside = np.where(np.isnan(d2), np.nan, beyond)
    return TickErrors(d2, np.sqrt(d2), nees, pose_nees, np.where(det > 0, det, 0.0), valid, side, outside)


def _frame(truth: Truth, run: Run, name: str, trace: Trace, valid: Mask) -> pd.DataFrame:
    """Return the rows of one estimator."""
    t, T, n = valid.shape
    ticks = _tick_errors(truth, trace, valid)
    columns: dict[str, Any] = {
        "scenario": run.scenario,
        "estimator": name,
        "trial": np.repeat(run.trial, n),
        "robot": np.tile(np.arange(n), t),
        "robots": n,
        "ticks": valid.sum(1).ravel(),
        **{key: np.asarray(one.of(ticks)).ravel() for key, one in MEASURES.items()},
        "messages": (trace.messages / T).ravel(),
        "bytes": (trace.bytes / T).ravel(),
        "seconds": trace.seconds / (t * T * n),
        "stream": np.repeat(run.hashes, n),
        "centralised": trace.centralised,
        "bound": trace.bound,
        SENSES: trace.senses,
    }
    columns = {key: columns[key] for key in (*COLUMNS, *OPTIONAL_COLUMNS, SENSES)}
    columns |= {OFFLINE: True} if trace.offline else {}
    columns |= {NOTE + key: values.ravel() for key, values in trace.notes.items()}
    if run.unchecked:
        learned = f"{TRAINED}{trace.trained_on}" if trace.trained_on else ""
        columns["certificate"] = UNCHECKED + learned if name in run.unchecked else ""
    return pd.DataFrame(columns)


# ---- rows pooled over the robots of a trial


def drop_failed(errors: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of trials that neither failed nor have an error that is not finite, of a robot with known truth.

    An error that is nan, infinite or beyond `LARGEST` is a failure of the whole trial.
    """
    lost = (errors["ticks"] > 0) & ~(errors["mse"] < LARGEST)
    if "failure" in errors:
        lost |= errors["failure"].notna()
    return errors[~lost.groupby([errors[key] for key in TRIAL]).transform("any")] if lost.any() else errors


def is_offline(errors: pd.DataFrame) -> "pd.Series[bool]":
    """Return which rows are of an estimator that saw the readings of later ticks, too."""
    return errors[OFFLINE].eq(True) if OFFLINE in errors else pd.Series(False, errors.index)


def trial_means(errors: pd.DataFrame) -> dict[tuple[str, str], pd.DataFrame]:
    """Return one row per trial that succeeded, by (scenario, estimator): means over robots, weighted by ticks.

    `MEASURES` says of which numbers every robot counts the same, as `bytes` do. `seconds`, `robots` and `stream` are
    those of the trial. A cell whose trials all failed has no rows.
    """
    ended = drop_failed(errors)
    by_ticks, by_robots = ([name for name, one in MEASURES.items() if one.mean == how] for how in ("ticks", "robots"))
    by_robots.append("bytes")
    groups = ended.groupby(TRIAL, sort=False)
    means = weighted_means(ended, TRIAL, [name for name in by_ticks if name in ended]).reindex(columns=by_ticks)
    means = means.join(groups[[name for name in by_robots if name in ended]].mean().reindex(columns=by_robots))
    means = means.join(groups[["seconds", "robots", "stream"]].first())
    known = {cell: part.droplevel([0, 1]).sort_index() for cell, part in means.groupby(level=CELL, sort=False)}
    nothing = means.iloc[:0].droplevel([0, 1])
    every = errors[CELL].drop_duplicates().itertuples(index=False, name=None)
    return {(str(s), str(e)): known.get((s, e), nothing) for s, e in every}


def weighted_means(errors: pd.DataFrame, keys: list[str], columns: list[str]) -> pd.DataFrame:
    """Return means of columns over the robots of each group, weighted by the ticks that count; index: the keys.

    A robot without such ticks does not count; one that has some, and no value, leaves its group without one.
    """
    groups: list[Any] = [errors[key] for key in keys]
    weight = errors["ticks"] / errors["ticks"].groupby(groups).transform("sum")
    means = errors[columns].mul(weight, axis=0).groupby(groups, sort=False).sum(min_count=1)
    absent = errors[columns].isna() & (errors[["ticks"]].to_numpy() > 0)
    return means.mask(absent.groupby(groups, sort=False).any()) if absent.to_numpy().any() else means


def demand_same_streams(errors: pd.DataFrame) -> None:
    """Refuse rows that look paired and are not, and copies of trials, which would count as independent."""
    for scenario, estimator, trial in errors.loc[errors.duplicated([*TRIAL, "robot"]), TRIAL].to_numpy():
        raise BadInput(f"{scenario}, {estimator}, trial {trial} stands there twice: join every run once")
    once = errors.drop_duplicates(["scenario", "stream", "trial"]).dropna(subset="stream")
    copies = once[once.duplicated(["scenario", "stream"], keep=False)]
    for (scenario, _), trials in copies.groupby(["scenario", "stream"], sort=False)["trial"]:
        raise BadInput(f"{scenario}: trials {', '.join(map(str, trials[:5]))} are of one stream; keep one of them")
    streams = errors.groupby(TRIAL[::2])["stream"].nunique()
    for scenario, trial in streams.index[streams > 1]:
        raise BadInput(f"{scenario}, trial {trial}: estimators ran on different streams; run them again on one stream")
    ticks = drop_failed(errors).groupby([*TRIAL[::2], "robot"])["ticks"].nunique()
    for scenario, trial, _ in ticks.index[ticks > 1]:
        raise BadInput(f"{scenario}, trial {trial}: estimators were judged on different ticks; use one burn_in")


def stream_hash(group: pd.DataFrame) -> str:
    """Return the hash of a scenario's stream: of the hashes of its trials, as `Stream.hash`."""
    trials = group.drop_duplicates("trial").sort_values("trial")["stream"].dropna()  # none where it was never made
    return hashlib.sha256("".join(trials).encode()).hexdigest()

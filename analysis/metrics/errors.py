"""From traces and truth to one tidy row per (scenario, estimator, trial, robot).

The definitions are those of the README's glossary; ticks without truth, and a declared burn-in, do not count.
"""

import hashlib
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array, Mask
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.runner.trace import Trace
from cooploc.scenarios.stream import Truth

INSIDE_95 = -2 * np.log(0.05)  # chi-square quantile, two degrees of freedom
COLUMNS = (  # `errors` says what they mean
    *("scenario", "estimator", "trial", "robot", "robots", "ticks", "mse", "rmse", "mean_error", "median_error"),
    *("max_error", "final_error", "anees", "coverage95", "diverged", "pose_nees", "messages", "bytes", "seconds"),
    *("centralised", "bound", "stream"),
)
SCORES = ("nll", "area95")  # columns after those; results of former versions lack them
SENSES = "senses"  # after those; lacking in former versions too
TRAINED = "; trained on: "  # in a certificate's line, before what an estimator says that it was trained on
UNCHECKED = "unchecked: cl.run does not check estimators, cl.check_estimator does"
OFFLINE = "offline"  # a column after those, of what saw later readings too
NOTE = "note: "  # columns after those: what an estimator counted; a name that begins with "largest" is a maximum


def errors(truth: Truth, run: Run, burn_in: int = 0) -> pd.DataFrame:
    """Errors, consistency and cost of every estimator of a run, one row per (scenario, estimator, trial, robot).

    Columns:
        scenario: label of the scenario
        estimator: label of the estimator
        trial: number of the trial
        robot: number of the robot, from 0
        robots: robots in the team
        ticks: ticks that count
        mse [m^2]: mean squared position error
        rmse [m]: its square root
        mean_error [m]: mean Euclidean position error
        median_error [m]: median Euclidean position error
        max_error [m]: largest position error
        final_error [m]: position error at the last tick that counts
        anees: mean position NEES / 2; 1 is consistent
        coverage95: share of true positions inside the 95 % ellipse
        diverged: 1 where the last quarter's RMSE exceeds a quarter of the arena's side, else 0
        pose_nees: mean NEES of position and heading / 3; nan where the truth has no heading
        messages: messages per tick, as sent
        bytes: bytes per tick, as sent
        seconds [s]: computing time per robot and tick, averaged over the run
        centralised: True for an estimator whose readings all reach one computer, which knows more than any robot
        bound: True for a centralised one that bounds all others
        stream: hash of the trial's stream; rows of equal hashes are paired
        nll: mean negative log-likelihood of the true position under the estimate, per tick [nats]; smaller is better,
            and a covariance that is too small or too large makes it larger
        area95 [m^2]: mean area of the 95 % ellipse
        senses: what the estimator reads beside odometry, such as "DOA, team ranges"
        certificate: "unchecked: ..." for what is not built in, which `cl.run` does not check, and what it says that it
            was trained on; only where there is such
        offline: True for an estimator that saw the readings of later ticks, too; only where there is such
        "note: NAME": what an estimator counted itself, if anything; a NAME that begins with "largest" is a maximum

    Args:
        truth: from `simulate`, of the same stream as the run.
        run: from `run`.
        burn_in: first ticks that do not count.

    Raises:
        BadInput: truth and run are swapped or of different streams, or no tick is left to count.

    """
    demand_same(truth, run)
    if not 0 <= burn_in < truth.x.shape[1]:
        raise BadInput(f"burn_in is {burn_in}; it must lie between 0 and {truth.x.shape[1] - 1}")
    valid = truth.valid.copy()
    valid[:, :burn_in] = False
    frames = [_frame(truth, run, name, trace, valid) for name, trace in run.traces.items()]
    if run.unchecked:
        frames = [frame.assign(certificate=_certificate(run, frame["estimator"].iloc[0])) for frame in frames]
    return pd.concat(frames, ignore_index=True)


def _certificate(run: Run, name: str) -> str:
    if name not in run.unchecked:
        return ""
    learned = run.traces[name].trained_on
    return f"{UNCHECKED}{TRAINED}{learned}" if learned else UNCHECKED


def position_errors(truth: Truth, run: Run, trace: Trace) -> tuple[Array, Array]:
    """Squared position error [m^2] and position NEES (t, T, n) of one trace of a run; nan where the truth is unknown.

    Raises:
        BadInput: truth and run are of different streams.

    """
    demand_same(truth, run)
    return _squared(truth, trace, truth.valid)


def demand_same(truth: object, run: object) -> None:
    """Refuse what is not a truth and a run of the same stream.

    Raises:
        BadInput: the two are swapped, one is of another type, or they are of different streams.

    """
    given = (truth, run)
    if not (isinstance(truth, Truth) and isinstance(run, Run)):
        kinds = [f"the class {one.__name__}" if isinstance(one, type) else type(one).__name__ for one in given]
        raise BadInput(
            f"truth and run are {' and '.join(kinds)}; pass the truth of cl.simulate first, then what cl.run gave"
        )
    if truth.origin != run.hashes:
        raise BadInput(
            f"this truth ({truth.scenario}) and run ({run.scenario}) are of different streams: simulate again"
        )


def _squared(truth: Truth, trace: Trace, valid: Mask) -> tuple[Array, Array]:
    e = np.where(valid[..., None], trace.x[..., :2] - truth.x[..., :2], np.nan)
    nees = _quadratic(e, _covariance(trace)[..., :2, :2])
    return (e**2).sum(-1), np.where(np.isnan(trace.P[..., 0, 0]), np.nan, nees)


def _covariance(trace: Trace) -> Array:
    """Zero where there is none, as of what was computed elsewhere; what is made of it counts as absent there."""
    return np.where(np.isnan(trace.P), 0.0, trace.P)


def _scores(trace: Trace, nees: Array) -> tuple[Array, Array]:
    """-log N(e; 0, P) of the position error [nats], and the area of the 95 % ellipse [m^2], both (t, T, n).

    log 2 pi + (log det P + e' P^-1 e) / 2: a proper score, whose expectation is smallest for the true distribution
    (Gneiting & Raftery, J. American Statistical Association 102, 2007). Infinite where P is singular: a belief in one
    point is never rewarded.
    """
    det = np.linalg.det(_covariance(trace)[..., :2, :2])
    det = np.where(det > 0, det, 0.0)
    known = ~np.isnan(nees)
    with np.errstate(divide="ignore"):
        log_det = np.where(det > 0, np.log(det), 0.0)
    nll = np.where(det > 0, np.log(2 * np.pi) + (log_det + nees) / 2, np.inf)
    return np.where(known, nll, np.nan), np.where(known, np.pi * INSIDE_95 * np.sqrt(det), np.nan)


def _frame(truth: Truth, run: Run, name: str, trace: Trace, valid: Mask) -> pd.DataFrame:
    t, T, n = valid.shape
    d2, nees = _squared(truth, trace, valid)
    nll, area = _scores(trace, nees)
    d = np.sqrt(d2)
    side = float(np.max(truth.arena[1] - truth.arena[0]))
    tail = _over_ticks(np.nanmean, np.where(_last_quarter(valid), d2, np.nan))
    per = {
        "ticks": valid.sum(1),
        "mse": _over_ticks(np.nanmean, d2),
        "mean_error": _over_ticks(np.nanmean, d),
        "median_error": _over_ticks(np.nanmedian, d),
        "max_error": _over_ticks(np.nanmax, d),
        "final_error": _final(d),
        "anees": _over_ticks(np.nanmean, nees) / 2,
        "coverage95": _over_ticks(np.nanmean, np.where(np.isnan(nees), np.nan, nees <= INSIDE_95)),
        "diverged": np.where(np.isnan(tail), np.nan, np.sqrt(tail) > side / 4),
        "pose_nees": _over_ticks(np.nanmean, _pose_nees(truth, trace, valid)) / 3,
        "messages": trace.messages / T,
        "bytes": trace.bytes / T,
        "nll": _over_ticks(np.nanmean, nll),
        "area95": _over_ticks(np.nanmean, area),
    }
    per["rmse"] = np.sqrt(per["mse"])
    who: dict[str, Any] = {
        "scenario": run.scenario,
        "estimator": name,
        "trial": np.repeat(run.trial, n),
        "robot": np.tile(np.arange(n), t),
        "robots": n,
    }
    rest = {"seconds": trace.seconds / (t * T * n), "stream": np.repeat(run.hashes, n)}
    rest |= {"centralised": trace.centralised, "bound": trace.bound, "senses": trace.senses}
    columns = {**who, **{k: np.asarray(v).ravel() for k, v in per.items()}, **rest}
    notes = {NOTE + name: values.ravel() for name, values in trace.notes.items()}
    more = {OFFLINE: True} if trace.offline else {}
    return pd.DataFrame({**{name: columns[name] for name in (*COLUMNS, *SCORES, SENSES)}, **more, **notes})


def _over_ticks(reduce: Any, values: Array) -> Array:
    """Reduce (t, T, n) over the ticks that count; nan where none does."""
    t, _, n = values.shape
    out = np.full((t, n), np.nan)
    some = ~np.isnan(values).all(1)
    if some.any():
        out[some] = reduce(values.swapaxes(1, 2)[some], axis=-1)
    return out


def _quadratic(e: Array, P: Array) -> Array:
    """e' P^-1 e; infinite where P is singular and e is not zero."""
    d = e.shape[-1]
    sound = np.linalg.det(P) > 0
    safe = np.where(sound[..., None, None], P, np.eye(d))
    q: Array = np.einsum("...i,...i->...", e, np.linalg.solve(safe, e[..., None])[..., 0])
    return np.where(sound | np.isnan(q), q, np.where((e == 0).all(-1), 0.0, np.inf))


def _pose_nees(truth: Truth, trace: Trace, valid: Mask) -> Array:
    """e' P^-1 e of position and heading (t, T, n), nan where there is no heading."""
    if truth.x.shape[-1] < 3 or trace.x.shape[-1] < 3:
        return np.full(valid.shape, np.nan)
    e = np.where(valid[..., None], trace.x - truth.x, np.nan)
    e[..., 2] = np.pi - np.mod(np.pi - e[..., 2], 2 * np.pi)
    return np.where(np.isnan(trace.P[..., 0, 0]), np.nan, _quadratic(e, _covariance(trace)))


def _last_quarter(valid: Mask) -> Mask:
    """The last quarter of the ticks that count, per (trial, robot)."""
    count = valid.cumsum(1)
    late: NDArray[np.bool_] = valid & (count > 0.75 * count[:, -1:])
    return late


def _final(d: Array) -> Array:
    """The last value that is there (t, n)."""
    there = ~np.isnan(d)
    last = d.shape[1] - 1 - there[:, ::-1].argmax(1)
    return np.take_along_axis(d, last[:, None], 1)[:, 0]


# ---- rows pooled over the robots of a trial

CELL = ["scenario", "estimator"]
TRIAL = [*CELL, "trial"]
SHOWN = 5  # trials that a refusal names
LARGEST = 1e100  # [m^2] the square of a larger error overflows in a variance


def drop_failed(errors: pd.DataFrame) -> pd.DataFrame:
    """The rows of trials that neither failed nor have an error, of any robot whose truth is known, that is not finite.

    An error that is nan, infinite or beyond `LARGEST` is a failure of the whole trial: left out
    silently it would make the estimator look better, and counted as zero better still.
    """
    lost = (errors["ticks"] > 0) & ~(errors["mse"] < LARGEST)
    if "failure" in errors:
        lost |= errors["failure"].notna()
    return errors[~lost.groupby([errors[key] for key in TRIAL]).transform("any")] if lost.any() else errors


def is_offline(errors: pd.DataFrame) -> "pd.Series[bool]":
    """Whether a row is of an estimator that saw the readings of later ticks, too."""
    return errors[OFFLINE].eq(True) if OFFLINE in errors else pd.Series(False, errors.index)


def note_lines(errors: pd.DataFrame) -> list[str]:
    """What estimators counted, one line each: sums over trials and robots, and maxima of what is called largest."""
    columns = [name for name in errors if str(name).startswith(NOTE)]
    lines = []
    for (scenario, estimator), group in errors.groupby(CELL, sort=False):
        counted = {str(c).removeprefix(NOTE): group[c] for c in columns if group[c].notna().any()}
        said = [f"{name} {v.max() if name.startswith('largest') else v.sum():.3g}" for name, v in counted.items()]
        lines += [f"{scenario}, {estimator}: {', '.join(said)}"] if said else []
    return lines


def trial_means(errors: pd.DataFrame) -> dict[tuple[str, str], pd.DataFrame]:
    """One row per trial that succeeded, by (scenario, estimator): means over robots, weighted by the ticks that count.

    Medians, final and largest errors, and `diverged`, are a robot's: there every robot counts the same. `stream` is
    that of the trial. A cell whose trials all failed has no rows.
    """
    means = _of_trials(drop_failed(errors))
    known = {cell: part.droplevel([0, 1]).sort_index() for cell, part in means.groupby(level=CELL, sort=False)}
    nothing = means.iloc[:0].droplevel([0, 1])
    every = errors[CELL].drop_duplicates().itertuples(index=False, name=None)
    return {(str(s), str(e)): known.get((s, e), nothing) for s, e in every}


def weighted_means(errors: pd.DataFrame, keys: list[str], columns: list[str]) -> pd.DataFrame:
    """Means of columns over the robots of each group, weighted by the ticks that count; index: the keys.

    A robot without such ticks does not count; one that has some, and no value, leaves its group without one.
    """
    groups: list[Any] = [errors[key] for key in keys]
    weight = errors["ticks"] / errors["ticks"].groupby(groups).transform("sum")
    means = errors[columns].mul(weight, axis=0).groupby(groups, sort=False).sum(min_count=1)
    absent = errors[columns].isna() & (errors[["ticks"]].to_numpy() > 0)
    return means.mask(absent.groupby(groups, sort=False).any()) if absent.to_numpy().any() else means


def _of_trials(ended: pd.DataFrame) -> pd.DataFrame:
    """One row per trial of every cell; index: scenario, estimator, trial."""
    scores = [name for name in SCORES if name in ended]  # runs of former versions have none
    out = weighted_means(ended, TRIAL, ["mse", "anees", "coverage95", "mean_error", *scores])
    out = out.reindex(columns=[*out, *(name for name in SCORES if name not in scores)])
    of_robots = ["diverged", "median_error", "final_error", "max_error"]
    groups = ended.groupby(TRIAL, sort=False)
    out[of_robots] = groups[of_robots].mean()
    out["stream"] = groups["stream"].first()
    return out


def demand_same_streams(errors: pd.DataFrame) -> None:
    """Refuse rows that look paired and are not.

    Raises:
        BadInput: estimators ran on different streams, or were judged on different ticks of one; two trials have the
            same stream; or a row stands there twice.

    """
    _demand_once(errors)
    different = errors.groupby(["scenario", "trial"])["stream"].nunique()
    if (different > 1).any():
        scenario, trial = different[different > 1].index[0]
        raise BadInput(f"{scenario}, trial {trial}: estimators ran on different streams; run them again on one stream")
    different = drop_failed(errors).groupby(["scenario", "trial", "robot"])["ticks"].nunique()
    if (different > 1).any():
        scenario, trial, _ = different[different > 1].index[0]
        raise BadInput(f"{scenario}, trial {trial}: estimators were judged on different ticks; use one burn_in for all")


def _demand_once(errors: pd.DataFrame) -> None:
    """Refuse copies of trials, which would count as independent."""
    twice = errors[errors.duplicated([*TRIAL, "robot"])]
    if len(twice):
        scenario, estimator, trial = twice.iloc[0][TRIAL]
        raise BadInput(f"{scenario}, {estimator}, trial {trial} stands there twice: join every run once")
    once = errors.drop_duplicates(["scenario", "stream", "trial"]).dropna(subset="stream")
    copies = once[once.duplicated(["scenario", "stream"], keep=False)]
    if len(copies):
        first = copies.iloc[0]
        same = copies[(copies["scenario"] == first["scenario"]) & (copies["stream"] == first["stream"])]
        raise BadInput(
            f"{first['scenario']}: trials {', '.join(map(str, same['trial'][:SHOWN]))} are of one stream; keep one of "
            "them, or copies would count as independent"
        )


def stream_hash(group: pd.DataFrame) -> str:
    """The hash of a scenario's stream: of the hashes of its trials, as `Stream.hash`."""
    trials = group.drop_duplicates("trial").sort_values("trial")["stream"].dropna()  # none where it was never made
    return hashlib.sha256("".join(trials).encode()).hexdigest()

"""Tables over trials: what each estimator achieves, and how it differs from a baseline on the same streams."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.consistency import CONSERVATIVE as CONSERVATIVE
from cooploc.analysis.metrics.consistency import OVER_CONFIDENT as OVER_CONFIDENT
from cooploc.analysis.metrics.consistency import consistency as consistency
from cooploc.analysis.metrics.errors import NOTE
from cooploc.estimators import nearest
from cooploc.estimators.plugins.errors import BadInput

SUMMARY = {
    "scenario": "the scenario's label",
    "estimator": "the estimator's label",
    "robots": "robots in the team",
    "trials": "trials that ended",
    "rmse": "sqrt of the mean over trials of the trial's mean squared position error [m]",
    "rmse_low": "its 95 % interval over trials",
    "rmse_high": "",
    "anees": "position NEES / 2, per trial first, then over trials",
    "anees_low": "its 95 % interval over trials",
    "anees_high": "",
    "coverage95": "share of truths inside the 95 % ellipse",
    "diverged": "share of (trial, robot) that diverged",
    "failed": "trials that failed",
    "messages": "messages per robot and tick",
    "bytes": "bytes per robot and tick",
    "seconds": "seconds per robot and tick",
    "stream": "hash of the stream",
    "certificate": "what its checks found, in a line; empty of a built-in estimator, and where nobody asked",
}
DETAIL = {
    "coverage95_low": "95 % interval of coverage95, over trials",
    "coverage95_high": "",
    "diverged_low": "95 % interval of diverged, over trials",
    "diverged_high": "",
    "mean_error": "mean Euclidean position error [m]",
    "median_error": "median position error of a robot in a trial, its mean [m]",
    "final_error": "position error at the last tick, its mean [m]",
    "max_error": "largest position error of a robot in a trial, its mean [m]",
}
MARGIN = 0.05  # two estimators whose RMSE differ by less than this share tie


def summarize(errors: pd.DataFrame) -> pd.DataFrame:
    """One row per (scenario, estimator) with the columns of `SUMMARY` and `DETAIL`, in order of appearance.

    Rows with a `failure` (see `cooploc.analysis.execution.execute`) count as failed trials and as nothing else.
    """
    rows = []
    for (scenario, estimator), group in errors.groupby(["scenario", "estimator"], sort=False):
        ended = succeeded(group)
        trials = per_trial(ended)
        mse = statistics.mean_of_positive(trials["mse"].to_numpy())
        anees = statistics.mean_of_positive(trials["anees"].to_numpy())
        row = {
            "scenario": scenario,
            "estimator": estimator,
            "robots": int(group["robots"].iloc[0]),
            "trials": len(trials),
            **dict(zip(("rmse", "rmse_low", "rmse_high"), np.sqrt(mse), strict=True)),
            **dict(zip(("anees", "anees_low", "anees_high"), anees, strict=True)),
            "coverage95": trials["coverage95"].mean(),
            "diverged": ended["diverged"].mean(),
            "failed": group["trial"].nunique() - len(trials),
            **{cost: ended[cost].mean() for cost in ("messages", "bytes", "seconds")},
            "stream": stream_hash(group),
            "certificate": str(group["certificate"].iloc[0]) if "certificate" in group else "",
            **{f"coverage95_{end}": v for end, v in _ends(trials["coverage95"])},
            **{f"diverged_{end}": v for end, v in _ends(trials["diverged"])},
            **{f"{kind}_error": trials[f"{kind}_error"].mean() for kind in ("mean", "median", "final", "max")},
        }
        rows.append(row)
    return pd.DataFrame(rows, columns=[*SUMMARY, *DETAIL])


def compare(errors: pd.DataFrame, baseline: str | Mapping[str, str], margin: float = MARGIN) -> pd.DataFrame:
    """Every estimator against a baseline, or that of its scenario, trial by trial on the same streams.

    Adds to the columns of `SUMMARY` and `DETAIL`:

    - `difference` [m] (mean over trials of RMSE minus the baseline's) with its t interval;
    - `improvement` (1 - RMSE / the baseline's RMSE) with Fieller's interval, `bca_low` and `bca_high` beside it, and
      the other definition of "better by", `ratio` (the baseline's RMSE / RMSE - 1), with the same interval transformed;
    - `p` of the signed-rank test, `p_equal` of the equivalence test (small: the two tie within `margin`), and both
      adjusted by Holm over all rows of the table, `p_holm` and `p_equal_holm`;
    - `effect`, the matched-pairs rank-biserial one (negative: smaller errors than the baseline);
    - `trials_for_margin`: trials at which `improvement` would be known to plus or minus `margin`;
    - `bound`, and the `consistency` flag.

    Args:
        errors: from `errors` or a run directory.
        baseline: an estimator's label, or one for each scenario.
        margin: the share of RMSE by which two estimators may differ and still tie.

    Raises:
        BadInput: the baseline is not there, or rows to be paired are of different streams.

    """
    known = list(dict.fromkeys(errors["estimator"]))
    scenarios = dict.fromkeys(errors["scenario"])
    against = baseline if isinstance(baseline, Mapping) else dict.fromkeys(scenarios, baseline)
    for name in (against[scenario] for scenario in scenarios):
        if name not in known:
            raise BadInput(f"there is no estimator {name!r} to compare with; {nearest(name, known)}")
    demand_same_streams(errors)
    table = summarize(errors)
    table["consistency"] = consistency(table)
    bounds = errors.groupby(["scenario", "estimator"], sort=False)["bound"].any()
    table["bound"] = bounds.to_numpy()
    ended = succeeded(errors).groupby(["scenario", "estimator"], sort=False)
    trials = {(str(s), str(e)): per_trial(group)["mse"] for (s, e), group in ended}
    labels = zip(table["scenario"], table["estimator"], strict=True)
    pairs = pd.DataFrame([_pair(trials, scenario, name, against[scenario], margin) for scenario, name in labels])
    for test in ("p", "p_equal"):
        pairs[f"{test}_holm"] = statistics.holm(pairs[test].to_numpy())
    last = ["stream", "certificate"]
    return pd.concat([table.drop(columns=last), pairs, table[last]], axis=1)


def succeeded(errors: pd.DataFrame) -> pd.DataFrame:
    """The rows of trials that did not fail."""
    return errors[errors["failure"].isna()] if "failure" in errors else errors


def notes(errors: pd.DataFrame) -> list[str]:
    """What estimators counted, one line each: sums over trials and robots, and maxima of what is called largest."""
    columns = [name for name in errors if str(name).startswith(NOTE)]
    lines = []
    for (scenario, estimator), group in errors.groupby(["scenario", "estimator"], sort=False):
        counted = {str(c).removeprefix(NOTE): group[c] for c in columns if group[c].notna().any()}
        told = [f"{name} {v.max() if name.startswith('largest') else v.sum():.3g}" for name, v in counted.items()]
        lines += [f"{scenario}, {estimator}: {', '.join(told)}"] if told else []
    return lines


def per_trial(group: pd.DataFrame) -> pd.DataFrame:
    """One row per trial of one (scenario, estimator): means over its robots, weighted by the ticks that count.

    Medians, final and largest errors, and what diverged, are of a robot: there every robot counts the same.
    """
    weight = group["ticks"] / group.groupby("trial")["ticks"].transform("sum")
    weighted = group[["mse", "anees", "coverage95", "mean_error"]].mul(weight, axis=0)
    out = weighted.groupby(group["trial"]).sum(min_count=1)
    of_robots = ["diverged", "median_error", "final_error", "max_error"]
    out[of_robots] = group[["trial", *of_robots]].groupby("trial").mean()
    out["stream"] = group.groupby("trial")["stream"].first()
    return out


def demand_same_streams(errors: pd.DataFrame) -> None:
    """Refuse rows that look paired and are not.

    Raises:
        BadInput: estimators ran on different streams, or were judged on different ticks of one.

    """
    different = errors.groupby(["scenario", "trial"])["stream"].nunique()
    if (different > 1).any():
        scenario, trial = different[different > 1].index[0]
        raise BadInput(f"{scenario}, trial {trial}: estimators ran on different streams; run them again on one stream")
    different = succeeded(errors).groupby(["scenario", "trial", "robot"])["ticks"].nunique()
    if (different > 1).any():
        scenario, trial, _ = different[different > 1].index[0]
        raise BadInput(f"{scenario}, trial {trial}: estimators were judged on different ticks; use one burn_in for all")


def stream_hash(group: pd.DataFrame) -> str:
    """The hash of a scenario's stream: of the hashes of its trials, as `Stream.hash`."""
    import hashlib

    trials = group.drop_duplicates("trial").sort_values("trial")["stream"]
    return hashlib.sha256("".join(trials).encode()).hexdigest()


def _ends(shares: pd.Series) -> list[tuple[str, float]]:
    interval = statistics.share(shares.dropna().to_numpy(float))
    return [("low", interval.low), ("high", interval.high)]


def _pair(
    trials: dict[tuple[str, str], "pd.Series[float]"], scenario: str, estimator: str, baseline: str, margin: float
) -> dict[str, float | str]:
    none = pd.Series(dtype=float)
    mine, base = (trials.get((scenario, name), none) for name in (estimator, baseline))
    both = pd.concat([base, mine], axis=1, join="inner", keys=["base", "mine"]).dropna()
    a, b = both["base"].to_numpy(), both["mine"].to_numpy()
    gain, n = statistics.improvement(a, b), len(both)
    other = estimator != baseline
    tested = other and n >= statistics.LEAST_TRIALS
    p, effect = statistics.signed_rank(np.sqrt(a), np.sqrt(b)) if tested else (np.nan, np.nan)
    return {
        "baseline": baseline,
        "pairs": n,
        **_named("difference", statistics.mean_difference(np.sqrt(a), np.sqrt(b))),
        **_named("improvement", gain),
        "bca_low": (bca := statistics.improvement_bca(a, b)).low,
        "bca_high": bca.high,
        **_named("ratio", statistics.as_ratio(gain)),
        "p": p,
        "effect": effect,
        "p_equal": statistics.equivalence(np.sqrt(a), np.sqrt(b), margin) if tested else np.nan,
        "trials_for_margin": statistics.trials_for_width(gain, n, margin) if other else np.nan,
    }


def _named(name: str, interval: statistics.Interval) -> dict[str, float]:
    return {name: interval.value, f"{name}_low": interval.low, f"{name}_high": interval.high}

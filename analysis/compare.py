"""Tables over trials: what each estimator achieves, and how it differs from a baseline on the same streams."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from cooploc.analysis import statistics
from cooploc.analysis.errors import NOTE
from cooploc.estimators import nearest
from cooploc.estimators.bad_input import BadInput

OVER_CONFIDENT, CONSERVATIVE = 1.5, 0.67  # ANEES limits: the whole interval must lie beyond

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
}


def summarize(errors: pd.DataFrame) -> pd.DataFrame:
    """One row per (scenario, estimator) with the columns of `SUMMARY`, in order of appearance.

    Rows with a `failure` (see `cooploc.analysis.execute`) count as failed trials and as nothing else.
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
        }
        rows.append(row)
    return pd.DataFrame(rows, columns=list(SUMMARY))


def compare(errors: pd.DataFrame, baseline: str | Mapping[str, str]) -> pd.DataFrame:
    """Every estimator against a baseline, or that of its scenario, trial by trial on the same streams.

    Adds to the columns of `SUMMARY`: `difference` [m] (mean over trials of RMSE minus the baseline's) with its t
    interval, `improvement` (1 - RMSE / the baseline's RMSE) with Fieller's interval, `p` of the signed-rank test and
    `p_holm`, adjusted over all rows of the table, the matched-pairs rank-biserial `effect` (negative: smaller errors
    than the baseline), `bound`, and the `consistency` flag.

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
    pairs = pd.DataFrame(
        [
            _pair(errors, *labels, against[labels[0]])
            for labels in zip(table["scenario"], table["estimator"], strict=True)
        ]
    )
    pairs["p_holm"] = statistics.holm(pairs["p"].to_numpy())
    return pd.concat([table.drop(columns="stream"), pairs, table["stream"]], axis=1)


def consistency(table: pd.DataFrame) -> pd.Series:
    """over-confident, conservative, or consistent, by the 95 % interval of ANEES; "not assessed" below five trials."""
    words = [
        table["anees_low"].isna().to_numpy(),
        (table["anees_low"] > OVER_CONFIDENT).to_numpy(),
        (table["anees_high"] < CONSERVATIVE).to_numpy(),
    ]
    return pd.Series(
        np.select(words, ["not assessed", "over-confident", "conservative"], "consistent"), index=table.index
    )


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
    """One row per trial of one (scenario, estimator): means over its robots, weighted by the ticks that count."""
    weight = group["ticks"] / group.groupby("trial")["ticks"].transform("sum")
    weighted = group[["mse", "anees", "coverage95"]].mul(weight, axis=0)
    out = weighted.groupby(group["trial"]).sum(min_count=1)
    out["stream"] = group.groupby("trial")["stream"].first()
    return out


def demand_same_streams(errors: pd.DataFrame) -> None:
    """Refuse rows that look paired and are not."""
    different = errors.groupby(["scenario", "trial"])["stream"].nunique()
    if (different > 1).any():
        scenario, trial = different[different > 1].index[0]
        raise BadInput(f"{scenario}, trial {trial}: estimators ran on different streams; run them again on one stream")


def stream_hash(group: pd.DataFrame) -> str:
    """The hash of a scenario's stream: of the hashes of its trials, as `Stream.hash`."""
    import hashlib

    trials = group.drop_duplicates("trial").sort_values("trial")["stream"]
    return hashlib.sha256("".join(trials).encode()).hexdigest()


def _pair(errors: pd.DataFrame, scenario: str, estimator: str, baseline: str) -> dict[str, float | str]:
    here = succeeded(errors[errors["scenario"] == scenario])
    mine, base = (per_trial(here[here["estimator"] == name])["mse"] for name in (estimator, baseline))
    both = pd.concat([base, mine], axis=1, join="inner", keys=["base", "mine"]).dropna()
    a, b = both["base"].to_numpy(), both["mine"].to_numpy()
    difference = statistics.mean_difference(np.sqrt(a), np.sqrt(b))
    gain = statistics.improvement(a, b)
    tested = estimator != baseline and len(both) >= statistics.LEAST_TRIALS
    p, effect = statistics.signed_rank(np.sqrt(a), np.sqrt(b)) if tested else (np.nan, np.nan)
    return {
        "baseline": baseline,
        "pairs": len(both),
        **dict(zip(("difference", "difference_low", "difference_high"), difference, strict=True)),
        **dict(zip(("improvement", "improvement_low", "improvement_high"), gain, strict=True)),
        "p": p,
        "effect": effect,
    }

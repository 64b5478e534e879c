"""What tuning alike changed, in sentences."""

import pandas as pd
from scipy import stats

from cooploc.analysis.formats import change, counted, fixed, metres
from cooploc.analysis.report.tuning_tables import gain


def bought(gains: pd.DataFrame) -> str:
    """What tuning bought on training streams and on fresh ones."""
    moved = gains[gains["tuned"] != gains["estimator"]]
    names = moved["estimator"].nunique()
    if not names:
        return "No estimator was moved: none of the configurations that were tried was shown to be better."
    training, fresh = moved["training_gain"].mean(), moved["fresh_gain"].mean()
    lower = moved[(moved["p_holm"] < 0.05) & (moved["change"] < 0)]
    higher = moved[(moved["p_holm"] < 0.05) & (moved["change"] > 0)]
    return (
        f"Tuning moved {names} of {gains['estimator'].nunique()} estimators. Over their "
        f"{counted(len(moved), 'row')} the mean score fell by {fixed(training, 2)} on the training streams and by "
        f"{fixed(fresh, 2)} on fresh ones. RMSE became significantly smaller in {counted(len(lower), 'row')}, "
        f"significantly larger in {len(higher)}; what was made small is the score."
    )


def most_moved(gains: pd.DataFrame, count: int = 3) -> str:
    """Who gained and who lost most on fresh streams."""
    ordered = gains[gains["tuned"] != gains["estimator"]].sort_values("fresh_gain", ascending=False)
    if ordered.empty:
        return ""
    said = [
        f"`{row['estimator']}` in `{row['scenario']}` ({gain(row['fresh_gain'])}, RMSE {change(row['change'])})"
        for row in ordered.to_dict("records")
    ]
    return f"The largest gains on fresh streams: {'; '.join(said[:count])}. The smallest: {said[-1]}."


def by_scenario(gains: pd.DataFrame) -> list[str]:
    """In each scenario the smallest errors before and after, and how alike the two orders are."""
    return [_of_scenario(str(scenario), part) for scenario, part in gains.groupby("scenario", sort=False)]


def _of_scenario(scenario: str, part: pd.DataFrame) -> str:
    whole = part[(part["failed_published"] == 0) & (part["failed_tuned"] == 0)]
    if len(whole) < 2:
        return f"`{scenario}`: fewer than two estimators without failed trials."
    tau = stats.kendalltau(whole["rmse_published"], whole["rmse_tuned"]).statistic
    first, then = (whole.sort_values(f"rmse_{which}").to_dict("records")[0] for which in ("published", "tuned"))
    same = "and when tuned" if first["estimator"] == then["estimator"] else f"tuned it is `{then['estimator']}`"
    return (
        f"`{scenario}`: `{first['estimator']}` has the smallest RMSE as published ({metres(first['rmse_published'])} "
        f"m), {same} ({metres(then['rmse_tuned'])} m); Kendall's tau between the two orders is {fixed(tau, 2)}."
    )

"""Tables of a tuning for readers: as published and tuned, with the gain on training streams and on fresh ones."""

import numpy as np
import pandas as pd
from scipy import stats

from cooploc.analysis.formats import change, count, count_of, decimals, interval, metres, p_value, ratio
from cooploc.analysis.report.tables import Table, number_column, text_column
from cooploc.estimators.registry import parse


def gain(value: float) -> str:
    """Write a difference of scores [nats, or log m], with its sign."""
    return f"{'+' if round(value, 2) > 0 else ''}{decimals(value, 2)}"


def parameters(label: str) -> str:
    """Return a configuration's parameters in words."""
    return ", ".join(f"{key}={value}" for key, value in parse(label)[1].items())


GAINS = (
    text_column("estimator"),
    number_column("RMSE published [m]", "rmse_published", form=metres),
    number_column("tuned [m]", "rmse_tuned", form=metres, second_line=True),
    number_column("change", "change", form=change),
    number_column("95 %", "change_low", "change_high", form=interval(change), second_line=True),
    number_column("p", "p_holm", form=p_value, priority=3),
    number_column("score published", "score_published", form=ratio, priority=5),
    number_column("tuned", "score_tuned", form=ratio, second_line=True, priority=5),
    number_column("ANEES published", "anees_published", form=ratio, priority=4),
    number_column("tuned", "anees_tuned", form=ratio, second_line=True, priority=4),
    number_column("training gain", "training_gain", form=gain),
    number_column("fresh gain", "fresh_gain", form=gain, second_line=True),
    number_column("95 %", "fresh_gain_low", "fresh_gain_high", form=interval(gain), priority=2),
    number_column("rank published", "rank_published", form=count, priority=1),
    number_column("tuned", "rank_tuned", form=count, second_line=True, priority=1),
    number_column("failed", "failed_tuned", form=count),
)
LEGEND = (
    "score: what tuning makes small, mean negative log-likelihood with a robust cap [nats], or log RMSE [log m]. "
    "change: of RMSE by tuning, on the same fresh streams, with its interval; p: Holm over the whole table. "
    "training gain: how much the mean score fell on the streams that the best configuration was chosen on; fresh gain: "
    "on streams that tuning never saw. Where the first is larger, the rest of it was not seen on fresh streams. rank: "
    "by RMSE."
)


def gains_table(scenario: str, part: pd.DataFrame) -> Table:
    """Return one scenario's estimators, by their error as published."""
    ordered = part.sort_values("rmse_published", kind="stable")
    caption = f"{scenario}: {count(part['trials'].max())} fresh trials"
    return Table("tuned", caption, GAINS, ordered.to_dict("records"))


def chosen_table(history: pd.DataFrame, tuned: dict[str, str]) -> Table:
    """Return the chosen parameters of every estimator, and what the search took."""
    rows = [
        {
            "estimator": str(name),
            "tuned": "as published" if tuned[str(name)] == name else parameters(tuned[str(name)]),
            "configurations": len(part),
            "stopped": (part["state"] == "stopped").sum(),
            "trials": part["trials"].sum(),
        }
        for name, part in history.groupby("estimator", sort=False)
    ]
    columns = (
        text_column("estimator"),
        text_column("tuned"),
        *map(number_column, ("configurations", "stopped", "trials")),
    )
    caption = "what was chosen, of how many configurations, how many of them were stopped early, and all their trials"
    return Table("chosen", caption, columns, rows)


def side_by_side(gains: pd.DataFrame) -> Table:
    """Return the estimators of all scenarios by their error as published, and beside by their error as tuned.

    RMSE is the geometric mean over scenarios, the score the plain one; only estimators of every scenario are in it.
    """
    everywhere = gains.groupby("estimator").filter(lambda part: len(part) == gains["scenario"].nunique())
    halves = []
    for which in ("published", "tuned"):
        logs = everywhere.assign(rmse=np.log(everywhere[f"rmse_{which}"]), score=everywhere[f"score_{which}"])
        means = logs.groupby("estimator", sort=False)[["rmse", "score"]].mean()
        means = means.sort_values("rmse", kind="stable").reset_index()
        halves.append(means.assign(rmse=np.exp(means["rmse"])).add_suffix(f"_{which}"))
    rows = pd.concat(halves, axis=1)
    before = {name: k for k, name in enumerate(rows["estimator_published"])}
    rows["place"] = range(1, len(rows) + 1)
    places = [before[name] - k for k, name in enumerate(rows["estimator_tuned"])]
    rows["moved"] = [f"up {n}" if n > 0 else f"down {-n}" if n < 0 else "" for n in places]
    columns = (
        number_column("place"),
        text_column("as published", "estimator_published"),
        number_column("RMSE [m]", "rmse_published", form=metres),
        number_column("score", "score_published", form=ratio),
        text_column("tuned alike", "estimator_tuned"),
        number_column("RMSE [m]", "rmse_tuned", form=metres),
        number_column("score", "score_tuned", form=ratio),
        text_column("moved"),
    )
    return Table(
        "side-by-side", "by RMSE, geometric mean over the worlds; score: mean [nats]", columns, rows.to_dict("records")
    )


def order_sentence(table: pd.DataFrame, by: str) -> str:
    """Return in one sentence how tuning changed the order of all pairs."""
    n, of = len(table), table["became"].value_counts()
    changed = (table["smaller_published"] != table["smaller_tuned"]).sum()
    return (
        f"By {by}, {of.get('reversed', 0)} of {n} pairs of estimators in a scenario are significantly reversed by "
        f"tuning, {of.get('kept', 0)} keep a significant order, {of.get('appeared', 0)} are told apart only when "
        f"tuned, {of.get('vanished', 0)} only as published, {of.get('open', 0)} in neither; significant or not, the "
        f"smaller error changes sides in {changed}."
    )


def gain_sentence(gains: pd.DataFrame) -> str:
    """Return in a few sentences the gain by tuning, on training streams and on fresh ones."""
    moved = gains[gains["tuned"] != gains["estimator"]]
    names = moved["estimator"].nunique()
    if not names:
        return "No estimator was moved: none of the configurations that were tried was shown to be better."
    training, fresh = moved["training_gain"].mean(), moved["fresh_gain"].mean()
    lower = moved[(moved["p_holm"] < 0.05) & (moved["change"] < 0)]
    higher = moved[(moved["p_holm"] < 0.05) & (moved["change"] > 0)]
    return (
        f"Tuning moved {names} of {gains['estimator'].nunique()} estimators. Over their "
        f"{count_of(len(moved), 'row')} the mean score fell by {decimals(training, 2)} on the training streams and by "
        f"{decimals(fresh, 2)} on fresh ones. RMSE became significantly smaller in {count_of(len(lower), 'row')}, "
        f"significantly larger in {len(higher)}; what was made small is the score."
    )


def extremes_sentence(gains: pd.DataFrame) -> str:
    """Return the largest gains and the smallest on fresh streams."""
    ordered = gains[gains["tuned"] != gains["estimator"]].sort_values("fresh_gain", ascending=False)
    if ordered.empty:
        return ""
    said = [
        f"`{row['estimator']}` in `{row['scenario']}` ({gain(row['fresh_gain'])}, RMSE {change(row['change'])})"
        for row in ordered.to_dict("records")
    ]
    return f"The largest gains on fresh streams: {'; '.join(said[:3])}. The smallest: {said[-1]}."


def scenario_sentences(gains: pd.DataFrame) -> list[str]:
    """Return for each scenario the smallest errors before and after, and how alike the two orders are."""
    out = []
    for scenario, part in gains.groupby("scenario", sort=False):
        whole = part[(part["failed_published"] == 0) & (part["failed_tuned"] == 0)]
        if len(whole) < 2:
            out.append(f"`{scenario}`: fewer than two estimators without failed trials.")
            continue
        tau = stats.kendalltau(whole["rmse_published"], whole["rmse_tuned"]).statistic
        first, then = (whole.sort_values(f"rmse_{which}").to_dict("records")[0] for which in ("published", "tuned"))
        same = "and when tuned" if first["estimator"] == then["estimator"] else f"tuned it is `{then['estimator']}`"
        out.append(
            f"`{scenario}`: `{first['estimator']}` has the smallest RMSE as published "
            f"({metres(first['rmse_published'])} m), {same} ({metres(then['rmse_tuned'])} m); Kendall's tau between "
            f"the two orders is {decimals(tau, 2)}."
        )
    return out

"""Values of reports/text/tuned.md.j2 from tunings of `paper-fair` and `paper-fair-mrclam`, and its figures."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

import cooploc as cl
from cooploc.analysis.formats import change, count_of, decimals, metres, ratio
from cooploc.analysis.plot import style
from cooploc.analysis.report import tuning_tables as tables
from cooploc.analysis.report.tables import Table, number_column, text_column
from cooploc.analysis.report.tuning_tables import gain

SHOWN = "ekf-naive"  # the estimator whose parameters are drawn


def values(runs: Path, out: Path, data: Path) -> dict[str, Any]:
    """Return the words of the text, and draw both figures."""
    found = cl.load_tuned(runs / "paper-fair")
    style.save(cl.plot.tuning(found.history), out / "tuned-budget.png")
    style.save(cl.plot.tuned_parameters(found.history, SHOWN), out / "tuned-parameters.png")
    recorded = runs / "paper-fair-mrclam"
    return {
        "budget": found.record["budget"],
        "training_seed": found.record["training_seed"],
        "seed": found.record["seed"],
        "streams": len(found.record["streams"]),
        "by_rmse": tables.order_sentence(found.order("rmse"), "RMSE"),
        "by_nll": tables.order_sentence(found.order("nll"), "score"),
        "bought": gain_sentence(found.table),
        "moved": extremes_sentence(found.table),
        "scenarios": "\n".join(f"- {line}" for line in scenario_sentences(found.table)),
        "side": side_by_side(found.table).markdown(),
        "chosen": tables.chosen_table(found.history, found.tuned).markdown(),
        "legend": tables.LEGEND[0].upper() + tables.LEGEND[1:],
        "tables": "\n".join(tables.gains_table(str(n), part).markdown() for n, part in found.table.groupby("scenario")),
        "real": _recorded(cl.load_tuned(recorded)) if recorded.exists() else None,
    }


def _recorded(found: Any) -> dict[str, Any]:
    return {
        "budget": found.record["budget"],
        "chosen": tables.chosen_table(found.history, found.tuned).markdown(),
        "tables": "\n".join(_one_trial(str(name), part) for name, part in found.table.groupby("scenario")),
    }


def _one_trial(scenario: str, part: pd.DataFrame) -> str:
    """Return a table without the columns that one trial cannot fill."""
    whole = tables.gains_table(scenario, part)
    absent = ("95 %", "p", "rank published", "failed")
    columns = tuple(column for column in tables.GAINS if column.head not in absent and column.keys[0] != "rank_tuned")
    return Table(whole.name, whole.caption, columns, whole.rows).markdown()


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

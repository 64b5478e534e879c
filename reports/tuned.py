"""Values of reports/text/tuned.md.j2 from tunings of `paper-fair` and `paper-fair-mrclam`, and its figures."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

import cooploc as cl
from cooploc.analysis.formats import metres, ratio
from cooploc.analysis.plot import style
from cooploc.analysis.report import result_tables as tables
from cooploc.analysis.report.tables import Table, number_column, text_column, words

SHOWN = "ekf-naive"  # the estimator whose parameters are drawn


def values(runs: Path, out: Path, data: Path) -> dict[str, Any]:
    """Return the words of the text, and draw both figures."""
    found = cl.load_tuned(runs / "paper-fair")
    style.save(cl.plot.tuning(found.history), out / "tuned-budget.png")
    style.save(cl.plot.tuned_parameters(found.history, SHOWN), out / "tuned-parameters.png")
    recorded = runs / "paper-fair-mrclam"
    return {
        **{key: found.record[key] for key in ("budget", "training_seed", "seed")},
        "streams": len(found.record["streams"]),
        "by_rmse": tables.order_sentence(found.order("rmse"), "RMSE"),
        "by_nll": tables.order_sentence(found.order("nll"), "score"),
        "gains": found.table,
        "moved": found.table[found.table["tuned"] != found.table["estimator"]],
        "gain": tables.gain,
        "kendalltau": stats.kendalltau,
        "side": side_by_side(found.table).markdown(),
        "chosen": tables.chosen_table(found.history, found.tuned).markdown(),
        "legend": words("captions")["tuning"][0].upper() + words("captions")["tuning"][1:],
        "tables": "\n".join(tables.gains_table(str(n), part).markdown() for n, part in found.table.groupby("scenario")),
        "real": _recorded(cl.load_tuned(recorded)) if recorded.exists() else None,
    }


def _recorded(found: Any) -> dict[str, Any]:
    """Return the words on a recording, whose tables lack the columns that one trial cannot fill."""
    absent = ("95 %", "p", "rank shipped", "failed")
    columns = tuple(column for column in tables.GAINS if column.head not in absent and column.keys[0] != "rank_tuned")
    wholes = [tables.gains_table(str(name), part) for name, part in found.table.groupby("scenario")]
    return {
        "budget": found.record["budget"],
        "chosen": tables.chosen_table(found.history, found.tuned).markdown(),
        "tables": "\n".join(Table(whole.name, whole.caption, columns, whole.rows).markdown() for whole in wholes),
    }


def side_by_side(gains: pd.DataFrame) -> Table:
    """Return the estimators of all scenarios by their error as shipped, and beside by their error as tuned.

    RMSE is the geometric mean over scenarios, the score the plain one; only estimators of every scenario are in it.
    """
    everywhere = gains.groupby("estimator").filter(lambda part: len(part) == gains["scenario"].nunique())
    halves = []
    for which in ("shipped", "tuned"):
        logs = everywhere.assign(rmse=np.log(everywhere[f"rmse_{which}"]), score=everywhere[f"score_{which}"])
        means = logs.groupby("estimator", sort=False)[["rmse", "score"]].mean()
        means = means.sort_values("rmse", kind="stable").reset_index()
        halves.append(means.assign(rmse=np.exp(means["rmse"])).add_suffix(f"_{which}"))
    rows = pd.concat(halves, axis=1)
    before = {name: k for k, name in enumerate(rows["estimator_shipped"])}
    rows["place"] = range(1, len(rows) + 1)
    places = [before[name] - k for k, name in enumerate(rows["estimator_tuned"])]
    rows["moved"] = [f"up {n}" if n > 0 else f"down {-n}" if n < 0 else "" for n in places]
    columns = (
        number_column("place"),
        text_column("as shipped", "estimator_shipped"),
        number_column("RMSE [m]", "rmse_shipped", form=metres),
        number_column("score", "score_shipped", form=ratio),
        text_column("tuned alike", "estimator_tuned"),
        number_column("RMSE [m]", "rmse_tuned", form=metres),
        number_column("score", "score_tuned", form=ratio),
        text_column("moved"),
    )
    return Table(
        "side-by-side", "by RMSE, geometric mean over the worlds; score: mean [nats]", columns, rows.to_dict("records")
    )

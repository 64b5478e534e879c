"""Values of reports/text/tuned.md.j2 from tunings of `paper-fair` and `paper-fair-mrclam`, and its figures."""

from pathlib import Path
from typing import Any

import pandas as pd

import cooploc as cl
from cooploc.analysis.plot import style
from cooploc.analysis.report import tuning_tables as tables
from cooploc.analysis.report.tables import Table

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
        "bought": tables.gain_sentence(found.table),
        "moved": tables.extremes_sentence(found.table),
        "scenarios": "\n".join(f"- {line}" for line in tables.scenario_sentences(found.table)),
        "side": tables.side_by_side(found.table).markdown(),
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

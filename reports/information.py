"""Values of reports/text/information.md.j2 from the runs of the studies `information` and `sensitivity`, and figures.

Floors take a few minutes.
"""

from pathlib import Path
from typing import Any

import pandas as pd

import cooploc as cl
from cooploc.analysis.execution.run_directory import RunDir
from cooploc.analysis.formats import change, metres, ratio
from cooploc.analysis.plot import results, style
from cooploc.analysis.plot.studies import BETWEEN, OWN, RULES
from cooploc.analysis.report.tables import Table, interval_column, number_column, text_column


def values(runs: Path, out: Path, data: Path) -> dict[str, Any]:
    """Return the words of the text, and draw both figures."""
    found = {}
    for run in (runs / "information", runs / "sensitivity"):
        name, stored = run.name, cl.load_run(run)
        table = getattr(cl, name)(stored)
        style.save(getattr(cl.plot, name)(table), out / f"{name}.svg")
        found[name] = {"trials": table["trials"].max(), "seed": RunDir(Path(stored)).manifest["seed"], "cells": table}
    return {**found, "table": _table(found["information"]["cells"]).markdown(), "parameters": results.SWEPT}


def _table(table: pd.DataFrame) -> Table:
    columns = (
        text_column("own", form=OWN.__getitem__),
        text_column("between", form=BETWEEN.__getitem__),
        number_column("robots"),
        text_column("fusion, filter", "fusion", "filter", form=lambda *rule: RULES[rule][0]),
        interval_column("RMSE [m]", "rmse", metres),
        number_column("floor [m]", "floor", form=metres),
        interval_column("ANEES", "anees", ratio),
        text_column("consistency"),
        interval_column("against alone", "change", change),
    )
    caption = "RMSE and ANEES with 95 % intervals over trials; against alone: change of RMSE against the same filter."
    return Table("information", caption, columns, table.to_dict("records"))

"""Values of reports/text/information.md.j2 from the runs of the studies `information` and `sensitivity`, and figures.

Floors take a few minutes.
"""

from pathlib import Path
from typing import Any

import pandas as pd

import cooploc as cl
from cooploc.analysis.formats import change, metres, ratio
from cooploc.analysis.plot import style
from cooploc.analysis.plot.studies import BETWEEN, OWN, PARAMETERS, RULES
from cooploc.analysis.report import sentences
from cooploc.analysis.report.tables import Table, interval_column, number_column, text_column
from cooploc.api import stored_run


def values(runs: Path, out: Path, data: Path) -> dict[str, Any]:
    """Return the words of the text, and draw both figures."""
    stored = cl.load_run(runs / "information")
    table = cl.information(stored)
    style.save(cl.plot.information(table), out / "information.svg")
    found = []
    for head, (first, *others) in sentences.cooperation_sentences(table):
        found += [f"- **{head}.** {first}", *(f"    - {text}" for text in others)]
    return {
        "trials": table["trials"].max(),
        "seed": stored_run(stored).manifest["seed"],
        "sentences": "\n".join(found),
        "table": _table(table).markdown(),
        "sensitivity": _sensitivity(cl.load_run(runs / "sensitivity"), out),
    }


def _sensitivity(stored: Any, out: Path) -> dict[str, Any]:
    table = cl.sensitivity(stored)
    style.save(cl.plot.sensitivity(table), out / "sensitivity.svg")
    found = []
    for name, text in sentences.dependence_sentences(table):
        head = PARAMETERS.get(name, name)
        found.append(f"- **{head[0].upper()}{head[1:]}.** {text}")
    return {"trials": table["trials"].max(), "seed": stored_run(stored).manifest["seed"], "sentences": "\n".join(found)}


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

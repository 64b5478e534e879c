"""What reports/text/information.md.j2 takes from the runs of the studies `information` and `sensitivity`, and figures.

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
    found = [_list(head, texts) for head, texts in sentences.cooperation_sentences(table)]
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
    heads = {name: PARAMETERS.get(name, name) for name, _ in sentences.dependence_sentences(table)}
    found = [
        f"- **{heads[name][0].upper()}{heads[name][1:]}.** {text}"
        for name, text in sentences.dependence_sentences(table)
    ]
    seed = stored_run(stored).manifest["seed"]
    return {"trials": table["trials"].max(), "seed": seed, "sentences": "\n".join(found)}


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


def _list(head: str, texts: list[str]) -> str:
    """Return the first sentence as an item, and the others as items below it."""
    return "\n".join([f"- **{head}.** {texts[0]}", *(f"    - {text}" for text in texts[1:])])

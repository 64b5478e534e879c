"""The list of studies as a table: `cl.studies()`."""

import re
from typing import TYPE_CHECKING

from cooploc import scenarios as registry
from cooploc.estimators.plugins.listing import source_of
from cooploc.scenarios.studies import study

if TYPE_CHECKING:
    from pandas import DataFrame


def studies() -> "DataFrame":
    """One row per study that is shipped.

    Columns: `name`; `about`, its title and what it asks; `minutes`, how long it takes on two cores, nan where that
    depends on your data; `source`, the papers or data sets that its scenarios come from.
    """
    from pandas import DataFrame

    rows = []
    for one in (study.load(name) for name in study.names()):
        families = dict.fromkeys(re.split(r"[/\[]", cell.scenario)[0] for cell in one.cells())
        sources = dict.fromkeys(source_of(registry.family(name).model_class(name)) for name in families)
        told = "; ".join(filter(None, sources))
        about = ": ".join(filter(None, (one.title, one.about)))
        rows.append({"name": one.name, "about": about, "minutes": one.minutes, "source": told})
    return DataFrame(rows, columns=["name", "about", "minutes", "source"]).astype({"minutes": float})

"""What estimators counted during a run, such as packets that they refused, as a `Table`."""

import pandas as pd

from cooploc.analysis.formats import count
from cooploc.analysis.metrics.errors import NOTE
from cooploc.analysis.report.tables import Row, Table, numbers, words


def events(rows: pd.DataFrame) -> Table:
    """What estimators counted, over all scenarios: sums, and maxima of what is called largest."""
    columns = (
        words("estimator"),
        words("event"),
        numbers("in all", "total", form=_short),
        numbers("scenarios", form=count),
        words("most in", "most"),
    )
    found: list[Row] = []
    for key in (str(name) for name in rows if str(name).startswith(NOTE)):
        event = key.removeprefix(NOTE)
        how = "max" if event.startswith("largest") else "sum"
        known = rows.loc[rows[key].notna(), ["scenario", "estimator", key]]
        for estimator, part in known.groupby("estimator", sort=False):
            each = part.groupby("scenario", sort=False)[key].agg(how)
            some = each[each != 0]
            if len(some):
                total = float(each.agg(how))
                most = str(some.idxmax())
                found.append(
                    {"estimator": estimator, "event": event, "total": total, "scenarios": len(some), "most": most}
                )
    return Table("events", "Events that estimators counted, summed over trials and robots.", columns, found)


def _short(value: float) -> str:
    return f"{value:.3g}"

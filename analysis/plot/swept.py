"""What a figure draws along: a parameter that labels sweep, or a column of the errors."""

import pandas as pd

from cooploc.analysis.metrics.curves import swept
from cooploc.estimators.errors import BadInput, nearest

LEAST = 3  # values from which a sweep is drawn as lines without being asked for


def by_label(table: pd.DataFrame) -> pd.DataFrame | None:
    """The table with `family`, `parameter` and `value`, where its labels are one sweep; else None."""
    read = swept(table)
    one = read["parameter"].iloc[0] and len(read[["family", "parameter"]].drop_duplicates()) == 1
    return read if one and read["value"].nunique() >= LEAST else None


def by_column(errors: pd.DataFrame, table: pd.DataFrame, name: str) -> pd.DataFrame:
    """The table with `family`, `parameter` and `value`, which is that column of the errors.

    Raises:
        BadInput: there is no such column, it holds no numbers, or several scenarios have the same one.

    """
    if name not in errors:
        raise BadInput(f"errors has no column {name!r} to draw over; {nearest(name, [*map(str, errors.columns)])}")
    if not pd.api.types.is_numeric_dtype(errors[name]):
        raise BadInput(f"the column {name!r} does not hold numbers, so nothing can be drawn over it")
    values = errors.groupby("scenario", sort=False)[name].agg(["first", "nunique"])
    if (values["nunique"] != 1).any() or values["first"].duplicated().any():
        raise BadInput(f"a line over {name!r} needs one scenario for each of its values: select them")
    families = dict.fromkeys(label.partition("/")[0].partition("[")[0] for label in table["scenario"])
    return table.assign(family=", ".join(families), parameter=name, value=table["scenario"].map(values["first"]))

"""What readings are worth: own readings by readings between robots, for every rule of fusion, in one table.

Each estimator of a run belongs into a cell: what it reads of the anchors, what of teammates, and how it fuses the two.
What cooperation buys is a difference inside one row of that matrix: the same filter with the same own readings, with
and without teammates, on the same streams.
"""

from typing import Any, NamedTuple

import pandas as pd

from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.crlb import pooled_floor
from cooploc.estimators import configure, make
from cooploc.estimators.plugins.errors import BadInput

OWN = {"none": (), "doa": ("anchor_doa",), "gradient": ("anchor_gradient",), "rssi": ("anchor_rssi",)}
BETWEEN = {"none": (), "rssi": ("radio_rssi",), "range": ("radio_range",)}
RULES = {  # method -> how it fuses, and the filter that it builds on
    "arl": ("alone", "particles"),
    "rssi-pf": ("alone", "particles"),
    "ekf-local": ("alone", "Kalman"),
    "mrsl-rssi": ("product", "particles"),
    "mrsl-distance": ("product", "particles"),
    "ctrn": ("intersection", "particles"),
    "ekf-ci": ("intersection", "Kalman"),
    "ekf-joint": ("centralised", "Kalman"),
    "map-joint": ("bound", "MAP"),
}
COLUMNS = (
    *("own", "between", "robots", "fusion", "filter", "estimator", "scenario", "trials"),
    *("rmse", "rmse_low", "rmse_high", "floor", "anees", "anees_low", "anees_high", "consistency"),
    *("centralised", "bound", "certificate", "change", "change_low", "change_high"),
)


class Cell(NamedTuple):
    """Where an estimator stands in the matrix."""

    own: str  # a key of OWN
    between: str  # a key of BETWEEN
    fusion: str  # alone, product, intersection, centralised or bound
    filter: str  # particles, Kalman or MAP


def cell(estimator: str, robots: int) -> Cell | None:
    """The cell of an estimator in a team of so many robots; None where it has none."""
    name = configure(estimator).name
    if name not in RULES:
        return None
    made, (fusion, kind) = make(estimator), RULES[name]
    own, between = made.anchor_reading, getattr(made, "reading", "none")
    if own not in OWN or between not in BETWEEN or (robots == 1 and between != "none"):
        return None
    return Cell(own, between, fusion, kind)


def information(errors: pd.DataFrame, seed: int) -> pd.DataFrame:
    """The matrix of information: one row per scenario and estimator that has a cell in it.

    Columns:
        own: what is read of the anchors: "none", "doa" (the direction), "gradient" or "rssi" (the raw readings)
        between: what is read of teammates: "none", "rssi" or "range"
        robots: robots in the team
        fusion: "alone", "product" of beliefs, covariance "intersection", "centralised", or the "bound"
        filter: that the rule builds on: "particles", "Kalman", or "MAP" for the bound
        estimator, scenario, trials, rmse, rmse_low, rmse_high, anees, anees_low, anees_high, consistency, centralised,
            bound, certificate: as of `compare`
        floor [m]: the Cramer-Rao floor, given odometry and the readings of this cell alone, over at most 20 trials; in
            the row "doa" given angles alone: a Kalman filter there weighs each angle by its gradient's strength too,
            and only the floor of the row "gradient" holds for it; nan where there is none
        change: RMSE / the RMSE of the same filter with the same own readings and no teammates - 1
        change_low, change_high: its 95 % interval (Fieller), over paired trials; nan for those that are alone

    Args:
        errors: the rows of a run.
        seed: of the run, whose streams the floors are of.

    Raises:
        BadInput: no estimator has a cell.

    """
    pairs = errors.drop_duplicates(["scenario", "estimator"])[["scenario", "estimator", "robots"]].to_dict("records")
    cells = {(row["scenario"], row["estimator"]): cell(row["estimator"], row["robots"]) for row in pairs}
    keys = pd.Series(list(zip(errors["scenario"], errors["estimator"], strict=True)), index=errors.index)
    found = [(key, where) for key, where in cells.items() if where is not None]
    if not found:
        known = ", ".join(RULES)
        raise BadInput(f"no estimator of this run has a cell in the matrix; run the study information, or {known}")
    parts = []
    for scenario, own, kind in dict.fromkeys((key[0], where.own, where.filter) for key, where in found):
        mine = {k: c for k, c in found if (k[0], c.own, c.filter) == (scenario, own, kind)}
        parts.append(_against_alone(errors[keys.isin(mine)], {key[1]: where for key, where in mine.items()}))
    table = pd.concat(parts, ignore_index=True)
    table["floor"] = [_floor(row, seed) for row in table.to_dict("records")]
    return _sorted(table)[list(COLUMNS)]


def _against_alone(rows: pd.DataFrame, cells: dict[str, Cell]) -> pd.DataFrame:
    """The rows of one scenario, own reading and filter; changes against the one without teammates."""
    alone = [name for name, where in cells.items() if where.between == "none"]
    table = compare(rows, alone[0] if alone else next(iter(cells)), full=True)
    placed = pd.DataFrame([cells[name] for name in table["estimator"]], columns=Cell._fields, index=table.index)
    nothing = (placed["between"] == "none") | (not alone)
    table[["change", "change_low", "change_high"]] = table[["change", "change_low", "change_high"]].mask(nothing)
    return pd.concat([placed, table], axis=1)


def _floor(row: dict[Any, Any], seed: int) -> float:
    return pooled_floor(row["scenario"], seed, (*OWN[row["own"]], *BETWEEN[row["between"]]))


def _sorted(table: pd.DataFrame) -> pd.DataFrame:
    """By own reading, robots, reading between, rule and filter, each in the order in which it is listed above."""
    by = pd.DataFrame({"own": pd.Categorical(table["own"], list(OWN)), "robots": table["robots"]}, index=table.index)
    by["between"] = pd.Categorical(table["between"], list(BETWEEN))
    for k, name in enumerate(("fusion", "filter")):
        by[name] = pd.Categorical(table[name], list(dict.fromkeys(rule[k] for rule in RULES.values())))
    order = by.sort_values([str(name) for name in by], kind="stable").index
    return table.loc[order].reset_index(drop=True)

"""Tables of runs for two questions: the worth of each reading, and the parameters that results depend on.

*Information* sets own readings against readings between robots, for every rule of fusion; *sensitivity* has a panel for
each swept parameter.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.crlb import floors, pooled_floor
from cooploc.analysis.metrics.errors import CELL
from cooploc.analysis.metrics.sweeps import add_sweep, sweeps
from cooploc.estimators import configure, make
from cooploc.estimators.errors import BadInput
from cooploc.scenarios import ASSUMED, resolve

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
INFORMATION_COLUMNS = (
    *("own", "between", "robots", "fusion", "filter", "estimator", "scenario", "trials"),
    *("rmse", "rmse_low", "rmse_high", "floor", "anees", "anees_low", "anees_high", "consistency"),
    *("centralised", "bound", "certificate", "change", "change_low", "change_high", "decisive_trial"),
)


class MatrixCell(NamedTuple):
    """The place of an estimator in the matrix of information: keys of OWN and BETWEEN, and the entry of RULES."""

    own: str
    between: str
    fusion: str
    filter: str


@cache
def matrix_cell(estimator: str, robots: int) -> MatrixCell | None:
    """Return the cell of an estimator in a team of so many robots; None where it has none."""
    name = configure(estimator).name
    if name not in RULES:
        return None
    made, (fusion, kind) = make(estimator), RULES[name]
    own, between = made.anchor_reading, getattr(made, "reading", "none")
    if own not in OWN or between not in BETWEEN or (robots == 1 and between != "none"):
        return None
    return MatrixCell(own, between, fusion, kind)


def information(errors: pd.DataFrame, seed: int) -> pd.DataFrame:
    """Return the matrix of information: one row per scenario and estimator that has a cell in it.

    Columns, besides those that `compare` has, too:
        own: what is read of the anchors: "none", "doa" (the direction), "gradient" or "rssi" (the raw readings)
        between: what is read of teammates: "none", "rssi" or "range"
        fusion: "alone", "product" of beliefs, covariance "intersection", "centralised", or the "bound"
        filter: that the rule builds on: "particles", "Kalman", or "MAP" for the bound
        floor [m]: the Cramer-Rao floor of the streams of this seed, given odometry and the readings of this cell alone;
            for "doa" given angles alone, not for a Kalman filter that weighs each by its gradient
        change: of RMSE, against the same filter with the same own readings and no teammates

    Raises:
        BadInput: no estimator has a cell.

    """
    found: dict[tuple[str, str, str], dict[int, MatrixCell]] = {}
    for i, (scenario, estimator, robots) in enumerate(errors[[*CELL, "robots"]].itertuples(index=False)):
        if cell := matrix_cell(estimator, robots):
            found.setdefault((scenario, cell.own, cell.filter), {})[i] = cell
    if not found:
        raise BadInput(f"no estimator here has a cell in the matrix; run the study information, or {', '.join(RULES)}")
    table = pd.concat([_against_alone(errors.iloc[list(mine)], mine) for mine in found.values()], ignore_index=True)
    channels = [(*OWN[own], *BETWEEN[between]) for own, between in zip(table["own"], table["between"], strict=True)]
    table["floor"] = [pooled_floor(s, seed, used) for s, used in zip(table["scenario"], channels, strict=True)]
    fusions, filters = (list(dict.fromkeys(names)) for names in zip(*RULES.values(), strict=True))
    order = {"own": list(OWN), "robots": None, "between": list(BETWEEN), "fusion": fusions, "filter": filters}
    ranks = pd.DataFrame({k: pd.Categorical(table[k], v).codes if v else table[k] for k, v in order.items()})
    by = ranks.sort_values(list(order), kind="stable").index
    return table.loc[by].reset_index(drop=True)[list(INFORMATION_COLUMNS)]


def _against_alone(rows: pd.DataFrame, cells: dict[int, MatrixCell]) -> pd.DataFrame:
    """Return the rows of one scenario, own reading and filter, with changes against the one without teammates."""
    by_name = dict(zip(rows["estimator"], cells.values(), strict=True))
    alone = [name for name, where in by_name.items() if where.between == "none"]
    table = compare(rows, alone[0] if alone else next(iter(by_name)), full=True)
    placed = pd.DataFrame([by_name[name] for name in table["estimator"]], columns=MatrixCell._fields, index=table.index)
    changes = ["change", "change_low", "change_high", "decisive_trial"]
    table[changes] = table[changes].mask((placed["between"] == "none") | (not alone))
    return pd.concat([placed, table], axis=1)


# ---- sensitivity

SENSITIVITY_COLUMNS = (
    *("parameter", "value", "preset", "estimator", "scenario", "robots", "trials", "rmse", "rmse_low", "rmse_high"),
    *("floor", "anees", "anees_low", "anees_high", "consistency", "centralised", "bound", "certificate"),
    *("change", "change_low", "change_high"),
)


def sensitivity(errors: pd.DataFrame, seed: int, baseline: str = "arl") -> pd.DataFrame:
    """Return one row per swept parameter, value and estimator; parameters in the order of the run.

    Columns, besides those that `compare` has, too:
        parameter: what is swept, of the scenario ("prior_sigma"; "assumed.eta" is what the team assumes of eta) or of
            the estimators ("particles")
        value: that of the parameter
        preset: the parameter's value where it is not swept
        estimator, scenario: without what is swept
        floor [m]: the Cramer-Rao floor of all readings in the streams of this seed; nan where none holds
        change: of RMSE, against the baseline's at the same value

    Raises:
        BadInput: nothing is swept, or the baseline was not run at some value.

    """
    parts, points = [], sweeps(errors["scenario"])
    for label, at in points.items():
        rows = errors[errors["scenario"] == label]
        read = rows.assign(**at._asdict()) if at.parameter else add_sweep(rows, "estimator")
        groups: Any = read[read["parameter"] != ""].groupby(["parameter", "value"], sort=False)
        for (parameter, value), part in groups:
            named = part if at.parameter else part.assign(estimator=part["family"])
            found = compare(named, baseline, full=True).assign(scenario=at.family, parameter=parameter, value=value)
            found["preset"] = [preset_value(parameter, at.family, one) for one in found["estimator"]]
            parts.append(found.assign(floor=label))
    if not parts:
        raise BadInput("nothing is swept here: no labels differ in one number alone; run the study sensitivity")
    table = pd.concat(parts, ignore_index=True)
    lowest = floors(list(table["floor"].unique()), seed)
    return table.assign(floor=table["floor"].map(lowest))[list(SENSITIVITY_COLUMNS)]


def preset_value(parameter: str, scenario: str, estimator: str) -> float:
    """Return the value of a parameter of a scenario, or else of an estimator, where it is not swept; nan: none."""
    name, one = parameter.removeprefix(ASSUMED), resolve(scenario).model
    return float(getattr(one, name, np.nan) if hasattr(one, name) else getattr(make(estimator), name, np.nan))

"""Tables of runs that were designed for a question: what readings are worth, and what results depend on.

*Information*: own readings by readings between robots, for every rule of fusion. Each estimator of a run belongs into a
cell: what it reads of the anchors, what of teammates, and how it fuses the two. What cooperation buys is a difference
inside one row of that matrix: the same filter with the same own readings, with and without teammates, on the same
streams.

*Sensitivity*: one panel per swept parameter, of a scenario or of the estimators.
"""

from typing import Any, NamedTuple

import pandas as pd

from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.crlb import floors, pooled_floor
from cooploc.estimators import configure, make, parse
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
    *("centralised", "bound", "certificate", "change", "change_low", "change_high"),
)


class MatrixCell(NamedTuple):
    """The place of an estimator in the matrix of information."""

    own: str  # a key of OWN
    between: str  # a key of BETWEEN
    fusion: str  # alone, product, intersection, centralised or bound
    filter: str  # particles, Kalman or MAP


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
    cells = {(row["scenario"], row["estimator"]): matrix_cell(row["estimator"], row["robots"]) for row in pairs}
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
    return _sort_matrix(table)[list(INFORMATION_COLUMNS)]


def _against_alone(rows: pd.DataFrame, cells: dict[str, MatrixCell]) -> pd.DataFrame:
    """Return the rows of one scenario, own reading and filter, with changes against the one without teammates."""
    alone = [name for name, where in cells.items() if where.between == "none"]
    table = compare(rows, alone[0] if alone else next(iter(cells)), full=True)
    placed = pd.DataFrame([cells[name] for name in table["estimator"]], columns=MatrixCell._fields, index=table.index)
    nothing = (placed["between"] == "none") | (not alone)
    table[["change", "change_low", "change_high"]] = table[["change", "change_low", "change_high"]].mask(nothing)
    return pd.concat([placed, table], axis=1)


def _floor(row: dict[Any, Any], seed: int) -> float:
    return pooled_floor(row["scenario"], seed, (*OWN[row["own"]], *BETWEEN[row["between"]]))


def _sort_matrix(table: pd.DataFrame) -> pd.DataFrame:
    """Sort by own reading, robots, reading between, rule and filter, each in the order in which it is listed above."""
    by = pd.DataFrame({"own": pd.Categorical(table["own"], list(OWN)), "robots": table["robots"]}, index=table.index)
    by["between"] = pd.Categorical(table["between"], list(BETWEEN))
    for k, name in enumerate(("fusion", "filter")):
        by[name] = pd.Categorical(table[name], list(dict.fromkeys(rule[k] for rule in RULES.values())))
    order = by.sort_values([str(name) for name in by], kind="stable").index
    return table.loc[order].reset_index(drop=True)


# ---- sensitivity

OF_ESTIMATORS = "particles"  # the parameter of estimators that makes a panel
SENSITIVITY_COLUMNS = (
    *("parameter", "value", "preset", "estimator", "scenario", "robots", "trials", "rmse", "rmse_low", "rmse_high"),
    *("floor", "anees", "anees_low", "anees_high", "consistency", "centralised", "bound", "certificate"),
    *("change", "change_low", "change_high"),
)


class Sweep(NamedTuple):
    """The swept parameter of a row of a run."""

    scenario: str  # without what is swept
    parameter: str
    value: float
    estimator: str  # without what is swept


def parse_sweep(scenario: str, estimator: str) -> Sweep | None:
    """Return what a row of a run sweeps: the one number in brackets of its scenario, or its estimator's `particles`."""
    path, written = parse(scenario)
    if len(written) == 1:
        ((parameter, value),) = written.items()
        return Sweep(path, parameter, float(value), estimator) if _is_number(value) else None
    name, parameters = parse(estimator)
    if written or OF_ESTIMATORS not in parameters:
        return None
    value = parameters.pop(OF_ESTIMATORS)
    rest = ",".join(f"{key}={each}" for key, each in parameters.items())
    return Sweep(path, OF_ESTIMATORS, float(value), f"{name}[{rest}]" if rest else name)


def sensitivity(errors: pd.DataFrame, seed: int, baseline: str = "arl") -> pd.DataFrame:
    """Return one row per swept parameter, value and estimator; parameters in the order of the run.

    Columns:
        parameter: what is swept, of the scenario ("prior_sigma"; "assumed.eta" is what the team assumes of eta) or of
            the estimators ("particles")
        value: that of the parameter
        preset: the parameter's value where it is not swept
        estimator, scenario: without what is swept
        robots, trials, rmse, rmse_low, rmse_high, anees, anees_low, anees_high, consistency, centralised, bound,
            certificate: as of `compare`
        floor [m]: the Cramer-Rao floor of all readings, over at most 20 trials; nan where none holds
        change: RMSE / the baseline's RMSE at the same value - 1
        change_low, change_high: its 95 % interval (Fieller), over paired trials

    Args:
        errors: the rows of a run.
        seed: of the run, whose streams the floors are of.
        baseline: the estimator that others are compared with.

    Raises:
        BadInput: nothing is swept, or the baseline was not run at some value.

    """
    pairs = errors.drop_duplicates(["scenario", "estimator"])[["scenario", "estimator"]].to_dict("records")
    found = {(row["scenario"], row["estimator"]): parse_sweep(row["scenario"], row["estimator"]) for row in pairs}
    keys = list(zip(errors["scenario"], errors["estimator"], strict=True))
    parts = []
    for label, parameter, value in dict.fromkeys((key[0], s.parameter, s.value) for key, s in found.items() if s):
        mine = {k: s for k, s in found.items() if s and (k[0], s.parameter, s.value) == (label, parameter, value)}
        where, rows = next(iter(mine.values())), errors[[key in mine for key in keys]]
        rows = rows.assign(estimator=[mine[label, name].estimator for name in rows["estimator"]])
        table = compare(rows, baseline, full=True)
        swept: dict[str, Any] = {
            "parameter": parameter,
            "value": value,
            "preset": preset_value(where),
            "floor": floors([label], seed)[label],
        }
        parts.append(table.assign(scenario=where.scenario, **swept))
    if not parts:
        raise BadInput("nothing is swept here: no scenario has one number in brackets; run the study sensitivity")
    return pd.concat(parts, ignore_index=True)[list(SENSITIVITY_COLUMNS)]


def preset_value(where: Sweep) -> float:
    """Return the value of the parameter where it is not swept."""
    if where.parameter == OF_ESTIMATORS:
        return float(getattr(make(where.estimator), OF_ESTIMATORS))
    model: Any = resolve(where.scenario).model
    return float(getattr(model, where.parameter.removeprefix(ASSUMED)))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True

"""How results depend on what is swept: one panel per parameter, of a scenario or of the estimators."""

from typing import Any, NamedTuple

import pandas as pd

from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.crlb import floors
from cooploc.estimators import make, parse
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios import ASSUMED, resolve

OF_ESTIMATORS = "particles"  # the parameter of estimators that makes a panel
COLUMNS = (
    *("parameter", "value", "preset", "estimator", "scenario", "robots", "trials", "rmse", "rmse_low", "rmse_high"),
    *("floor", "anees", "anees_low", "anees_high", "consistency", "centralised", "bound", "certificate"),
    *("change", "change_low", "change_high"),
)


class Sweep(NamedTuple):
    """Where a row of a run stands."""

    scenario: str  # without what is swept
    parameter: str
    value: float
    estimator: str  # without what is swept


def sweep(scenario: str, estimator: str) -> Sweep | None:
    """What a row of a run sweeps: the one number in brackets of its scenario, or `particles` of its estimator."""
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
    """One row per swept parameter, value and estimator; parameters in the order of the run.

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
    found = {(row["scenario"], row["estimator"]): sweep(row["scenario"], row["estimator"]) for row in pairs}
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
            "preset": preset(where),
            "floor": floors([label], seed)[label],
        }
        parts.append(table.assign(scenario=where.scenario, **swept))
    if not parts:
        raise BadInput("nothing is swept here: no scenario has one number in brackets; run the study sensitivity")
    return pd.concat(parts, ignore_index=True)[list(COLUMNS)]


def preset(where: Sweep) -> float:
    """The value of the parameter where it is not swept."""
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

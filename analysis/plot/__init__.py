"""The figures of `cl.plot`. Each takes and returns matplotlib Axes."""

from cooploc.analysis.plot.animation import animate
from cooploc.analysis.plot.claims_forest import claims
from cooploc.analysis.plot.ellipses import anees, ellipses, error_over_time, trajectories
from cooploc.analysis.plot.information_matrix import information
from cooploc.analysis.plot.pareto import pareto
from cooploc.analysis.plot.readings_map import readings
from cooploc.analysis.plot.residuals import residuals
from cooploc.analysis.plot.sensitivity_panels import sensitivity
from cooploc.analysis.plot.specification_curve import specification_curve
from cooploc.analysis.plot.summary import rmse, tradeoff
from cooploc.analysis.plot.tuning import tuned_parameters, tuning
from cooploc.analysis.plot.world import world

__all__ = [
    "anees",
    "animate",
    "claims",
    "ellipses",
    "error_over_time",
    "information",
    "pareto",
    "readings",
    "residuals",
    "rmse",
    "sensitivity",
    "specification_curve",
    "tradeoff",
    "trajectories",
    "tuned_parameters",
    "tuning",
    "world",
]


def __dir__() -> list[str]:
    return __all__

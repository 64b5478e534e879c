"""The figures of `cl.plot`. Each takes and returns matplotlib Axes."""

from cooploc.analysis.plot.beliefs import anees, animate, ellipses, error_over_time, trajectories
from cooploc.analysis.plot.ledgers import claims, readings, specification_curve
from cooploc.analysis.plot.results import pareto, rmse, tradeoff
from cooploc.analysis.plot.studies import information, sensitivity, tuned_parameters, tuning
from cooploc.analysis.plot.worlds import residuals, world

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

"""cooploc compares estimators for multi-robot cooperative localization fairly.

    import cooploc as cl
    truth, stream = cl.simulate("packet-drop/drop=0.7", trials=20, seed=1)
    run = cl.run({"arl": cl.make("arl"), "mrsl": cl.make("mrsl-rssi", particles=500)}, stream)
    errors = cl.errors(truth, run)
    cl.compare(errors, baseline="arl")
    cl.plot.rmse(errors)

Names are imported when they are first used, so that `cooploc --help` does not wait for pandas.
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cooploc.analysis import plot as plot
    from cooploc.analysis.metrics.compare import compare as compare
    from cooploc.analysis.metrics.compare import summarize as summarize
    from cooploc.analysis.metrics.errors import errors as errors
    from cooploc.analysis.metrics.tum import to_tum as to_tum
    from cooploc.estimators import make as make
    from cooploc.estimators.interface import Belief as Belief
    from cooploc.estimators.interface import Estimator as Estimator
    from cooploc.estimators.interface import Mail as Mail
    from cooploc.estimators.interface import Rows as Rows
    from cooploc.estimators.interface import Senses as Senses
    from cooploc.estimators.interface import TeamEstimator as TeamEstimator
    from cooploc.estimators.interface import Traffic as Traffic
    from cooploc.estimators.interface import World as World
    from cooploc.estimators.per_robot import PerRobot as PerRobot
    from cooploc.estimators.plugins.errors import BadInput as BadInput
    from cooploc.scenarios import simulate as simulate
    from cooploc.scenarios.conformance.check import check_estimator as check_estimator
    from cooploc.scenarios.runner.channels import IncompatibleEstimator as IncompatibleEstimator
    from cooploc.scenarios.runner.run import Run as Run
    from cooploc.scenarios.runner.run import run as run
    from cooploc.scenarios.runner.tick import EstimatorError as EstimatorError
    from cooploc.scenarios.stream import Stream as Stream
    from cooploc.scenarios.stream import Truth as Truth

# name -> the module that holds it, or is it
_HOME = {
    "BadInput": "estimators.plugins.errors",
    **dict.fromkeys(
        ("Belief", "Estimator", "Mail", "Rows", "Senses", "TeamEstimator", "Traffic", "World"), "estimators.interface"
    ),
    "PerRobot": "estimators.per_robot",
    "make": "estimators",
    "simulate": "scenarios",
    "check_estimator": "scenarios.conformance.check",
    "IncompatibleEstimator": "scenarios.runner.channels",
    "EstimatorError": "scenarios.runner.tick",
    **dict.fromkeys(("Run", "run"), "scenarios.runner.run"),
    **dict.fromkeys(("Stream", "Truth"), "scenarios.stream"),
    **dict.fromkeys(("compare", "summarize"), "analysis.metrics.compare"),
    "errors": "analysis.metrics.errors",
    "to_tum": "analysis.metrics.tum",
    "plot": "analysis.plot",
}
__version__ = version("cooploc")


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'cooploc' has no attribute {name!r}")
    module = import_module(f"cooploc.{_HOME[name]}")
    found = module if name == "plot" else getattr(module, name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*_HOME, "__version__"]

"""cooploc compares estimators for multi-robot cooperative localization fairly.

    import cooploc as cl
    truth, stream = cl.simulate("packet-drop/drop=0.7", trials=20, seed=1)
    run = cl.run(["arl", "mrsl-rssi[particles=500]"], stream)
    errors = cl.errors(truth, run)
    cl.compare(errors, baseline="arl")
    cl.plot.rmse(errors)

`cl.estimators()`, `cl.scenarios()` and `cl.studies()` list what there is; `cl.run_study("quick")` runs a whole study.
Names are imported when they are first used, so that `cooploc --help` does not wait for pandas.
"""

from importlib import import_module as _import_module
from importlib.metadata import version as _version
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

if _TYPE_CHECKING:
    from cooploc.analysis import plot as plot
    from cooploc.analysis.metrics.compare import compare as compare
    from cooploc.analysis.metrics.compare import summarize as summarize
    from cooploc.analysis.metrics.errors import errors as errors
    from cooploc.analysis.metrics.external import judge as judge
    from cooploc.analysis.metrics.external import to_tum as to_tum
    from cooploc.analysis.metrics.smoother import Smoother as Smoother
    from cooploc.analysis.metrics.smoother import smoother as smoother
    from cooploc.analysis.tuning.tune import Tuned as Tuned
    from cooploc.analysis.tuning.tune import load_tuned as load_tuned
    from cooploc.analysis.tuning.tune import training as training
    from cooploc.api_runs import information as information
    from cooploc.api_runs import paper as paper
    from cooploc.api_runs import readings as readings
    from cooploc.api_runs import sensitivity as sensitivity
    from cooploc.api_runs import verdicts as verdicts
    from cooploc.api_studies import plan as plan
    from cooploc.api_studies import run_until as run_until
    from cooploc.api_studies import sweep as sweep
    from cooploc.api_studies import tune as tune
    from cooploc.estimators import make as make
    from cooploc.estimators.adapters import PerRobot as PerRobot
    from cooploc.estimators.adapters import PerTeam as PerTeam
    from cooploc.estimators.adapters import motion_of as motion_of
    from cooploc.estimators.adapters import priors_of as priors_of
    from cooploc.estimators.adapters import readings_of as readings_of
    from cooploc.estimators.errors import BadInput as BadInput
    from cooploc.estimators.interface import Belief as Belief
    from cooploc.estimators.interface import Estimator as Estimator
    from cooploc.estimators.interface import Mail as Mail
    from cooploc.estimators.interface import Rows as Rows
    from cooploc.estimators.interface import Senses as Senses
    from cooploc.estimators.interface import TeamEstimator as TeamEstimator
    from cooploc.estimators.interface import Traffic as Traffic
    from cooploc.estimators.interface import World as World
    from cooploc.estimators.model_functions import Layout as Layout
    from cooploc.estimators.registry import CallablePackage as _CallablePackage
    from cooploc.estimators.tunable import tunable as tunable
    from cooploc.inspection import Inspection as Inspection
    from cooploc.inspection import inspect as inspect
    from cooploc.runs import Results as Results
    from cooploc.runs import compare_runs as compare_runs
    from cooploc.runs import load_run as load_run
    from cooploc.runs import report as report
    from cooploc.runs import reproduce as reproduce
    from cooploc.runs import run_study as run_study
    from cooploc.runs import show as show
    from cooploc.scaffold import new_estimator as new_estimator
    from cooploc.scenarios import simulate as simulate
    from cooploc.scenarios.conformance.check import check_estimator as check_estimator
    from cooploc.scenarios.runner.run import Run as Run
    from cooploc.scenarios.runner.run import run as run
    from cooploc.scenarios.runner.tick import EstimatorError as EstimatorError
    from cooploc.scenarios.runner.tick import IncompatibleEstimator as IncompatibleEstimator
    from cooploc.scenarios.runner.trace import Trace as Trace
    from cooploc.scenarios.stream import Stream as Stream
    from cooploc.scenarios.stream import Truth as Truth
    from cooploc.scenarios.studies.study import studies as studies

    estimators: _CallablePackage
    scenarios: _CallablePackage

# name -> the module that it is imported from, when it is first used
_HOME = {
    "simulate": "cooploc.scenarios",
    "Stream": "cooploc.scenarios.stream",
    "Truth": "cooploc.scenarios.stream",
    "run": "cooploc.scenarios.runner.run",
    "Run": "cooploc.scenarios.runner.run",
    "EstimatorError": "cooploc.scenarios.runner.tick",
    "Trace": "cooploc.scenarios.runner.trace",
    "IncompatibleEstimator": "cooploc.scenarios.runner.tick",
    "check_estimator": "cooploc.scenarios.conformance.check",
    "studies": "cooploc.scenarios.studies.study",
    "make": "cooploc.estimators",
    "Belief": "cooploc.estimators.interface",
    "Estimator": "cooploc.estimators.interface",
    "Mail": "cooploc.estimators.interface",
    "Rows": "cooploc.estimators.interface",
    "Senses": "cooploc.estimators.interface",
    "TeamEstimator": "cooploc.estimators.interface",
    "Traffic": "cooploc.estimators.interface",
    "World": "cooploc.estimators.interface",
    "motion_of": "cooploc.estimators.adapters",
    "priors_of": "cooploc.estimators.adapters",
    "readings_of": "cooploc.estimators.adapters",
    "Layout": "cooploc.estimators.model_functions",
    "PerRobot": "cooploc.estimators.adapters",
    "PerTeam": "cooploc.estimators.adapters",
    "BadInput": "cooploc.estimators.errors",
    "errors": "cooploc.analysis.metrics.errors",
    "compare": "cooploc.analysis.metrics.compare",
    "summarize": "cooploc.analysis.metrics.compare",
    "judge": "cooploc.analysis.metrics.external",
    "smoother": "cooploc.analysis.metrics.smoother",
    "Smoother": "cooploc.analysis.metrics.smoother",
    "to_tum": "cooploc.analysis.metrics.external",
    "tunable": "cooploc.estimators.tunable",
    "run_study": "cooploc.runs",
    "load_run": "cooploc.runs",
    "Results": "cooploc.runs",
    "report": "cooploc.runs",
    "compare_runs": "cooploc.runs",
    "reproduce": "cooploc.runs",
    "show": "cooploc.runs",
    "run_until": "cooploc.api_studies",
    "inspect": "cooploc.inspection",
    "Inspection": "cooploc.inspection",
    "paper": "cooploc.api_runs",
    "plan": "cooploc.api_studies",
    "verdicts": "cooploc.api_runs",
    "readings": "cooploc.api_runs",
    "information": "cooploc.api_runs",
    "sensitivity": "cooploc.api_runs",
    "sweep": "cooploc.api_studies",
    "tune": "cooploc.api_studies",
    "Tuned": "cooploc.analysis.tuning.tune",
    "load_tuned": "cooploc.analysis.tuning.tune",
    "training": "cooploc.analysis.tuning.tune",
    "new_estimator": "cooploc.scaffold",
}
_MODULES = {"estimators": "cooploc.estimators", "scenarios": "cooploc.scenarios", "plot": "cooploc.analysis.plot"}

__all__ = [*_HOME, *_MODULES]  # noqa: PLE0604 (strings, as the mappings say)
__version__ = _version("cooploc")


def __getattr__(name: str) -> _Any:
    if name in _MODULES:
        found = _import_module(_MODULES[name])
    elif name in _HOME:
        found = getattr(_import_module(_HOME[name]), name)
    else:
        raise AttributeError(f"module 'cooploc' has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__"]

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
    from cooploc.analysis.metrics.judging import judge as judge
    from cooploc.analysis.metrics.smoother import Smoother as Smoother
    from cooploc.analysis.metrics.smoother import smoother as smoother
    from cooploc.analysis.metrics.tum import to_tum as to_tum
    from cooploc.analysis.tuning.training_streams import training as training
    from cooploc.estimators import make as make
    from cooploc.estimators.interface import Belief as Belief
    from cooploc.estimators.interface import Estimator as Estimator
    from cooploc.estimators.interface import Mail as Mail
    from cooploc.estimators.interface import Rows as Rows
    from cooploc.estimators.interface import Senses as Senses
    from cooploc.estimators.interface import TeamEstimator as TeamEstimator
    from cooploc.estimators.interface import Traffic as Traffic
    from cooploc.estimators.interface import World as World
    from cooploc.estimators.lifting.functions import motion_of as motion_of
    from cooploc.estimators.lifting.functions import priors_of as priors_of
    from cooploc.estimators.lifting.functions import readings_of as readings_of
    from cooploc.estimators.models.layout import Layout as Layout
    from cooploc.estimators.per_robot import PerRobot as PerRobot
    from cooploc.estimators.per_team import PerTeam as PerTeam
    from cooploc.estimators.plugins.callable_package import CallablePackage as _CallablePackage
    from cooploc.estimators.plugins.errors import BadInput as BadInput
    from cooploc.estimators.plugins.tunable import tunable as tunable
    from cooploc.inspection import Inspection as Inspection
    from cooploc.inspection import inspect as inspect
    from cooploc.paper_files import paper as paper
    from cooploc.plans import plan as plan
    from cooploc.run_tables import information as information
    from cooploc.run_tables import sensitivity as sensitivity
    from cooploc.run_verdicts import readings as readings
    from cooploc.run_verdicts import verdicts as verdicts
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
    from cooploc.sweeps import sweep as sweep
    from cooploc.tuned import Tuned as Tuned
    from cooploc.tuned import load_tuned as load_tuned
    from cooploc.tuned import tune as tune
    from cooploc.until_decided import run_until as run_until

    estimators: _CallablePackage
    scenarios: _CallablePackage

# module -> the names that users call; a module without names is one itself
_HOME = {
    "scenarios": ("simulate",),
    "scenarios.stream": ("Stream", "Truth"),
    "scenarios.runner.run": ("run", "Run"),
    "scenarios.runner.tick": ("EstimatorError",),
    "scenarios.runner.trace": ("Trace",),
    "scenarios.runner.channels": ("IncompatibleEstimator",),
    "scenarios.conformance.check": ("check_estimator",),
    "scenarios.studies.listing": ("studies",),
    "estimators": ("make",),
    "estimators.interface": ("Belief", "Estimator", "Mail", "Rows", "Senses", "TeamEstimator", "Traffic", "World"),
    "estimators.lifting.functions": ("motion_of", "priors_of", "readings_of"),
    "estimators.models.layout": ("Layout",),
    "estimators.per_robot": ("PerRobot",),
    "estimators.per_team": ("PerTeam",),
    "estimators.plugins.errors": ("BadInput",),
    "analysis.metrics.errors": ("errors",),
    "analysis.metrics.compare": ("compare", "summarize"),
    "analysis.metrics.judging": ("judge",),
    "analysis.metrics.smoother": ("smoother", "Smoother"),
    "analysis.metrics.tum": ("to_tum",),
    "estimators.plugins.tunable": ("tunable",),
    "runs": ("run_study", "load_run", "Results", "report", "compare_runs", "reproduce", "show"),
    "until_decided": ("run_until",),
    "inspection": ("inspect", "Inspection"),
    "paper_files": ("paper",),
    "plans": ("plan",),
    "run_verdicts": ("verdicts", "readings"),
    "run_tables": ("information", "sensitivity"),
    "sweeps": ("sweep",),
    "tuned": ("tune", "Tuned", "load_tuned"),
    "analysis.tuning.training_streams": ("training",),
    "scaffold": ("new_estimator",),
}
_MODULES = {"estimators": "estimators", "scenarios": "scenarios", "plot": "analysis.plot"}
_PLACES = {name: module for module, names in _HOME.items() for name in names}

__all__ = [*_PLACES, *_MODULES]  # noqa: PLE0604 (strings, as the mappings say)
__version__ = _version("cooploc")


def __getattr__(name: str) -> _Any:
    if name in _MODULES:
        found = _import_module(f"cooploc.{_MODULES[name]}")
    elif name in _PLACES:
        found = getattr(_import_module(f"cooploc.{_PLACES[name]}"), name)
    else:
        raise AttributeError(f"module 'cooploc' has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__"]

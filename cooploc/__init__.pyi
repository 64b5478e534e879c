"""The public names of cooploc, and where each comes from: this file serves type checkers, and `__init__.py` too."""

from cooploc.analysis import plot as plot
from cooploc.analysis.metrics.compare import compare as compare
from cooploc.analysis.metrics.compare import summarize as summarize
from cooploc.analysis.metrics.errors import errors as errors
from cooploc.analysis.metrics.external import judge as judge
from cooploc.analysis.metrics.external import judge_trajectories as judge_trajectories
from cooploc.analysis.metrics.external import to_tum as to_tum
from cooploc.analysis.metrics.smoother import Smoother as Smoother
from cooploc.analysis.metrics.smoother import smoother as smoother
from cooploc.analysis.tuning.tune import Tuned as Tuned
from cooploc.analysis.tuning.tune import load_tuned as load_tuned
from cooploc.analysis.tuning.tune import training as training
from cooploc.api import Results as Results
from cooploc.api import board as board
from cooploc.api import compare_runs as compare_runs
from cooploc.api import information as information
from cooploc.api import load_run as load_run
from cooploc.api import paper as paper
from cooploc.api import plan as plan
from cooploc.api import readings as readings
from cooploc.api import report as report
from cooploc.api import reproduce as reproduce
from cooploc.api import run_study as run_study
from cooploc.api import sensitivity as sensitivity
from cooploc.api import sweep as sweep
from cooploc.api import tune as tune
from cooploc.api import verdicts as verdicts
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
from cooploc.estimators.layout import Layout as Layout
from cooploc.estimators.listing import list_estimators as list_estimators
from cooploc.estimators.registry import CallablePackage as _CallablePackage
from cooploc.estimators.tunable import tunable as tunable
from cooploc.inspection import Inspection as Inspection
from cooploc.inspection import inspect as inspect
from cooploc.scaffold import new_estimator as new_estimator
from cooploc.scenarios import list_scenarios as list_scenarios
from cooploc.scenarios import simulate as simulate
from cooploc.scenarios.conformance import check_estimator as check_estimator
from cooploc.scenarios.runner.run import Run as Run
from cooploc.scenarios.runner.run import run as run
from cooploc.scenarios.runner.tick import EstimatorError as EstimatorError
from cooploc.scenarios.runner.tick import IncompatibleEstimator as IncompatibleEstimator
from cooploc.scenarios.runner.trace import Trace as Trace
from cooploc.scenarios.stream import Stream as Stream
from cooploc.scenarios.stream import Truth as Truth
from cooploc.scenarios.studies.study import list_problems as list_problems
from cooploc.scenarios.studies.study import list_studies as list_studies
from cooploc.terminal.tables import show as show

estimators: _CallablePackage
scenarios: _CallablePackage

__all__: list[str]
__version__: str

"""The figures of `cl.plot`, and the file of each: this serves type checkers, and `__init__.py` too."""

from cooploc.analysis.plot.beliefs import anees as anees
from cooploc.analysis.plot.beliefs import animate as animate
from cooploc.analysis.plot.beliefs import ellipses as ellipses
from cooploc.analysis.plot.beliefs import error_over_time as error_over_time
from cooploc.analysis.plot.beliefs import trajectories as trajectories
from cooploc.analysis.plot.results import pareto as pareto
from cooploc.analysis.plot.results import rmse as rmse
from cooploc.analysis.plot.results import tradeoff as tradeoff
from cooploc.analysis.plot.studies import claims as claims
from cooploc.analysis.plot.studies import information as information
from cooploc.analysis.plot.studies import readings as readings
from cooploc.analysis.plot.studies import sensitivity as sensitivity
from cooploc.analysis.plot.studies import tuned_parameters as tuned_parameters
from cooploc.analysis.plot.studies import tuning as tuning
from cooploc.analysis.plot.worlds import residuals as residuals
from cooploc.analysis.plot.worlds import world as world

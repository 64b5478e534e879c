"""A robot's tick: what an estimator knows in advance, what it senses, and what it receives over the air.

One leading axis `r` holds (trial, robot) rows, trial-major, so an estimator is written once for one robot and runs for
all of them. Robots meet only through mail, which the runner carries. An estimator is a frozen dataclass of parameters
with pure methods; its state is a NamedTuple of arrays, plus `world` and scalars that all rows share.

The order of a tick is predict, correct, send, carry, fuse, estimate. Odometry of tick k covers (k-1, k], readings are
taken at k, and the estimate after `fuse` is compared with the truth at k; the prior is the belief before tick 0.

nan means absent (not sensed, not heard), width 0 means that the channel does not exist. SI units; x points east,
y north, headings are counter-clockwise from x in (-pi, pi].
"""

from cooploc.estimators.interface.protocols import Estimator, OfflineEstimator, S, TeamEstimator
from cooploc.estimators.interface.tick import (
    API,
    HEADER,
    TEAM_PRIOR,
    TOO_NEAR_TO_RANGE,
    Array,
    Belief,
    Indices,
    Keys,
    Mail,
    Mask,
    Rows,
    Senses,
    Traffic,
)
from cooploc.estimators.interface.world import Motion, Sensor, Stacked, World

__all__ = [
    "API",
    "HEADER",
    "TEAM_PRIOR",
    "TOO_NEAR_TO_RANGE",
    "Array",
    "Belief",
    "Estimator",
    "Indices",
    "Keys",
    "Mail",
    "Mask",
    "Motion",
    "OfflineEstimator",
    "Rows",
    "S",
    "Senses",
    "Sensor",
    "Stacked",
    "TeamEstimator",
    "Traffic",
    "World",
]

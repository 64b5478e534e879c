"""A run as an xarray.Dataset with labelled axes: everything that traces have, such as `x` with the axes `BELIEF`.

    data = run.to_xarray()
    data["x"].sel(estimator="arl", robot=0, axis="x").mean("trial").plot()

`P` has `axis` for its rows and `other_axis` for its columns. An estimator's notes are "note: NAME", nan where it has
no note of that name.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from cooploc.estimators.interface import Indices
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.runner.trace import Trace

AXES = ("x", "y", "heading")
BELIEF = ("estimator", "trial", "tick", "robot", "axis")
COUNT = ("estimator", "trial", "robot")


def dataset(traces_by_name: Mapping[str, Trace], trial: Indices, attributes: Mapping[str, Any]) -> xr.Dataset:
    """Every trace of a run, by its estimator's name.

    Args:
        traces_by_name: on the same trials.
        trial: their numbers (t,).
        attributes: of the dataset.

    Raises:
        BadInput: the run has no estimators.

    """
    traces = list(traces_by_name.values())
    if not traces:
        raise BadInput("this run has no estimators, so there is nothing to put into a dataset: run some")
    _, ticks, robots, d = traces[0].x.shape
    variables = {
        "x": (BELIEF, np.stack([t.x for t in traces]), {"long_name": "estimate", "units": "m, m, rad"}),
        "P": ((*BELIEF, "other_axis"), np.stack([t.P for t in traces]), {"long_name": "its covariance"}),
        "messages": (COUNT, np.stack([t.messages for t in traces]), {"long_name": "messages sent"}),
        "bytes": (COUNT, np.stack([t.bytes for t in traces]), {"long_name": "bytes sent", "units": "B"}),
        "seconds": ("estimator", [t.seconds for t in traces], {"long_name": "time taken", "units": "s"}),
        "centralised": ("estimator", [t.centralised for t in traces], {"long_name": "all readings reach one computer"}),
        "bound": ("estimator", [t.bound for t in traces], {"long_name": "bounds all other estimators"}),
        **_notes(traces_by_name),
    }
    coordinates = {
        "estimator": list(traces_by_name),
        "trial": trial,
        "tick": np.arange(ticks),
        "robot": np.arange(robots),
        "axis": list(AXES[:d]),
        "other_axis": list(AXES[:d]),
    }
    return xr.Dataset(variables, coordinates, attributes)


def _notes(traces: Mapping[str, Trace]) -> Mapping[str, Any]:
    """What estimators counted."""
    names = dict.fromkeys(name for trace in traces.values() for name in trace.notes)
    absent = np.full_like(next(iter(traces.values())).messages, np.nan)
    return {
        f"note: {name}": (COUNT, np.stack([trace.notes.get(name, absent) for trace in traces.values()]))
        for name in names
    }

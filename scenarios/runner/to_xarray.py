"""A run as an xarray.Dataset with labelled axes: everything that traces have, such as `x` with the axes `BELIEF`.

    data = run.to_xarray(truth)
    data["error"].sel(estimator="arl", robot=0).mean("trial").plot(x="time")
    data.to_netcdf("run.nc")

`P` has `axis` for its rows and `other_axis` for its columns. An estimator's notes are "note: NAME", nan where it has
no note of that name. Every variable has `units` as CF writes them; where axes differ in theirs, the coordinate `unit`
has that of each axis. What netCDF 3 cannot keep is written otherwise: a large seed as text, a flag as 0 or 1.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.stream import Truth

AXES, UNITS = ("x", "y", "heading"), ("m", "m", "rad")
BELIEF = ("estimator", "trial", "tick", "robot", "axis")
COUNT = ("estimator", "trial", "robot")
LARGEST = 2**31  # above which netCDF 3 has no whole numbers


def dataset(run: Any, truth: Truth | None = None) -> xr.Dataset:
    """Return every trace of a `Run`, by its estimator's name; with the truth, the errors too."""
    traces = list(run.traces.values())
    if not traces:
        raise BadInput("this run has no estimators, so there is nothing to put into a dataset: run some")
    _, ticks, robots, d = traces[0].x.shape
    one_unit, absent = d == 2, np.full_like(traces[0].messages, np.nan)
    variables = {
        "x": (BELIEF, np.stack([t.x for t in traces]), _about("estimate", "m" if one_unit else "")),
        "P": ((*BELIEF, "other_axis"), np.stack([t.P for t in traces]), _about("its covariance", "m2" * one_unit)),
        "messages": (COUNT, np.stack([t.messages for t in traces]), _about("messages sent", "1")),
        "bytes": (COUNT, np.stack([t.bytes for t in traces]), _about("bytes sent", "byte")),
        "seconds": ("estimator", [t.seconds for t in traces], _about("computing time", "s")),
        "centralised": ("estimator", [t.centralised for t in traces], _about("all readings reach one computer")),
        "bound": ("estimator", [t.bound for t in traces], _about("bounds all other estimators")),
        **{
            f"note: {name}": (COUNT, np.stack([t.notes.get(name, absent) for t in traces]))
            for name in dict.fromkeys(name for t in traces for name in t.notes)
        },
        **({} if truth is None else _errors(run, truth)),
    }
    coordinates = {
        "estimator": list(run.traces),
        "trial": run.trial,
        "tick": np.arange(ticks),
        "robot": np.arange(robots),
        "axis": list(AXES[:d]),
        "other_axis": list(AXES[:d]),
        "unit": ("axis", list(UNITS[:d]), _about("unit of an axis")),
        "stream": ("trial", list(run.hashes), _about("hash of the trial's stream")),
        **({} if run.time is None else {"time": ("tick", run.time, _about("end of the tick", "s"))}),
    }
    seed = run.seed if run.seed < LARGEST else str(run.seed)
    return xr.Dataset(variables, coordinates, {"scenario": run.scenario, "seed": seed})


def _errors(run: Any, truth: Truth) -> Mapping[str, Any]:
    """The truth, and how far each estimate is from it."""
    if truth.origin != run.hashes:
        raise BadInput(f"this truth ({truth.scenario}) is not the run's ({run.scenario}): simulate it again")
    d = next(iter(run.traces.values())).x.shape[-1]
    known = np.where(truth.valid[..., None], truth.x, np.nan)
    known = np.concatenate([known, np.full((*known.shape[:-1], max(0, d - known.shape[-1])), np.nan)], -1)[..., :d]
    far = [np.hypot(*np.moveaxis(trace.x[..., :2] - known[..., :2], -1, 0)) for trace in run.traces.values()]
    return {
        "truth": (BELIEF[1:], known, _about("true pose", "m" if d == 2 else "")),
        "error": (BELIEF[:-1], np.stack(far), _about("distance of the estimate from the true position", "m")),
    }


def _about(name: str, units: str = "") -> dict[str, str]:
    return {"long_name": name, "units": units} if units else {"long_name": name}

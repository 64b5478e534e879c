"""A run as an xarray.Dataset with labelled axes: everything that traces have, such as `x` with the axes `BELIEF`.

    data = run.to_xarray(truth)
    data["error"].sel(estimator="arl", robot=0).mean("trial").plot(x="time")
    data.to_netcdf("run.nc")

`P` has `axis` for its rows and `other_axis` for its columns. An estimator's notes are "note: NAME", nan where it has
no note of that name. Every variable has `units` as CF writes them; where axes differ in theirs, the coordinate `unit`
has that of each axis. What netCDF 3 cannot keep is written otherwise: a large seed as text, a flag as 0 or 1.
"""

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
    metres, absent = "m" * (d == 2), np.full_like(traces[0].messages, np.nan)
    variables: dict[str, Any] = {} if truth is None else _errors(run, truth)
    for name, axes, about, units in (
        ("x", BELIEF, "estimate", metres),
        ("P", (*BELIEF, "other_axis"), "its covariance", metres and "m2"),
        ("messages", COUNT, "messages sent", "1"),
        ("bytes", COUNT, "bytes sent", "byte"),
        ("seconds", COUNT[:1], "computing time", "s"),
        ("centralised", COUNT[:1], "all readings reach one computer", ""),
        ("bound", COUNT[:1], "bounds all other estimators", ""),
    ):
        variables[name] = axes, np.stack([getattr(t, name) for t in traces]), _about(about, units)
    for name in dict.fromkeys(name for t in traces for name in t.notes):
        variables[f"note: {name}"] = COUNT, np.stack([t.notes.get(name, absent) for t in traces])
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


def _errors(run: Any, truth: Truth) -> dict[str, Any]:
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

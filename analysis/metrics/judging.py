"""Judging trajectories that were computed elsewhere, as the estimators that run here are judged."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from cooploc.analysis.metrics.errors import errors
from cooploc.analysis.metrics.tum_reading import from_tum
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.runner.tick import EstimatorError
from cooploc.scenarios.runner.trace import Trace, require_covariances
from cooploc.scenarios.stream import Stream, Truth

ELSEWHERE = "not checked: computed elsewhere"  # the certificate of each


def judge(
    truth: Truth,
    stream: Stream,
    estimates: Mapping[str, Trace | str | Path] | str | Path,
    burn_in: int = 0,
    offline: bool = False,
) -> pd.DataFrame:
    """Errors of trajectories that were computed elsewhere: in C++, MATLAB, ROS, from the stream that was saved.

    It is not known which readings they used: their `certificate` is "not checked: computed elsewhere". Where there are
    no covariances, consistency is not assessed, and they do not qualify as best; costs that are not known are nan.

    Args:
        truth: from `simulate`, of the same stream.
        stream: what the others were given.
        estimates: by name, each a `cl.Trace` or a folder of TUM files (`analysis.metrics.tum_reading` says how they
            are called); or one folder that holds such files, or a folder of each.
        burn_in: first ticks that do not count.
        offline: whether they were computed from the readings of all ticks at once, such as by a smoother.

    Returns:
        As `cl.errors`, with `certificate`; join it with the rows of `cl.run` on the same stream by `pd.concat`.

    Raises:
        BadInput: truth and stream do not belong together, or a trajectory does not fit them; says where.

    """
    if isinstance(estimates, str | Path):
        traces = from_tum(estimates, stream)
    else:
        traces = {name: _trace(name, given, stream) for name, given in estimates.items()}
    for name, trace in traces.items():
        _demand_fit(name, trace, stream)
    if offline:
        traces = {name: replace(trace, offline=True, centralised=True) for name, trace in traces.items()}
    run = Run(stream.scenario, stream.seed, stream.trial, stream.hashes, traces)
    return errors(truth, run, burn_in).assign(certificate=ELSEWHERE)


def _trace(name: str, given: Trace | str | Path, stream: Stream) -> Trace:
    if isinstance(given, Trace):
        return given
    found = from_tum(given, stream)
    if len(found) > 1:
        raise BadInput(f"{given} holds {len(found)} folders of trajectories, and {name!r} is one: name one of them")
    return next(iter(found.values()))


def _demand_fit(name: str, trace: Trace, stream: Stream) -> None:
    """Refuse a trace of another shape, with a pose that is not finite, or with what is not a covariance."""
    team, d = (len(stream.trial), len(stream.time), stream.robots), trace.x.shape[-1]
    axes = {"x": (*team, d), "P": (*team, d, d), "messages": team[::2], "bytes": team[::2]}
    for what, wanted in axes.items():
        if np.shape(getattr(trace, what)) != wanted or d not in (2, 3):
            raise BadInput(
                f"{name}: {what} has shape {np.shape(getattr(trace, what))}, not {wanted}; poses x are (trial, tick, "
                f"robot, 2 or 3), and this stream has {team[0]} trials, {team[1]} ticks, {team[2]} robots"
            )
    told = {"pose": trace.x} if np.isnan(trace.P).all() else {"pose": trace.x, "covariance": trace.P}
    for what, array in told.items():
        bad = ~np.isfinite(array).reshape(*team, -1).all(-1)
        if bad.any():
            i, k, robot = np.argwhere(bad)[0]
            where = f"robot {robot} in trial {stream.trial[i]}, tick {k}"
            raise BadInput(f"{name}: the {what} of {where} is not finite; every tick needs one")
    if "covariance" in told:
        try:
            require_covariances(name, stream, trace.P)
        except EstimatorError as e:
            raise BadInput(f"{e}; leave P out where there is none") from None

"""Where the team was, with hindsight: the most probable path over all readings, those of the future too.

It is not an estimator, and not registered as one, since a robot cannot run it: at a tick it knows what was
read later. In figures it is a line like the floor, which tells how much of an error is due to not having waited.

Source: B. Bell, "The iterated Kalman smoother as a Gauss-Newton method", SIAM J. Optimization 4(3), 1994.
"""

import numpy as np

from cooploc.estimators import make
from cooploc.estimators.interface import Array, Mail
from cooploc.estimators.kalman.sliding_window import Window, cost, empty, smoothed
from cooploc.estimators.models.angles import wrap_heading
from cooploc.scenarios.runner.run import run
from cooploc.scenarios.stream import Stream

LABEL = "with hindsight (no estimator)"  # of its line in a figure
SETTLED = 1e-9  # [m] or [rad]: no state moves by more in the last pass


def smoother(stream: Stream, passes: int = 50) -> Array:
    """The most probable states (t, T, n, d) of a team, given all readings of all ticks. No robot could know them.

    Gauss-Newton over the whole path, from what `map-joint` finds without the future; of each trial the most probable
    path of all passes is kept.

    Args:
        stream: from `simulate`.
        passes: the most that are made [count]; they end when nothing moves any more.

    """
    whole = _whole(stream)
    best, least = whole.x, cost(whole)
    for _ in range(passes):
        x, _ = smoothed(whole)
        moved = np.abs(wrap_heading(x - whole.x)).max()
        whole = whole._replace(x=x)
        now = cost(whole)
        best = np.where((now < least)[:, None, None, None], x, best)
        least = np.minimum(now, least)
        if moved < SETTLED:
            break
    return wrap_heading(best)


def _whole(stream: Stream) -> Window:
    """A window over all ticks, at the causal estimates."""
    start = run({"causal": make("map-joint")}, stream).traces["causal"].x
    link, rssi, ranged = stream.air
    rssi, ranged = (np.where(link, each, np.nan) if each.shape[-1] else each for each in (rssi, ranged))
    air = Mail(link, np.empty((*link.shape, 0)), rssi, ranged)
    return empty(stream.prior, stream.world)._replace(x=start, z=stream.senses, air=air)

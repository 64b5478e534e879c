"""The smoother: the most probable path of a team over all readings, those of later ticks too.

No robot can run it. `cl.Smoother()` in `cl.run` shows it beside filters, as offline: not ranked, and never best.

Source: B. Bell, "The iterated Kalman smoother as a Gauss-Newton method", SIAM J. Optimization 4(3), 1994.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cooploc.estimators import make
from cooploc.estimators.interface import Array, Belief, Mail, Rows, Senses, World
from cooploc.estimators.kalman_window import cost, empty, smooth_window
from cooploc.estimators.models import fixed_channels, wrap_heading
from cooploc.scenarios.runner.trace import trace
from cooploc.scenarios.stream import Stream

LABEL = "with hindsight (no estimator)"  # of its line in a figure
SETTLED = 1e-9  # [m] or [rad]: no state moves by more in the last pass
USES = ("odometry", *fixed_channels("any"), "sighting?", "radio_rssi?", "radio_range?")


@dataclass(frozen=True)
class Smoother:
    """The most probable path of the whole team given all readings of all ticks, with its covariances.

    Gauss-Newton over the whole path, from the path that `map-joint` finds without the future; of each trial the most
    probable path of all passes is kept.

    Parameters:
        passes: the most that are made [count]; they end when nothing moves any more.

    """

    api: ClassVar[int] = 1
    offline: ClassVar[bool] = True
    passes: int = 50
    uses: tuple[str, ...] = USES

    def smooth(self, prior: Belief, world: World, rows: Rows, z: Senses, air: Mail) -> Belief:
        """Return beliefs (t, T, n), trial by trial, as the passes of one must not depend on others."""
        given = prior, rows, z, air
        found = [self._smooth_trial(world, *(_part(one, np.s_[i : i + 1]) for one in given)) for i in range(len(z.dt))]
        return Belief(*(np.concatenate(part) for part in zip(*found, strict=True)))

    def _smooth_trial(self, world: World, prior: Belief, rows: Rows, z: Senses, air: Mail) -> Belief:
        whole = empty(prior, world)._replace(x=_filter(prior, world, rows, z, air), z=z, air=air)
        best, least = whole.x, cost(whole)
        for _ in range(self.passes):
            x = smooth_window(whole).x
            step = np.abs(wrap_heading(x - whole.x)).max()
            whole = whole._replace(x=x)
            now = cost(whole)
            best = np.where((now < least)[:, None, None, None], x, best)
            least = np.minimum(now, least)
            if step < SETTLED:
                break
        P = smooth_window(whole._replace(x=best)).P
        t, T, n, d = best.shape
        own = np.arange(n)
        return Belief(wrap_heading(best), P.reshape(t, T, n, d, n, d)[:, :, own, :, own].transpose(1, 2, 0, 3, 4))


def smoother(stream: Stream, passes: int = 50) -> Array:
    """Return the most probable states (t, T, n, d) of a team, given all readings of all ticks, as of `Smoother`."""
    return trace("smoother", Smoother(passes), stream).x


def _part(of: Any, which: Any) -> Any:
    """Return a NamedTuple of arrays, or of mappings to these, with some of their entries."""
    return type(of)(*({k: a[which] for k, a in v.items()} if isinstance(v, Mapping) else v[which] for v in of))


def _filter(prior: Belief, world: World, rows: Rows, z: Senses, air: Mail) -> Array:
    """Return the belief of `map-joint` at every tick (t, T, n, d)."""
    filtered = make("map-joint")
    s, x = filtered.init(prior, world, rows), []
    for k in range(z.dt.shape[1]):
        now = _part(z, np.s_[:, k])
        s, _ = filtered.exchange(filtered.correct(filtered.predict(s, now), now), now, _part(air, np.s_[:, k]))
        x.append(filtered.estimate(s).x)
    return np.stack(x, 1)

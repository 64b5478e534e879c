"""The assignment of radio nodes to robots, found from ranges and motion capture; and the places of the other nodes.

For inspection, on recordings that are not judged: it uses the truth. An assignment explains the range r between two
nodes by the distance d of the two things that carry them and a bias b of the pair,

    e = median |r - d - b|,    b = median(r - d), but within `BIASES`,

and the best assignment has the least mean of e over the pairs of carriers. Medians, as ranges by radio have far
outliers. Every carrier is taken to have a node (as long as there are nodes): name robots, not the furniture.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.sampling import interpolate
from cooploc.scenarios.recordings.team_log import Series

BIASES = (-0.5, 1.0)  # [m] that a pair of radios may have
NOT_MEASURED = 1.0  # [m] what a pair without ranges counts as
BEAM = 20_000  # assignments followed at a time: all of them, up to some eight nodes on four robots
MAX_GAP = 0.5  # [s] motion capture is not interpolated across longer gaps


# (node, node, carrier, carrier) -> bias and residual [m] of the nodes' ranges by the carriers' distances
Fits = Mapping[tuple[int, int, int, int], tuple[float, float]]


class NodeRanges(NamedTuple):
    """Ranges between two nodes."""

    first: str
    second: str
    time: Array  # (m,) [s]
    range: Array  # (m,) [m]


class Anchor(NamedTuple):
    """A node on no carrier: its place, if it stood still."""

    position: Array  # (2,) [m]
    residual: float  # [m] median of |r - d - b|, over its ranges to the nodes on carriers


class Assignment(NamedTuple):
    """The best assignment, and how sure it is."""

    nodes: Mapping[str, str]  # carrier -> node
    residual: float  # [m] mean over the pairs of carriers
    second: float  # [m] of the best assignment that differs; nan where there is none
    anchors: Mapping[str, Anchor]  # nodes on no carrier


def assign(ranges: Sequence[NodeRanges], carriers: Mapping[str, Series]) -> Assignment:
    """The node of each carrier.

    Args:
        ranges: between nodes; a pair may be there twice, in either order.
        carriers: what may carry a node, with its true positions over time (x, y first): robots, or marked furniture.

    Raises:
        BadInput: there are fewer than two nodes or two carriers.

    """
    nodes = sorted({name for one in ranges for name in (one.first, one.second)})
    if len(nodes) < 2 or len(carriers) < 2:
        raise BadInput(f"{len(nodes)} nodes and {len(carriers)} carriers; to tell which is where takes two of each")
    fits = _fits(ranges, nodes, list(carriers.values()))
    assignments, costs = _search(fits, len(nodes), len(carriers))
    where = {i: int(k) for k, i in enumerate(assignments[0]) if i >= 0}  # carrier -> node
    names = list(carriers)
    found = {names[i]: nodes[k] for i, k in sorted(where.items())}
    on = {node: carriers[name] for name, node in found.items()}
    pairs = ((where[i], where[j], i, j) for i, j in combinations(sorted(where), 2))
    biases = [fits[pair][0] for pair in pairs if pair in fits]
    bias = float(np.median(biases)) if biases else 0.0
    anchors = {node: _place_of(node, ranges, on, bias) for node in nodes if node not in on}
    return Assignment(
        found,
        float(costs[0]),
        float(costs[1]) if len(costs) > 1 else np.nan,
        {node: place for node, place in anchors.items() if place is not None},
    )


def _fits(ranges: Sequence[NodeRanges], nodes: Sequence[str], carriers: Sequence[Series]) -> Fits:
    fits = {}
    for a, b in combinations(range(len(nodes)), 2):
        of_pair = [one for one in ranges if {one.first, one.second} == {nodes[a], nodes[b]}]
        if not of_pair:
            continue
        time, measured = (np.concatenate([getattr(one, field) for one in of_pair]) for field in ("time", "range"))
        at = [interpolate(c.time, c.values[:, :2], time, MAX_GAP) for c in carriers]
        for i, j in combinations(range(len(carriers)), 2):
            error = measured - np.hypot(*(at[i] - at[j]).T)
            error = error[np.isfinite(error)]
            if len(error):
                bias = float(np.clip(np.median(error), *BIASES))
                fit = bias, float(np.median(np.abs(error - bias)))
                for nodes_ in ((a, b), (b, a)):
                    fits[*nodes_, i, j] = fits[*nodes_, j, i] = fit
    return fits


def _search(
    fits: Mapping[tuple[int, int, int, int], tuple[float, float]], nodes: int, carriers: int
) -> tuple[Array, Array]:
    """Assignments (s, nodes), each a carrier or -1 (as few as can be), and their costs (s,) [m], best first."""
    cost = np.full((nodes, nodes, carriers, carriers), NOT_MEASURED)
    for key, fit in fits.items():
        cost[key] = fit[1]
    carried = min(nodes, carriers)
    found: list[tuple[tuple[int, ...], float]] = [((), 0.0)]
    for k in range(nodes):
        longer = []
        for places, total in found:
            so_far = [(m, place) for m, place in enumerate(places) if place >= 0]
            if k - len(so_far) < nodes - carried:
                longer.append(((*places, -1), total))
            for i in set(range(carriers)) - set(places) if len(so_far) < carried else ():
                longer.append(((*places, i), total + float(sum(cost[m, k, place, i] for m, place in so_far))))
        found = sorted(longer, key=lambda one: one[1])[:BEAM]
    pairs = carried * (carried - 1) / 2
    return np.array([places for places, _ in found]), np.array([total for _, total in found]) / pairs


def _place_of(node: str, ranges: Sequence[NodeRanges], on: Mapping[str, Series], bias: float) -> Anchor | None:
    """Return the place of a node from its ranges to nodes on carriers; None without any.

    Least squares with a soft L1 loss, from several places around the carriers, as ranges to a line of robots have two
    minima. Robots that drive little cannot tell a bias from a distance: it is taken to be `bias`, that of the carriers.
    """
    positions, measured = [], []
    for one in ranges:
        other = one.second if one.first == node else one.first if one.second == node else None
        if other is not None and other in on:
            positions.append(interpolate(on[other].time, on[other].values[:, :2], one.time, MAX_GAP))
            measured.append(one.range)
    if not positions:
        return None
    at, r = np.concatenate(positions), np.concatenate(measured)
    known = np.isfinite(at).all(1)
    at, r = at[known], r[known]
    if not len(r):
        return None

    def error(place: Array) -> Array:
        return np.asarray(np.hypot(*(at - place).T) + bias - r)

    turns = np.arange(8) * np.pi / 4
    starts = at.mean(0) + np.median(r) * np.stack([np.cos(turns), np.sin(turns)], -1)
    tried = [least_squares(error, start, loss="soft_l1", f_scale=0.1) for start in starts]
    best = min(tried, key=lambda one: float(one.cost)).x
    return Anchor(best, float(np.median(np.abs(error(best)))))

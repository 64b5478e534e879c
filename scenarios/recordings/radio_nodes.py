"""The assignment of radio nodes to robots, found from ranges and motion capture.

For inspection, on recordings that are not judged: it uses the truth. An assignment explains the range r between two
nodes by the distance d of the two things that carry them and a bias b of the pair,

    e = median |r - d - b|,    b = median(r - d), but within `BIASES`,

and the best assignment has the least mean of e over the pairs of carriers, and of carriers and known places; a pair
without ranges counts as 1 m, and its residual is of the others. Medians, as ranges by radio have far outliers. Every
carrier is taken to have a node (as long as there are nodes): name robots, not the furniture.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.sampling import interpolate
from cooploc.scenarios.recordings.team_log import Series

BIASES = (-0.5, 1.0)  # [m] that a pair of radios may have
NOT_MEASURED = 1.0  # [m] what a pair without ranges counts as
BEAM = 20_000  # assignments followed at a time: all of them, up to some eight nodes on four robots
MAX_GAP = 0.5  # [s] motion capture is not interpolated across longer gaps


class NodeRanges(NamedTuple):
    """Ranges between two nodes."""

    first: str
    second: str
    time: Array  # (m,) [s]
    range: Array  # (m,) [m]


class Assignment(NamedTuple):
    """The best assignment, and how sure it is."""

    nodes: Mapping[str, str]  # carrier -> node
    residual: float  # [m] mean over the pairs of carriers with ranges
    second: float  # [m] of the best assignment that differs; nan where there is none
    others: tuple[str, ...]  # nodes on no carrier


def assign(
    ranges: Sequence[NodeRanges],
    carriers: Mapping[str, Series],
    known: Mapping[str, Array | Series] = MappingProxyType({}),
) -> Assignment:
    """Return the node of each carrier: a robot, or marked furniture, with its true positions (x, y first) over time.

    `known` are the places (2,) [m], or the positions over time, of nodes that need not be found.
    """
    nodes, names = sorted({name for one in ranges for name in (one.first, one.second)} - {*known}), list(carriers)
    if len(nodes) < (1 if known else 2) or len(names) < 2:
        raise BadInput(f"{len(nodes)} nodes and {len(names)} carriers; to tell which is where takes two of each")
    misfit, carried = _misfits(ranges, nodes, list(carriers.values())), min(len(nodes), len(names))
    alone = _misfits_of_places(ranges, nodes, list(carriers.values()), known)
    if alone.any() and all({one.first, one.second} & {*known} for one in ranges):
        misfit[:] = 0.0  # nodes did not measure each other
    tried: list[tuple[tuple[int, ...], float]] = [((), 0.0)]  # the carrier of each node, -1 for none, and the cost [m]
    for k in range(len(nodes)):
        longer = []
        for places, cost in tried:
            before = [(m, place) for m, place in enumerate(places) if place >= 0]
            if k - len(before) < len(nodes) - carried:
                longer.append(((*places, -1), cost))
            for i in set(range(len(names))) - {*places} if len(before) < carried else ():
                longer.append(
                    ((*places, i), cost + float(sum((misfit[m, k, place, i] for m, place in before), alone[k, i])))
                )
        tried = sorted(longer, key=lambda one: one[1])[:BEAM]
    pairs = carried * (carried - 1) / 2 * misfit.any() + carried * alone.any()
    measured = {frozenset((one.first, one.second)) for one in ranges}

    def residual(places: tuple[int, ...], cost: float) -> float:  # without pairs that are too far apart for ranges
        there = combinations([node for node, place in zip(nodes, places, strict=True) if place >= 0], 2)
        lost = sum(frozenset(pair) not in measured for pair in there) if misfit.any() else 0
        return (cost - lost * NOT_MEASURED) / (pairs - lost) if pairs > lost else NOT_MEASURED

    found = {names[i]: nodes[k] for i, k in sorted((i, k) for k, i in enumerate(tried[0][0]) if i >= 0)}
    best, second = residual(*tried[0]), residual(*tried[1]) if len(tried) > 1 else np.nan
    return Assignment(found, best, second, tuple(node for node in nodes if node not in found.values()))


def _misfits_of_places(
    ranges: Sequence[NodeRanges], nodes: Sequence[str], carriers: Sequence[Series], known: Mapping[str, Array | Series]
) -> Array:
    """Return the residual [m] of each node's ranges to what is known, by the distances of a carrier, (n, c)."""
    misfit = np.full((len(nodes), len(carriers)), NOT_MEASURED)
    if not any({one.first, one.second} & {*known} and {one.first, one.second} & {*nodes} for one in ranges):
        return np.zeros_like(misfit)
    for k, node in enumerate(nodes):
        of_node = [(one, ({one.first, one.second} - {node}).pop()) for one in ranges if node in (one.first, one.second)]
        for i, carrier in enumerate(carriers):
            found = []
            for one, place in ((one, known[name]) for one, name in of_node if name in known):
                at = interpolate(carrier.time, carrier.values[:, :2], one.time, MAX_GAP)
                there = interpolate(*place[:2], one.time, MAX_GAP)[:, :2] if isinstance(place, Series) else place
                error = one.range - np.hypot(*(at - there).T)
                bias = float(np.clip(np.nanmedian(error), *BIASES)) if np.isfinite(error).any() else np.nan
                found.append(float(np.nanmedian(np.abs(error - bias))) if np.isfinite(bias) else NOT_MEASURED)
            misfit[k, i] = np.mean(found) if found else NOT_MEASURED
    return misfit


def _misfits(ranges: Sequence[NodeRanges], nodes: Sequence[str], carriers: Sequence[Series]) -> Array:
    """Return the residual [m] of the ranges of two nodes by the distances of two carriers, (n, n, c, c)."""
    misfit = np.full((len(nodes), len(nodes), len(carriers), len(carriers)), NOT_MEASURED)
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
                for k, m in ((a, b), (b, a)):
                    misfit[k, m, i, j] = misfit[k, m, j, i] = float(np.median(np.abs(error - bias)))
    return misfit

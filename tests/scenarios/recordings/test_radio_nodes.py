"""Nodes on robots and anchors, simulated: the assignment that made the ranges is found."""

from itertools import combinations

import numpy as np

from cooploc.scenarios.recordings.radio_nodes import NodeRanges, assign
from cooploc.scenarios.recordings.team_log import Series

TIME = np.arange(0, 20, 0.1)
PLACED = {"n1": "red", "n2": None, "n3": "blue", "n4": "green", "n5": None}
ANCHORS = {"n2": np.array([6.0, 1.0]), "n5": np.array([-3.0, 4.0])}


def paths():
    """Three robots on arcs of their own."""
    return {
        name: Series(TIME, np.stack([x + r * np.cos(w * TIME), y + r * np.sin(w * TIME)], -1), name)
        for name, x, y, r, w in (("red", 0, 0, 1.0, 0.2), ("blue", 3, 1, 0.8, -0.3), ("green", 1, 4, 1.2, 0.1))
    }


def simulated(rng, outliers=0.1):
    """Ranges with a bias of each pair, noise of 5 cm and some far outliers."""
    robots = paths()
    where = {n: robots[on].values if on else ANCHORS[n] for n, on in PLACED.items()}
    ranges = []
    for a, b in combinations(PLACED, 2):
        r = np.hypot(*(where[a] - where[b]).T) + rng.uniform(0.2, 0.4) + 0.05 * rng.standard_normal(len(TIME))
        r[rng.uniform(size=len(TIME)) < outliers] += 3.0
        ranges.append(NodeRanges(a, b, TIME, r))
    return ranges


def test_the_node_of_each_robot_is_found_and_the_second_best_is_far_worse():
    found = assign(simulated(np.random.default_rng(1)), paths())
    assert found.nodes == {"red": "n1", "blue": "n3", "green": "n4"}
    assert found.residual < 0.06
    assert found.second > 2 * found.residual
    assert set(found.others) == set(ANCHORS)


def test_two_nodes_on_two_robots_cannot_be_told_apart_and_it_says_so():
    rng = np.random.default_rng(3)
    robots = {name: series for name, series in paths().items() if name != "green"}
    ranges = [one for one in simulated(rng) if {one.first, one.second} == {"n1", "n3"}]
    found = assign(ranges, robots)
    assert found.second == found.residual


def test_known_robots_that_measured_nothing_change_nothing():
    ranges, robots = simulated(np.random.default_rng(1)), paths()
    assert assign(ranges, robots, robots) == assign(ranges, robots)


def test_known_places_tell_two_nodes_on_two_robots_apart_also_without_ranges_between_these():
    robots = {name: series for name, series in paths().items() if name != "green"}
    ranges = [one for one in simulated(np.random.default_rng(4)) if "n4" not in (one.first, one.second)]
    for some in (ranges, [one for one in ranges if {one.first, one.second} & {*ANCHORS}]):
        found = assign(some, robots, ANCHORS)
        assert found.nodes == {"red": "n1", "blue": "n3"}
        assert found.residual < 0.06
        assert found.second > 2 * found.residual

"""Nodes on robots and anchors, simulated: the assignment that made the ranges is found."""

import os
import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from cooploc.scenarios.recordings.bags import read_topics, topics
from cooploc.scenarios.recordings.radio_nodes import NodeRanges, assign
from cooploc.scenarios.recordings.team_log import Series

FOUR = Path(os.environ.get("COOPLOC_DATA", "../shared/data")) / "uwb-tiers" / "four-robots"
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


@pytest.mark.skipif(not FOUR.exists(), reason="needs ../shared/data/uwb-tiers")
def test_on_four_recorded_robots_the_best_assignment_is_twice_as_good_as_any_other():
    of_nodes, of_robots = re.compile(r"/uwb/tof/(n_\d)/(n_\d)/distance"), re.compile(r".*/turtlebot(\d)_cap/pose")
    names = [info.name for info in topics(FOUR)[0] if of_nodes.match(info.name) or of_robots.match(info.name)]
    series, _ = read_topics(FOUR, names)
    ranges = [NodeRanges(*of_nodes.match(t).groups(), s.time, s.values[:, 0]) for t, s in series.items() if "uwb" in t]
    carriers = {of_robots.match(t)[1]: Series(s.time, s.values, t) for t, s in series.items() if "uwb" not in t}
    found = assign(ranges, carriers)
    assert found.nodes == {"1": "n_7", "3": "n_3", "4": "n_4", "5": "n_5"}
    assert found.second > 2 * found.residual
    assert set(found.others) == {"n_1", "n_2", "n_6", "n_8"}

"""PyFG factor graphs as recordings of a team: odometry and ranges from the edges, truth from the vertices.

A measurement has the time of the first pose that it names. Landmarks are taken as surveyed: those that a range leads to
are anchors, those with a place in a robot's frame (EDGE_SE2_XY) are landmarks. A pose of another robot in a robot's
frame is a sighting. Loop closures are left out, as no estimator here relates a robot to its own past.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings.team.pyfg_lines import Edge, Graph, read_graph
from cooploc.scenarios.recordings.team.schema import TeamDescription
from cooploc.scenarios.recordings.team.team_log import Channel, Places, Readings, Series, TeamLog

Chain = Sequence[str]  # the poses of a robot, by time


def runs(data: Path, description: TeamDescription) -> dict[str, Path]:
    """The files *.pyfg in a directory, or a file by itself.

    Raises:
        BadInput: there are none.

    """
    found = {path.stem: path for path in (sorted(data.glob("*.pyfg")) if data.is_dir() else [data])}
    if not found:
        raise BadInput(f"{data}: no file ends with .pyfg; put the factor graphs there")
    return found


def read(data: Path, place: Path, name: str, description: TeamDescription) -> TeamLog:
    """One of them; a PyFG file leaves nothing for the description to say."""
    return read_pyfg(place)._replace(name=name)


def read_pyfg(path: Path) -> TeamLog:
    """One file as one recording.

    Raises:
        BadInput: the file cannot be read, is of three dimensions, or a line is malformed; names the line.

    """
    graph = read_graph(path)
    chains = _chains(graph)
    robots = {robot: i for i, robot in enumerate(chains)}
    whose = {name: robots[pose.robot] for name, pose in graph.poses.items()}
    following = {pair for chain in chains.values() for pair in pairwise(chain)}
    steps = {(e.first, e.second): e.values for e in graph.relative if (e.first, e.second) in following}
    apart = [e for e in graph.relative if (e.first, e.second) not in following]
    of_mates = [e for e in graph.ranges if e.second in whose]
    of_anchors = [e for e in graph.ranges if e.second not in whose]
    anchors, landmarks = _numbered(of_anchors), _numbered(graph.seen)
    readings: dict[Channel, Readings] = {
        "range": _readings(graph, of_mates, whose, whose),
        "sighting": _readings(graph, [_polar(e) for e in apart], whose, whose),
        "anchor_range": _readings(graph, of_anchors, whose, anchors),
        "landmark": _readings(graph, [_polar(e) for e in graph.seen], whose, landmarks),
    }
    return TeamLog(
        path.stem,
        tuple(robots),
        "pose",
        tuple(_odometry(graph, chain, steps) for chain in chains.values()),
        tuple(_truth(graph, chain) for chain in chains.values()),
        {channel: found for channel, found in readings.items() if len(found.time)},
        _places(graph, landmarks),
        _places(graph, anchors),
        tuple(graph.warnings),
    )


def _chains(graph: Graph) -> Mapping[str, Chain]:
    """The poses of each robot, robots by name, poses by number.

    Raises:
        BadInput: there are none, or their times do not rise.

    """
    chains: dict[str, list[str]] = {}
    for name in sorted(graph.poses, key=lambda name: graph.poses[name][:2]):
        chains.setdefault(graph.poses[name].robot, []).append(name)
    if not chains:
        raise BadInput(f"{graph.path}: no line VERTEX_SE2, and so no robot; is this a PyFG file?")
    for robot, chain in chains.items():
        time = np.array([graph.poses[name].time for name in chain])
        stuck = np.flatnonzero(np.diff(time) <= 0)
        if len(stuck):
            raise BadInput(
                f"{graph.path}: pose {chain[stuck[0] + 1]} is not later than {chain[stuck[0]]}; the times of robot "
                f"{robot} must rise with the numbers of its poses"
            )
    return chains


def _odometry(graph: Graph, chain: Chain, steps: Mapping[tuple[str, str], Sequence[float]]) -> Series:
    """Poses composed from the first: x' = x + R(heading) dx; of the longest stretch in which no step is missing.

    Raises:
        BadInput: there is no step at all.

    """
    missing = [k for k, pair in enumerate(pairwise(chain)) if pair not in steps]
    begin, end = max(pairwise([-1, *missing, len(chain) - 1]), key=lambda ends: ends[1] - ends[0])
    stretch = chain[begin + 1 : end + 1]
    robot = graph.poses[chain[0]].robot
    if len(stretch) < 2:
        raise BadInput(
            f"{graph.path}: robot {robot} has no odometry; add a line EDGE_SE2 from each of its poses to the next"
        )
    if missing:
        said = f"lacks {len(missing)} steps of odometry; it is read from {stretch[0]} to {stretch[-1]}"
        graph.warnings.append(f"{graph.path}: robot {robot} {said}")
    x, y, heading = 0.0, 0.0, 0.0
    rows = [(x, y, heading)]
    for pair in pairwise(stretch):
        dx, dy, turn = steps[pair]
        c, s = np.cos(heading), np.sin(heading)
        x, y, heading = x + c * dx - s * dy, y + s * dx + c * dy, heading + turn
        rows.append((x, y, heading))
    values = np.array(rows)
    values[:, 2] = wrap(values[:, 2])
    return Series(np.array([graph.poses[name].time for name in stretch]), values, f"{graph.path}, EDGE_SE2")


def _truth(graph: Graph, chain: Chain) -> Series:
    poses = np.array([graph.poses[name].pose for name in chain])
    poses[:, 2] = wrap(poses[:, 2])
    return Series(np.array([graph.poses[name].time for name in chain]), poses, f"{graph.path}, VERTEX_SE2")


def _readings(graph: Graph, edges: Sequence[Edge], robots: Mapping[str, int], others: Mapping[str, int]) -> Readings:
    """Measurements by rising time; without those of a robot by itself, and ranges that are not positive."""
    apart = [e for e in edges if robots is not others or robots[e.first] != others[e.second]]
    good = [e for e in apart if e.values[0] > 0]
    if len(apart) < len(edges):
        said = "measurements between poses of one robot (loop closures), which are not read, were left out"
        graph.warnings.append(f"{graph.path}: {len(edges) - len(apart)} {said}")
    if len(good) < len(apart):
        graph.warnings.append(f"{graph.path}: {len(apart) - len(good)} ranges that are not positive were left out")
    good.sort(key=lambda e: graph.poses[e.first].time)
    return Readings(
        np.array([graph.poses[e.first].time for e in good]),
        np.array([robots[e.first] for e in good], np.int64),
        np.array([others[e.second] for e in good], np.int64),
        np.array([e.values for e in good], float).reshape(len(good), len(edges[0].values) if edges else 1),
        str(graph.path),
    )


def _polar(edge: Edge) -> Edge:
    """Range and bearing of a place or pose in the frame of a robot."""
    x, y = edge.values[:2]
    return edge._replace(values=(float(np.hypot(x, y)), float(np.arctan2(y, x))))


def _numbered(edges: Sequence[Edge]) -> dict[str, int]:
    return {name: i for i, name in enumerate(sorted({e.second for e in edges}))}


def _places(graph: Graph, names: Mapping[str, int]) -> Places:
    return Places(tuple(names), np.array([graph.places[name] for name in names], float).reshape(-1, 2))

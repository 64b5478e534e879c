"""The lines of a PyFG file: a factor graph as text, one vertex or edge a line, fields divided by blanks.

    VERTEX_SE2 time A0 x y theta            true pose of robot A; robots are letters, L is for landmarks
    VERTEX_XY L0 x y                        true place of a landmark (some files have a time before its name)
    VERTEX_SE2:PRIOR, VERTEX_XY:PRIOR       what an optimizer is to start from: not read
    EDGE_SE2 time A0 A1 x y theta cov (6)   pose of A1 in the frame of A0: odometry, a loop closure, or a sighting of B7
    EDGE_SE2_XY time A0 L0 x y cov (3)      place of a landmark in the frame of A0
    EDGE_RANGE time A0 L0 range variance    to a landmark, or a pose of another robot

As a recording of a team, odometry and ranges are from the edges, truth from the vertices. A measurement has the time of
the first pose that it names. Landmarks are taken as surveyed: those that a range leads to are anchors, those with a
place in a robot's frame (EDGE_SE2_XY) are landmarks. A pose of another robot in a robot's frame is a sighting. Loop
closures are left out, as no estimator here relates a robot to its own past.

Source: A. Papalia et al., PyFactorGraph, https://github.com/MarineRoboticsGroup/PyFactorGraph, io/pyfg_text.py.
"""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from reprlib import repr as short_repr
from typing import NamedTuple, cast

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings.schema import TeamDescription
from cooploc.scenarios.recordings.team_log import (
    Channel,
    Kind,
    Measured,
    Places,
    ReadingSeries,
    Series,
    TeamLog,
    order_series,
    split_channels,
)
from cooploc.scenarios.recordings.text_files import LARGEST, Fault, leave_out, parse_number, read_text

POSE_NAME = re.compile(r"([A-Za-z]+)(\d{1,9})")


class Pose(NamedTuple):
    """A vertex of a robot."""

    robot: str
    number: int
    time: float  # [s]
    pose: tuple[float, ...]  # x, y [m], heading [rad]


class Edge(NamedTuple):
    """A measurement between two vertices."""

    line: int  # from 1
    first: str
    second: str
    values: tuple[float, ...]


class Graph(NamedTuple):
    """A file, by kind of line."""

    path: Path
    poses: dict[str, Pose]
    places: dict[str, tuple[float, ...]]
    relative: list[Edge]  # EDGE_SE2: x, y [m], theta [rad]
    seen: list[Edge]  # EDGE_SE2_XY: x, y [m]
    ranges: list[Edge]  # EDGE_RANGE: range [m]
    warnings: list[str]


def read_graph(path: Path) -> Graph:
    """Read the vertices and edges in a file. Lines that cannot be read are left out, with a warning."""
    text = read_text(path, "ascii")
    graph = Graph(path, {}, {}, [], [], [], [])
    lines = [(i, line.split()) for i, line in enumerate(text.split("\n"), 1) if line and not line.isspace()]
    for i, (tag, *_) in lines:
        if tag.startswith(("VERTEX_SE3", "VERTEX_XYZ", "EDGE_SE3")):
            three = f"{tag} is of three dimensions; only graphs in the plane (SE2, XY) are read"
            raise BadInput(f"{path}, line {i}: {three}")
    known = [(i, fields) for i, fields in lines if fields[0] in FIELDS]
    faults = [fault for i, fields in known if (fault := _add(graph, i, fields))] + _drop_loose_edges(graph)
    graph.warnings.extend(leave_out(path, sorted(faults), len(known)))
    tags = Counter(tag for _, (tag, *_) in lines if not tag.endswith(":PRIOR") and not tag.startswith("#"))
    unknown = {tag: n for tag, n in tags.items() if tag not in FIELDS}
    graph.warnings.extend(
        f"{path}: {n} lines of {short_repr(tag)}, which is not read, were left out" for tag, n in unknown.items()
    )
    return graph


# How many fields the line of each tag has, and which of them are the numbers that are read.
FIELDS: Mapping[str, tuple[int, tuple[int, ...]]] = {
    "VERTEX_SE2": (6, (1, 3, 4, 5)),
    "VERTEX_XY": (4, (2, 3)),
    "EDGE_SE2": (13, (4, 5, 6)),
    "EDGE_SE2_XY": (9, (4, 5)),
    "EDGE_RANGE": (6, (4,)),
}


def _add(graph: Graph, line: int, fields: list[str]) -> Fault | None:
    """Add the vertex or edge of a line; return its fault where it cannot be read."""
    tag = fields[0]
    total, numbers = FIELDS[tag]
    if tag == "VERTEX_XY" and len(fields) == 5:  # with a time
        total, numbers = 5, (3, 4)
    if len(fields) != total:
        return line, f"{tag} has {len(fields)} fields, not {total}"
    values = tuple(parse_number(fields[i]) for i in numbers)
    for i, value in zip(numbers, values, strict=True):
        if not abs(value) <= LARGEST:
            return line, f"{short_repr(fields[i])} is not a number"
    if tag.startswith("EDGE"):
        edges = {"EDGE_SE2": graph.relative, "EDGE_SE2_XY": graph.seen, "EDGE_RANGE": graph.ranges}[tag]
        edges.append(Edge(line, fields[2], fields[3], values))
        return None
    name = fields[numbers[-2] - 1] if tag == "VERTEX_XY" else fields[2]
    if name in graph.poses or name in graph.places:
        return line, f"vertex {short_repr(name)} was given before"
    if tag == "VERTEX_XY":
        graph.places[name] = values
        return None
    match = POSE_NAME.fullmatch(name)
    if not match:
        return line, f"pose {short_repr(name)} is not a letter and a number, like A0"
    graph.poses[name] = Pose(match[1], int(match[2]), values[0], values[1:])
    return None


def _drop_loose_edges(graph: Graph) -> list[Fault]:
    """Drop edges whose vertices are not in the file; a range may name the landmark first, and is turned."""
    graph.ranges[:] = [
        e._replace(first=e.second, second=e.first) if e.first in graph.places else e for e in graph.ranges
    ]
    of_poses, of_places, of_all = graph.poses, graph.places, graph.poses | graph.places
    faults: list[Fault] = []
    for edges, seconds in ((graph.relative, of_poses), (graph.seen, of_places), (graph.ranges, of_all)):
        for edge in edges:
            lost = [name for name, known in ((edge.first, of_poses), (edge.second, seconds)) if name not in known]
            faults += [(edge.line, f"there is no vertex {short_repr(name)}") for name in lost[:1]]
        loose = {line for line, _ in faults}
        edges[:] = [edge for edge in edges if edge.line not in loose]
    return faults


# ---- A graph as a recording of a team

Chain = Sequence[str]  # the poses of a robot, by time


def find_runs(data: Path, description: TeamDescription) -> dict[str, Path]:
    """Return the files *.pyfg in a directory, or a file by itself."""
    found = {path.stem: path for path in (sorted(data.glob("*.pyfg")) if data.is_dir() else [data])}
    if not found:
        raise BadInput(f"{data}: no file ends with .pyfg; put the factor graphs there")
    return found


def read_run(place: Path, name: str, description: TeamDescription) -> TeamLog:
    """Read one file as one recording; it leaves nothing for the description to say."""
    graph = read_graph(place)
    chains = _chains(graph)
    following = {pair for chain in chains.values() for pair in pairwise(chain)}
    steps = {(e.first, e.second): e.values for e in graph.relative if (e.first, e.second) in following}
    sightings = [e for e in graph.relative if (e.first, e.second) not in following]
    anchors = _places(graph, {e.second for e in graph.ranges if e.second in graph.places})
    landmarks = _places(graph, {e.second for e in graph.seen})
    odometry = tuple(_odometry(graph, chain, steps) for chain in chains.values())
    truth = tuple(_series(graph, chain, [graph.poses[name].pose for name in chain]) for chain in chains.values())
    robots, readings = tuple(chains), dict[Channel, ReadingSeries]()
    polar = _measurements(graph, [*map(_polar, sightings), *map(_polar, graph.seen)])
    for kind, measured, places in (
        ("range", _measurements(graph, graph.ranges), anchors),
        ("sighting", polar, landmarks),
    ):
        channels, notes = split_channels(cast(Kind, kind), [measured], robots, places.names)
        readings |= channels
        graph.warnings.extend(notes)
    return TeamLog(
        name, robots, "pose", odometry, truth, readings, landmarks, anchors, tuple(dict.fromkeys(graph.warnings))
    )


def _chains(graph: Graph) -> Mapping[str, Chain]:
    """Return the poses of each robot that has odometry, robots by name, poses by number."""
    chains: dict[str, list[str]] = {}
    for name in sorted(graph.poses, key=lambda name: graph.poses[name][:2]):
        chains.setdefault(graph.poses[name].robot, []).append(name)
    if not chains:
        raise BadInput(f"{graph.path}: no line VERTEX_SE2, and so no robot; is this a PyFG file?")
    steps = {(edge.first, edge.second) for edge in graph.relative}
    still = [robot for robot, chain in chains.items() if steps.isdisjoint(pairwise(chain))]
    if len(still) == len(chains):
        raise BadInput(f"{graph.path}: no robot has odometry; add a line EDGE_SE2 from each pose to the next")
    graph.warnings.extend(f"{graph.path}: robot {robot} has no odometry (EDGE_SE2); it was left out" for robot in still)
    return {robot: chain for robot, chain in chains.items() if robot not in still}


def _odometry(graph: Graph, chain: Chain, steps: Mapping[tuple[str, str], Sequence[float]]) -> Series:
    """Return poses composed from the first: x' = x + R(heading) dx; of the longest stretch without a missing step."""
    missing = [k for k, pair in enumerate(pairwise(chain)) if pair not in steps]
    begin, end = max(pairwise([-1, *missing, len(chain) - 1]), key=lambda ends: ends[1] - ends[0])
    stretch = chain[begin + 1 : end + 1]
    if missing:
        robot = graph.poses[chain[0]].robot
        lack = f"lacks {len(missing)} steps of odometry; it is read from {stretch[0]} to {stretch[-1]}"
        graph.warnings.append(f"{graph.path}: robot {robot} {lack}")
    x, y, heading = 0.0, 0.0, 0.0
    rows = [(x, y, heading)]
    for pair in pairwise(stretch):
        dx, dy, turn = steps[pair]
        c, s = np.cos(heading), np.sin(heading)
        x, y, heading = x + c * dx - s * dy, y + s * dx + c * dy, heading + turn
        rows.append((x, y, heading))
    return _series(graph, stretch, rows)


def _series(graph: Graph, chain: Chain, rows: Sequence[Sequence[float]]) -> Series:
    """Return a robot's poses (m, 3) with stamps that rise; of repeated stamps the first pose is kept."""
    values = np.array(rows, float)
    values[:, 2] = wrap(values[:, 2])
    time = np.array([graph.poses[name].time for name in chain])
    series, notes = order_series(time, values, f"{graph.path}, robot {graph.poses[chain[0]].robot}")
    graph.warnings.extend(notes)
    return series


def _measurements(graph: Graph, edges: Sequence[Edge]) -> Measured:
    """Return measurements at the time of the first pose that they name."""
    first = [graph.poses[e.first] for e in edges]
    other = [graph.poses[e.second].robot if e.second in graph.poses else e.second for e in edges]
    values = np.array([e.values for e in edges], float).reshape(len(edges), len(edges[0].values) if edges else 1)
    return Measured(np.array([p.time for p in first]), [p.robot for p in first], other, values, str(graph.path))


def _polar(edge: Edge) -> Edge:
    """Return range and bearing of a place or pose in the frame of a robot."""
    x, y = edge.values[:2]
    return edge._replace(values=(float(np.hypot(x, y)), float(np.arctan2(y, x))))


def _places(graph: Graph, names: Collection[str]) -> Places:
    return Places(tuple(sorted(names)), np.array([graph.places[name] for name in sorted(names)], float).reshape(-1, 2))

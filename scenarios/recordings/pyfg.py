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
from collections.abc import Collection, Sequence
from itertools import pairwise
from pathlib import Path
from reprlib import repr as short_repr
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cooploc.estimators.errors import BadInput
from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings import team_log
from cooploc.scenarios.recordings.schema import TeamDescription
from cooploc.scenarios.recordings.team_log import Measured, Places, Series, TeamLog, order_series, split_channels
from cooploc.scenarios.recordings.text_files import LARGEST, leave_out, parse_number, read_text

POSE_NAME = re.compile(r"([A-Za-z]+)(\d{1,9})")
# The fields of a line by its tag and their number: those that are names of vertices, and the numbers that are read.
FIELDS = {
    ("VERTEX_SE2", 6): ((2,), (1, 3, 4, 5)),
    ("VERTEX_XY", 4): ((1,), (2, 3)),
    ("VERTEX_XY", 5): ((2,), (3, 4)),  # with a time
    ("EDGE_SE2", 13): ((2, 3), (4, 5, 6)),
    ("EDGE_SE2_XY", 9): ((2, 3), (4, 5)),
    ("EDGE_RANGE", 6): ((2, 3), (4,)),
}
LENGTHS = dict(reversed(FIELDS))


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
    edges: dict[str, list[Edge]]  # by tag: x, y [m], theta [rad] of EDGE_SE2; x, y of EDGE_SE2_XY; range of EDGE_RANGE
    warnings: list[str]


def read_graph(path: Path) -> Graph:
    """Read the vertices and edges in a file. Lines that cannot be read are left out, with a warning."""
    text = read_text(path)
    graph = Graph(path, {}, {}, {tag: [] for tag in LENGTHS if tag.startswith("EDGE")}, [])
    lines = [(i, line.split()) for i, line in enumerate(text.split("\n"), 1) if line and not line.isspace()]
    for i, (tag, *_) in lines:
        if tag.startswith(("VERTEX_SE3", "VERTEX_XYZ", "EDGE_SE3")):
            three = f"{tag} is of three dimensions; only graphs in the plane (SE2, XY) are read"
            raise BadInput(f"{path}, line {i}: {three}")
    known = [(i, fields) for i, fields in lines if fields[0] in LENGTHS]
    faults = [(i, why) for i, fields in known if (why := _add(graph, i, fields))]
    # An edge whose vertices are not in the file is left out; a range may name the landmark first, and is turned.
    for tag, edges in graph.edges.items():
        seconds = {"EDGE_SE2": {*graph.poses}, "EDGE_SE2_XY": {*graph.places}}.get(tag, {*graph.poses, *graph.places})
        if tag == "EDGE_RANGE":
            edges[:] = [e._replace(first=e.second, second=e.first) if e.first in graph.places else e for e in edges]
        for e in edges:
            lost = [name for name, of in ((e.first, graph.poses), (e.second, seconds)) if name not in of]
            faults += [(e.line, f"there is no vertex {short_repr(name)}") for name in lost[:1]]
        loose = {line for line, _ in faults}
        edges[:] = [e for e in edges if e.line not in loose]
    graph.warnings.extend(leave_out(path, sorted(faults), len(known)))
    tags = Counter(tag for _, (tag, *_) in lines if not tag.endswith(":PRIOR") and not tag.startswith("#"))
    graph.warnings.extend(
        f"{path}: {n} lines of {short_repr(tag)}, which is not read, were left out"
        for tag, n in tags.items()
        if tag not in LENGTHS
    )
    return graph


def _add(graph: Graph, line: int, fields: list[str]) -> str:
    """Add the vertex or edge of a line; return why it cannot be read, or nothing."""
    tag = fields[0]
    if (tag, len(fields)) not in FIELDS:
        return f"{tag} has {len(fields)} fields, not {LENGTHS[tag]}"
    named, numbers = FIELDS[tag, len(fields)]
    names, values = [fields[i] for i in named], tuple(parse_number(fields[i]) for i in numbers)
    for i, value in zip(numbers, values, strict=True):
        if not abs(value) <= LARGEST:
            return f"{short_repr(fields[i])} is not a number"
    if tag in graph.edges:
        graph.edges[tag].append(Edge(line, names[0], names[1], values))
    elif names[0] in graph.poses or names[0] in graph.places:
        return f"vertex {short_repr(names[0])} was given before"
    elif tag == "VERTEX_XY":
        graph.places[names[0]] = values
    elif match := POSE_NAME.fullmatch(names[0]):
        graph.poses[names[0]] = Pose(match[1], int(match[2]), values[0], values[1:])
    else:
        return f"pose {short_repr(names[0])} is not a letter and a number, like A0"
    return ""


# ---- A graph as a recording of a team

Chain = Sequence[str]  # the poses of a robot, by number


def find_runs(data: Path, description: TeamDescription) -> dict[str, Path]:
    """Return the files *.pyfg in a directory, or a file by itself."""
    found = {path.stem: path for path in (sorted(data.glob("*.pyfg")) if data.is_dir() else [data])}
    if not found:
        raise BadInput(f"{data}: no file ends with .pyfg; put the factor graphs there")
    return found


def read_run(place: Path, name: str, description: TeamDescription) -> TeamLog:
    """Read one file as one recording, of all its robots or of those that the description names."""
    graph = read_graph(place)
    relative, seen, ranges = (graph.edges[tag] for tag in ("EDGE_SE2", "EDGE_SE2_XY", "EDGE_RANGE"))
    chains: dict[str, list[str]] = {}
    for pose in sorted(graph.poses, key=lambda pose: graph.poses[pose][:2]):
        chains.setdefault(graph.poses[pose].robot, []).append(pose)
    if not chains:
        raise BadInput(f"{place}: no line VERTEX_SE2, and so no robot; is this a PyFG file?")
    moved = {(e.first, e.second): e.values for e in relative}
    still = [robot for robot, chain in chains.items() if moved.keys().isdisjoint(pairwise(chain))]
    if len(still) == len(chains):
        raise BadInput(f"{place}: no robot has odometry; add a line EDGE_SE2 from each pose to the next")
    graph.warnings.extend(f"{place}: robot {robot} has no odometry (EDGE_SE2); it was left out" for robot in still)
    chains = {robot: chain for robot, chain in chains.items() if robot not in still}
    following = {pair for chain in chains.values() for pair in pairwise(chain)}
    sightings = [e for e in relative if (e.first, e.second) not in following]
    chains = {robot: chains[robot] for robot in team_log.chosen_robots([*chains], description, place)}
    anchors = _places(graph, {e.second for e in ranges if e.second in graph.places})
    landmarks = _places(graph, {e.second for e in seen})
    odometry = tuple(_odometry(graph, chain, moved) for chain in chains.values())
    truth = tuple(_series(graph, chain, [graph.poses[pose].pose for pose in chain]) for chain in chains.values())
    robots, readings = tuple(chains), dict[team_log.Channel, team_log.ReadingSeries]()
    polar = [e._replace(values=_polar(*e.values[:2])) for e in (*sightings, *seen)]
    kinds: tuple[tuple[team_log.Kind, list[Edge], Places], ...] = (
        ("range", ranges, anchors),
        ("sighting", polar, landmarks),
    )
    for kind, edges, places in kinds:  # a measurement has the time of the first pose that it names
        first = [graph.poses[e.first] for e in edges]
        other = [graph.poses[e.second].robot if e.second in graph.poses else e.second for e in edges]
        values = np.array([e.values for e in edges], float).reshape(len(edges), len(edges[0].values) if edges else 1)
        measured = Measured(np.array([p.time for p in first]), [p.robot for p in first], other, values, str(place))
        channels, notes = split_channels(kind, [measured], robots, places.names)
        readings |= channels
        graph.warnings.extend(notes)
    warnings = tuple(dict.fromkeys(graph.warnings))
    return TeamLog(name, robots, "pose", odometry, truth, readings, landmarks, anchors, warnings)


def _odometry(graph: Graph, chain: Chain, moved: dict[tuple[str, str], tuple[float, ...]]) -> Series:
    """Return poses composed from the first, of the longest stretch without a missing step."""
    missing = [k for k, pair in enumerate(pairwise(chain)) if pair not in moved]
    begin, end = max(pairwise([-1, *missing, len(chain) - 1]), key=lambda ends: ends[1] - ends[0])
    stretch = chain[begin + 1 : end + 1]
    if missing:
        robot = graph.poses[chain[0]].robot
        lack = f"lacks {len(missing)} steps of odometry; it is read from {stretch[0]} to {stretch[-1]}"
        graph.warnings.append(f"{graph.path}: robot {robot} {lack}")
    steps = np.array([moved[pair] for pair in pairwise(stretch)], float).reshape(-1, 3)
    return _series(graph, stretch, team_log.compose_poses(steps))


def _series(graph: Graph, chain: Chain, rows: ArrayLike) -> Series:
    """Return a robot's poses (m, 3) with stamps that rise; of repeated stamps the first pose is kept."""
    values = np.array(rows, float)
    values[:, 2] = wrap(values[:, 2])
    time = np.array([graph.poses[name].time for name in chain])
    series, notes = order_series(time, values, f"{graph.path}, robot {graph.poses[chain[0]].robot}")
    graph.warnings.extend(notes)
    return series


def _polar(x: float, y: float) -> tuple[float, float]:
    """Return range and bearing of a place or pose in the frame of a robot."""
    return float(np.hypot(x, y)), float(np.arctan2(y, x))


def _places(graph: Graph, names: Collection[str]) -> Places:
    return Places(tuple(sorted(names)), np.array([graph.places[name] for name in sorted(names)], float).reshape(-1, 2))

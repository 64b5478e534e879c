"""The lines of a PyFG file: a factor graph as text, one vertex or edge a line, fields divided by blanks.

    VERTEX_SE2 time A0 x y theta            true pose of robot A; robots are letters, L is for landmarks
    VERTEX_XY L0 x y                        true place of a landmark (some files have a time before its name)
    VERTEX_SE2:PRIOR, VERTEX_XY:PRIOR       what an optimizer is to start from: not read
    EDGE_SE2 time A0 A1 x y theta cov (6)   pose of A1 in the frame of A0: odometry, a loop closure, or a sighting of B7
    EDGE_SE2_XY time A0 L0 x y cov (3)      place of a landmark in the frame of A0
    EDGE_RANGE time A0 L0 range variance    to a landmark, or a pose of another robot

Source: A. Papalia et al., PyFactorGraph, https://github.com/MarineRoboticsGroup/PyFactorGraph, io/pyfg_text.py.
"""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.text_tables import LARGEST, parse_number, read_text

POSE_NAME = re.compile(r"([A-Za-z]+)(\d{1,9})")


class Pose(NamedTuple):
    """A vertex of a robot."""

    robot: str
    number: int
    time: float  # [s]
    pose: tuple[float, ...]  # x, y [m], heading [rad]


class Edge(NamedTuple):
    """What was measured between two vertices."""

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

    def at(self, line: int) -> str:
        """The place of a line, for an error."""
        return f"{self.path}, line {line}"


def read_graph(path: Path) -> Graph:
    """The vertices and edges in a file. A last line that was cut off is left out, with a warning.

    Raises:
        BadInput: the file cannot be read, is of three dimensions, or a line is malformed; names the line.

    """
    text = read_text(path, "ascii")
    graph = Graph(path, {}, {}, [], [], [], [])
    lines = [(i, line.split()) for i, line in enumerate(text.split("\n"), 1) if line and not line.isspace()]
    unknown: dict[str, int] = {}
    for i, fields in lines:
        tag = fields[0]
        if tag in READ:
            try:
                READ[tag](graph, i, fields)
            except BadInput:
                if (i, fields) != lines[-1] or text.endswith("\n"):
                    raise
                graph.warnings.append(f"{graph.at(i)}: the last line is cut off; it was left out")
        elif tag.startswith(("VERTEX_SE3", "VERTEX_XYZ", "EDGE_SE3")):
            raise BadInput(f"{graph.at(i)}: {tag} is of three dimensions; only graphs in the plane (SE2, XY) are read")
        elif not tag.endswith(":PRIOR") and not tag.startswith("#"):
            unknown[tag] = unknown.get(tag, 0) + 1
    _require_vertices(graph)
    graph.warnings.extend(
        f"{path}: {n} lines of {tag!r}, which is not read, were left out" for tag, n in unknown.items()
    )
    return graph


def _pose(graph: Graph, line: int, fields: list[str]) -> None:
    time, *pose = _numbers(graph, line, fields, (1, 3, 4, 5), 6)
    name = fields[2]
    match = POSE_NAME.fullmatch(name)
    if not match:
        raise BadInput(f"{graph.at(line)}: pose {name!r} is not a letter and a number, like A0; correct its name")
    _require_new(graph, line, name)
    graph.poses[name] = Pose(match[1], int(match[2]), time, tuple(pose))


def _place(graph: Graph, line: int, fields: list[str]) -> None:
    timed = len(fields) == 5
    name = fields[2 if timed else 1] if len(fields) > 2 else ""
    place = _numbers(graph, line, fields, (3, 4) if timed else (2, 3), 5 if timed else 4)
    _require_new(graph, line, name)
    graph.places[name] = place


def _relative(graph: Graph, line: int, fields: list[str]) -> None:
    graph.relative.append(_edge(graph, line, fields, (4, 5, 6), 13))


def _seen(graph: Graph, line: int, fields: list[str]) -> None:
    graph.seen.append(_edge(graph, line, fields, (4, 5), 9))


def _range(graph: Graph, line: int, fields: list[str]) -> None:
    graph.ranges.append(_edge(graph, line, fields, (4,), 6))


def _edge(graph: Graph, line: int, fields: list[str], which: tuple[int, ...], total: int) -> Edge:
    values = _numbers(graph, line, fields, which, total)
    return Edge(line, fields[2], fields[3], values)


READ: Mapping[str, Callable[[Graph, int, list[str]], None]] = {
    "VERTEX_SE2": _pose,
    "VERTEX_XY": _place,
    "EDGE_SE2": _relative,
    "EDGE_SE2_XY": _seen,
    "EDGE_RANGE": _range,
}


def _numbers(graph: Graph, line: int, fields: list[str], which: tuple[int, ...], total: int) -> tuple[float, ...]:
    """Some fields of a line that should have so many."""
    if len(fields) != total:
        raise BadInput(
            f"{graph.at(line)}: {fields[0]} has {len(fields)} fields, not {total}; correct or remove the line"
        )
    values = tuple(parse_number(fields[i]) for i in which)
    for i, value in zip(which, values, strict=True):
        if not abs(value) <= LARGEST:
            raise BadInput(f"{graph.at(line)}: {fields[i]!r} is not a number; correct or remove the line")
    return values


def _require_new(graph: Graph, line: int, name: str) -> None:
    if name in graph.poses or name in graph.places:
        raise BadInput(f"{graph.at(line)}: vertex {name!r} was given before; remove one of the lines")


def _require_vertices(graph: Graph) -> None:
    """Refuse an edge whose vertices are not in the file; a range may name the landmark first, and is turned."""
    graph.ranges[:] = [
        e._replace(first=e.second, second=e.first) if e.first in graph.places else e for e in graph.ranges
    ]
    of_poses, of_places, of_all = graph.poses, graph.places, graph.poses | graph.places
    for edges, seconds in ((graph.relative, of_poses), (graph.seen, of_places), (graph.ranges, of_all)):
        for edge in edges:
            for name, known in ((edge.first, of_poses), (edge.second, seconds)):
                if name not in known:
                    raise BadInput(
                        f"{graph.at(edge.line)}: there is no vertex {name!r}; add its line, or remove this one"
                    )

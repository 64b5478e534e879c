"""PyFG factor graphs against a file written by hand."""

import numpy as np
import pytest

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings import pyfg
from cooploc.scenarios.recordings.schema import TeamDescription

COV = "0.01 0 0 0.01 0 0.001"
GRAPH = f"""\
VERTEX_SE2 10.0 A0 1.0 2.0 1.5707963267948966
VERTEX_SE2 11.0 A1 1.0 3.0 3.141592653589793
VERTEX_SE2 12.0 A2 0.0 3.0 3.141592653589793
VERTEX_SE2 10.0 B0 5.0 5.0 0.0
VERTEX_SE2 11.5 B1 6.0 5.0 0.0
VERTEX_XY L0 0.0 0.0
VERTEX_XY L1 4.0 0.0
VERTEX_SE2:PRIOR 10.0 A0 1.0 2.0 1.57 {COV}
EDGE_SE2 11.0 A0 A1 1.0 0.0 1.5707963267948966 {COV}
EDGE_SE2 12.0 A1 A2 1.0 0.0 0.0 {COV}
EDGE_SE2 11.5 B0 B1 1.0 0.0 0.0 {COV}
EDGE_SE2 12.0 A2 A0 1.0 0.0 0.0 {COV}
EDGE_SE2 10.0 B0 A0 -4.0 -3.0 1.57 {COV}
EDGE_SE2_XY 11.0 A1 L1 0.0 3.0 0.1 0 0.1
EDGE_RANGE 12.0 A2 B1 6.3 0.04
EDGE_RANGE 10.0 L0 A0 2.2 0.04
"""


def read_graph(folder, text=GRAPH, description=None):
    path = folder / "graph.pyfg"
    path.write_text(text)
    return pyfg.read_run(path, "graph", description)


def test_the_vertices_are_robots_their_truth_and_places(tmp_path):
    log = read_graph(tmp_path)
    assert log.robots == ("A", "B")
    np.testing.assert_allclose(log.truth[0].time, [10, 11, 12])
    np.testing.assert_allclose(log.truth[0].values, [[1, 2, np.pi / 2], [1, 3, np.pi], [0, 3, np.pi]])
    assert log.anchors.names == ("L0",)
    assert log.landmarks.names == ("L1",)
    np.testing.assert_allclose(log.landmarks.positions, [[4, 0]])


def test_robots_of_a_graph_may_be_chosen(tmp_path):
    log = read_graph(tmp_path, description=TeamDescription(format="pyfg", robots=("B",)))
    assert (log.robots, log.readings) == (("B",), {})
    with pytest.raises(BadInput, match="there is no robot 'C'; known are A, B"):
        read_graph(tmp_path, description=TeamDescription(format="pyfg", robots=("B", "C")))


def test_relative_poses_compose_to_odometry_from_the_origin(tmp_path):
    log = read_graph(tmp_path)
    assert log.odometry_kind == "pose"
    np.testing.assert_allclose(log.odometry[0].values, [[0, 0, 0], [1, 0, np.pi / 2], [1, 1, np.pi / 2]], atol=1e-12)


def test_edges_are_readings_of_mates_anchors_and_landmarks(tmp_path):
    readings = read_graph(tmp_path).readings
    assert [readings["range"][i].tolist() for i in range(4)] == [[12.0], [0], [1], [[6.3]]]
    assert [readings["anchor_range"][i].tolist() for i in range(4)] == [[10.0], [0], [0], [[2.2]]]
    np.testing.assert_allclose(readings["landmark"].values, [[3, np.pi / 2]])
    np.testing.assert_allclose(readings["sighting"].values, [[5, np.arctan2(-3, -4)]])
    assert (readings["sighting"].robot, readings["sighting"].other) == ([1], [0])


def test_of_odometry_with_a_missing_step_the_longest_stretch_is_read(tmp_path):
    log = read_graph(tmp_path, (GRAPH.replace(f"EDGE_SE2 11.0 A0 A1 1.0 0.0 1.5707963267948966 {COV}\n", "")))
    assert log.odometry[0].time.tolist() == [11, 12]
    np.testing.assert_allclose(log.odometry[0].values, [[0, 0, 0], [1, 0, 0]])
    assert any("robot A lacks 1 steps of odometry; it is read from A1 to A2" in warning for warning in log.warnings)


def test_a_graph_of_three_dimensions_is_refused(tmp_path):
    with pytest.raises(BadInput, match="three dimensions"):
        read_graph(tmp_path, (GRAPH.replace("VERTEX_XY L0 0.0 0.0", "VERTEX_XYZ L0 0.0 0.0 0.0")))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (COV, COV, "left out 1 reading of 'A' by itself"),
        ("B1 1.0 0.0 0.0 " + COV, "B1 1.0", "EDGE_SE2 has 5 fields, not 13; it was left out"),
        ("A1 1.0 3.0 ", "A1 1.0 x ", "line 2: 'x' is not a number; it was left out"),
        ("A2 B1 6.3", "A2 B9 6.3", "line 15: there is no vertex 'B9'; it was left out"),
        ("VERTEX_SE2 12.0 A2", "VERTEX_SE2 11.0 A2", "left out 1 line whose stamp was given before"),
        ("L1 4.0", "L0 4.0", "vertex 'L0' was given before; it was left out"),
        ("EDGE_SE2 11.5 B0 B1", "EDGE_SE2 11.5 B1 B0", "robot B has no odometry (EDGE_SE2); it was left out"),
    ],
)
def test_a_bad_line_is_left_out_and_said(tmp_path, old, new, said):
    assert old in GRAPH
    warnings = read_graph(tmp_path, (GRAPH.replace(old, new, 1))).warnings
    assert any(said in warning for warning in warnings), warnings

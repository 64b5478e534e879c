"""What columns are, by their names and values."""

import numpy as np
import pytest

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.inspect.columns import CsvTable, read_csv, table_of_fields
from cooploc.scenarios.recordings.inspect.naming import (
    file_pattern,
    name_meaning,
    pairs_by_number,
    pairs_with_places,
    pattern_of_mates,
    without_dates,
)
from cooploc.scenarios.recordings.inspect.table_parts import list_columns, name_estimates, parts_of

LINES = 40
ANGLE = np.linspace(0, 6, LINES)


def guessed(folder, columns, name="table.csv"):
    path = folder / name
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n")
    return {guess.column: guess for guess in read_csv(path, path.name).guesses}


@pytest.mark.parametrize(("name", "step", "quantity"), [("r", 0.1, "range"), ("quality", 0.1, ""), ("seen", 0, "")])
def test_the_only_number_beside_who_was_measured_is_a_range_unless_it_is_a_flag(tmp_path, name, step, quantity):
    columns = {"t": range(LINES), "from": ["a"] * LINES, "to": ["b"] * LINES}
    columns[name] = [1 + step * k for k in range(LINES)]
    assert guessed(tmp_path, columns)[name].quantity == quantity


@pytest.mark.parametrize(
    ("more", "name", "seen"),
    [
        ({}, "detections.csv", ["ahead", "left"]),
        ({}, "positions.csv", ["x", "y"]),
        ({"range": ANGLE + 1, "bearing": ANGLE / 9}, "detections.csv", ["x", "y"]),
        ({"robot": None}, "detections.csv", ["x", "y"]),  # of a camera above all, perhaps
    ],
)
def test_x_and_y_of_what_was_seen_are_ahead_and_to_the_left_if_it_is_said_who_saw(tmp_path, more, name, seen):
    columns = {"t": range(LINES), "robot": ["a"] * LINES, "tag_id": [7] * LINES, "x": ANGLE, "y": ANGLE + 1} | more
    found = guessed(tmp_path, {key: values for key, values in columns.items() if values is not None}, name)
    assert [found[q].quantity for q in "xy"] == seen


SWAY = np.sin(3 * ANGLE)


@pytest.mark.parametrize(
    ("vx", "vy", "turns", "meant"),
    [
        (np.cos(ANGLE), np.sin(ANGLE), {"w": np.full(LINES, ANGLE[1])}, "norm"),
        (np.cos(ANGLE), np.sin(ANGLE), {"yaw_deg": np.degrees(ANGLE + 1)}, "norm"),
        (np.cos(ANGLE), np.sin(ANGLE), {}, "to the side"),  # how the robot turns is not known
        (np.ones(LINES), SWAY, {"w": np.full(LINES, ANGLE[1])}, "to the side"),
        (np.cos(ANGLE), np.sin(ANGLE), {"w": np.zeros(LINES)}, "to the side"),  # it does not turn
        (np.ones(LINES), 0.1 * SWAY, {"w": np.full(LINES, ANGLE[1])}, "ahead"),
        (np.zeros(LINES), np.zeros(LINES), {"w": np.zeros(LINES)}, "ahead"),
        (np.full(LINES, "nan"), np.full(LINES, "nan"), {"w": np.zeros(LINES)}, "ahead"),
    ],
)
@pytest.mark.parametrize("robots", [1, 2])
def test_velocities_are_along_the_axes_of_the_world_if_they_turn_with_the_robot(tmp_path, vx, vy, turns, meant, robots):
    columns = {"time": np.arange(LINES), "robot": np.full(LINES, 1), "vx": vx, "vy": vy, **turns}
    columns = {name: np.repeat(values, robots) for name, values in columns.items()}
    columns["robot"][1::2] += robots - 1
    columns["vx"][1::2] = columns["vx"][1::2] if robots == 1 else columns["vx"][::-2]  # of another robot
    found = guessed(tmp_path, columns)
    assert found["vx"].norm == (("vx", "vy") if meant == "norm" else ())
    assert ("to the side" in found["vy"].reason) == (meant == "to the side")


def test_the_folder_of_a_file_may_say_what_it_is_about(tmp_path):
    (tmp_path / "red.csv").write_text("t,x,y\n" + "".join(f"{k},{k},{k}\n" for k in range(LINES)))
    sides = [
        read_csv(tmp_path / "red.csv", f"{folder}red.csv").guesses[1].side for folder in ("", "groundtruth/", "vio/")
    ]
    assert sides == ["", "truth", "odometry"]


def test_the_name_of_a_file_says_what_columns_of_anchors_hold_and_that_positions_are_odometry(tmp_path):
    columns = {"time": range(LINES), "beacon_1": np.linspace(1, 9, LINES), "landmark_id": [1, 2] * (LINES // 2)}
    found = guessed(tmp_path, columns, "ranges.csv")
    assert (found["beacon_1"].quantity, found["landmark_id"].quantity) == ("range", "other")
    columns = {"time": range(LINES), "pos_x": range(LINES), "gt_x": range(LINES)}
    assert [guess.side for guess in guessed(tmp_path, columns, "odometry.csv").values()] == ["odometry"] * 2 + ["truth"]


@pytest.mark.parametrize(("name", "table"), [("ekf", ""), ("slam", "truth"), ("filtered_gt", "truth")])
def test_what_a_filter_estimated_is_no_truth(tmp_path, name, table):
    (tmp_path / f"{name}.csv").write_text("t,x,y\n" + "".join(f"{k},{k},{k}\n" for k in range(LINES)))
    parts = parts_of(read_csv(tmp_path / f"{name}.csv", f"{name}.csv"))
    assert [part.table for part in parts] == [table] * bool(table)


@pytest.mark.parametrize(
    ("columns", "truth"),
    [
        (["odom_x", "odom_y", "odom_theta", "ekf_x", "ekf_y", "ekf_theta", "pf_x", "pf_y", "pf_theta"], None),
        (["v", "w", "x_est", "y_est", "theta_est"], None),
        (["odom_x", "odom_y", "odom_theta", "pf_x", "pf_y", "ekf_x", "ekf_y", "gnss_x", "gnss_y"], "gnss_x"),
        (["v", "w", "x_pred", "y_pred", "x_upd", "y_upd", "x_true", "y_true"], "x_true"),
        (["v", "w", "slam_x", "slam_y"], "slam_x"),  # it may be the reference
    ],
)
def test_columns_of_a_filters_estimates_are_no_truth_and_no_robots(tmp_path, columns, truth):
    lines = (",".join(f"{k * np.sin(j + 1):.4f}" for j in range(len(columns))) for k in range(LINES))
    text = "\n".join([f"t,{','.join(columns)}", *(f"{k},{line}" for k, line in enumerate(lines))])
    (tmp_path / "red.csv").write_text(text + "\n")
    file = read_csv(tmp_path / "red.csv", "red.csv")
    assert file.robots == ()
    assert [part.columns["x"].column for part in parts_of(file) if part.table == "truth"] == [truth] * bool(truth)
    assert name_estimates([file]).startswith("; what a filter estimated is none") == (truth != "slam_x")


@pytest.mark.parametrize(
    ("columns", "chosen"),
    [
        (["x_des", "y_des", "v_des", "w_des", "x", "y", "yaw", "v", "w"], ["v", "w", "x", "y", "yaw"]),
        (["goal_x", "goal_y", "err_x", "err_y", "e_x", "e_y", "x", "y", "v", "w"], ["v", "w", "x", "y"]),
        (["cmd_v", "cmd_w", "v", "w", "x", "y", "theta_ref"], ["v", "w", "x", "y"]),  # not the heading that was wanted
        (["cmd_v", "w", "ref_x", "ref_y", "ref_yaw"], ["cmd_v", "w", "ref_x", "ref_y", "ref_yaw"]),  # there is no other
        (["raw_v", "v", "w", "prev_x", "prev_y", "x", "y"], ["v", "w", "x", "y"]),
        (["gt_x_err", "gt_y_err", "gt_x", "gt_y", "v", "w"], ["v", "w", "gt_x", "gt_y"]),
    ],
)
def test_what_was_measured_comes_before_what_was_wanted_and_errors_are_nothing(tmp_path, columns, chosen):
    found = guessed(tmp_path, {"t": range(LINES), **{name: np.sin(range(LINES)) + k for k, name in enumerate(columns)}})
    file = CsvTable("red.csv", {}, tuple(found.values()))
    parts = {part.table: part.columns for part in parts_of(file)}
    motion = [parts["odometry"][q].column for q in ("speed", "turn_rate")]
    assert motion + [parts["truth"][q].column for q in ("x", "y", "heading") if q in parts["truth"]] == chosen


def test_a_tag_measures_anchors_and_not_the_other_way_round(tmp_path):
    columns = {"t": range(LINES), "anchorId": [0, 1] * (LINES // 2), "tagId": [0, 0, 1, 1] * (LINES // 4)}
    found = guessed(tmp_path, columns | {"range": np.linspace(1, 9, LINES)})
    assert (found["tagId"].quantity, found["anchorId"].quantity) == ("robot", "other")


@pytest.mark.parametrize(
    ("values", "quantity"),
    [([1.0, 2.0], "robot"), ([-1.0, 2.0], "robot"), ([-40.0, -41.0], ""), ([1.5, 2.5], "")],
)
def test_names_of_things_are_whole_numbers(tmp_path, values, quantity):
    found = guessed(tmp_path, {"t": range(LINES), "node1": values * (LINES // 2)})["node1"]
    assert found.quantity == quantity
    assert quantity or "negative or not whole" in found.reason


def test_of_two_columns_of_names_the_one_that_differs_says_whose_lines_they_are(tmp_path):
    columns = {"t": range(LINES), "agent_role": ["follower"] * LINES, "agent_id": [1, 2] * (LINES // 2)}
    found = guessed(tmp_path, columns | {"x": ANGLE, "y": np.sin(ANGLE)})
    assert [found[name].quantity for name in ("agent_role", "agent_id")] == ["", "robot"]
    found = guessed(tmp_path, columns | {"range": ANGLE})  # of a follower to two others
    assert [found[name].quantity for name in ("agent_role", "agent_id")] == ["robot", "other"]


@pytest.mark.parametrize("nothing", [np.nan, np.inf])
def test_a_column_without_a_finite_number_is_no_height(nothing):
    t = np.arange(40.0)
    fields = {"time": t, "x": 5 * np.sin(t), "y": [1.0] * 39 + [nothing], "z": [nothing] * 40}
    found = {
        guess.column: guess.quantity
        for guess in table_of_fields("/poses", {n: [*v] for n, v in fields.items()}).guesses
    }
    assert (found["x"], found["y"]) == ("x", "y")


def test_lists_in_fields_are_named(tmp_path):
    found = guessed(tmp_path, {"t": range(LINES), "distance": ['"(1.0, 2.0)"'] * LINES})
    assert found["distance"].reason.endswith("lists: write a line for each element")


@pytest.mark.parametrize(
    ("name", "columns", "quantities"),
    [
        ("gt.txt", [np.linspace(0, 9, LINES), np.zeros(LINES), 0.3 + 0.1 * np.sin(np.arange(LINES))], ["x", "y", ""]),
        ("gt.txt", [np.linspace(48.1, 48.101, LINES), np.linspace(11.5, 11.501, LINES)], ["", "", ""]),
        (
            "vio.txt",
            [np.cos(ANGLE), np.sin(ANGLE), np.degrees(ANGLE) + 90, *np.zeros((2, LINES))],
            ["x", "y", "heading"],
        ),
    ],
)
def test_speeds_are_no_headings_and_degrees_on_the_globe_no_metres_in_files_without_names(
    tmp_path, name, columns, quantities
):
    np.savetxt(tmp_path / name, np.stack([np.arange(LINES) / 10, *columns], -1))
    found = read_csv(tmp_path / name, name).guesses
    assert [guess.quantity for guess in found[1:4]] == quantities[: len(found) - 1]


def test_columns_with_numbers_are_listed_by_the_first_and_the_last():
    assert list_columns(["a", *(f"P{k}" for k in range(36)), "b1", "b2"]) == "a, P0 to P35, b1, b2"


@pytest.mark.parametrize(
    ("column", "quantity", "unit"),
    [
        ("t", "time", ""),
        ("timestamp [µs]", "time", "us"),
        ("x_ft", "x", "ft"),
        ("speed_ft_s", "speed", "ft/s"),
        ("Distance in m", "range", "m"),
        ("ranges.id", "robot", ""),
        ("r{robot}{other}", "range", ""),
        ("level_{robot}_{other}", "", ""),
        ("ranges.range.range", "range", ""),
        ("Time [ms]", "time", "ms"),
        ("timestamp_ns", "time", "ns"),
        ("header.stamp.sec", "sec", ""),
        ("header.stamp.nanosec", "nsec", ""),
        ("pos_y (mm)", "y", "mm"),
        ("gt_x_cm", "x", "cm"),
        ("theta_deg", "heading", "deg"),
        ("v [mm/s]", "speed", "mm/s"),
        ("linear.x", "speed", ""),
        ("angular.z", "turn_rate", ""),
        ("lin_x", "speed", ""),
        ("ang_z", "turn_rate", ""),
        ("lin_y", "", ""),
        ("ang_x", "", ""),
        ("rel_x", "ahead", ""),
        ("range_count", "", ""),
        ("euler_z", "heading", ""),
        ("delta_s", "dx", ""),
        ("d_y [mm]", "dy", "mm"),
        ("delta_theta_deg", "turn", "deg"),
        ("v_left", "", ""),
        ("gyro_z", "turn_rate", ""),
        ("gz", "turn_rate", ""),
        ("orientation.x", "", ""),
        ("max_range", "", ""),
        ("yaw_rate_deg", "turn_rate", "deg/s"),
        ("vtheta", "turn_rate", ""),
        ("v_theta", "turn_rate", ""),
        ("distance_mm", "range", "mm"),
        ("robotId", "robot", ""),
        ("anchor_id", "other", ""),
        ("battery", "", ""),
        ("battery_v", "", ""),
        ("w_dps", "turn_rate", "deg/s"),
        ("angular_velocity.z", "turn_rate", ""),
        ("angular_velocity.x", "", ""),
        ("twist.linear.y", "", ""),
        ("twist.angular.x", "", ""),
        ("velocity_y", "", ""),
        ("linear", "speed", ""),
        ("motor_angular_position", "", ""),
        ("linear_acceleration.x", "", ""),
        ("pos_x_std", "", ""),
        ("cov_linear_x", "", ""),
    ],
)
def test_a_name_says_quantity_and_unit(column, quantity, unit):
    assert name_meaning(column)[:2] == (quantity, unit)


@pytest.mark.parametrize("start", [0, 1.7e9])
@pytest.mark.parametrize(("scale", "unit"), [(1, "s"), (1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_stamps_have_the_unit_of_their_size_since_1970_or_of_their_interval(tmp_path, start, scale, unit):
    stamps = [f"{scale * (start + 0.1 * k):.9f}" for k in range(200)]
    found = guessed(tmp_path, {"time": stamps, "x": range(200)})["time"]
    assert (found.quantity, found.unit) == ("time", unit)


@pytest.mark.parametrize(
    ("name", "values", "unit"),
    [
        ("heading", np.linspace(-170, 170, LINES), "deg"),
        ("x", np.linspace(0, 5000, LINES), "mm"),
        ("x", np.linspace(0, 500, LINES), "cm"),
        ("range", np.where(np.arange(LINES) % 4, np.linspace(1, 9, LINES), 9999), "m"),  # 9999: none was measured
        ("omega", np.linspace(-60, 60, LINES), "deg/s"),
        ("v", np.linspace(0, 500, LINES), "mm/s"),
    ],
)
def test_values_say_the_unit_where_the_name_does_not(tmp_path, name, values, unit):
    found = guessed(tmp_path, {"t": np.arange(LINES) / 10, name: values})[name]
    assert found.unit == unit
    assert found.reason


def test_a_counter_named_x_is_a_length_and_others_are_unknown(tmp_path):
    columns = {"t": np.arange(LINES) / 10, "odom_x": np.arange(LINES) / 50, "volts": [12.1] * LINES}
    found = guessed(tmp_path, columns)
    assert [found[name].quantity for name in ("odom_x", "volts")] == ["length", ""]


def test_a_place_whose_x_only_rises_is_no_counter_where_y_stands_beside_it(tmp_path):
    t = np.arange(LINES) / 10
    found = guessed(tmp_path, {"t": t, "x": t, "y": np.sin(t)}, "odom_red.csv")
    assert [guess.quantity for guess in found.values()] == ["time", "x", "y"]
    found = guessed(tmp_path, {"t": t, "odom_x": t, "x": t, "y": np.sin(t)})  # x and y are of another
    assert found["odom_x"].quantity == "length"


@pytest.mark.parametrize(("beside", "quantity"), [("yaw_rate", "length"), ("speed", "range")])
def test_a_distance_of_odometry_that_only_rises_is_what_was_driven_where_no_speed_is(tmp_path, beside, quantity):
    t = np.arange(LINES) / 10
    found = guessed(tmp_path, {"t": t, "distance": t, beside: np.sin(t)}, "odom_red.csv")
    assert found["distance"].quantity == quantity


@pytest.mark.parametrize(
    ("columns", "quantities"),
    [
        ({"target": "red", "distance": 2.0, "angle": 1.0}, ["other", "range", "bearing"]),
        ({"x": 1.0, "y": 2.0, "angle": 1.0}, ["x", "y", "heading"]),
        ({"volts": 1.0, "angle": 1.0}, ["", ""]),
        ({"angle": 0.5, "x": 1.0, "y": 2.0, "yaw": 1.0}, ["", "x", "y", "heading"]),
        ({"steering_angle": 0.5, "x": 1.0, "y": 2.0}, ["", "x", "y"]),
        ({"speed": 0.3, "angle": 0.1}, ["speed", ""]),  # of a compass, or of the wheels: no turn rate
        ({"to": "red", "rssi": [-50, "-", "n/a", -60] * 10}, ["other", "rssi"]),
        ({"rx": ["red", "blue"] * 20, "tx": ["blue", "red"] * 20, "rssi": -50}, ["robot", "other", "rssi"]),
        ({"a": [1, 2] * 20, "b": [2, 1] * 20, "dist": 3.0}, ["robot", "other", "range"]),
        ({"requester_id": 1, "responder_id": 2, "responder_z": 0.0, "ra": 3.0}, ["robot", "other", "", "range"]),
        ({"id": 2, "tof": [1e-8, 2e-8] * 20, "tof_distance": 3.0}, ["robot", "", "range"]),  # seconds
        ({"id": ["A1", "A2"] * 20, "distanceFromTag": [3.5, 4.25] * 20}, ["robot", "range"]),
    ],
)
def test_a_quantity_may_follow_from_the_columns_beside(tmp_path, columns, quantities):
    every = {name: v if isinstance(v, list) else [v] * 40 for name, v in columns.items()}
    found = guessed(tmp_path, {"t": np.arange(40) / 10, **every})
    assert [found[name].quantity for name in columns] == quantities


@pytest.mark.parametrize(
    ("files", "pattern", "robots"),
    [
        (["odom_red.csv", "odom_blue.csv"], "odom_{robot}.csv", ("red", "blue")),
        (["red/odom.csv", "blue/odom.csv"], "{robot}/odom.csv", ("red", "blue")),
        (["red/odom_red.csv", "blue/odom_blue.csv"], "{robot}/odom_{robot}.csv", ("red", "blue")),
        (["robot1.csv", "robot2.csv", "robot10.csv"], "{robot}.csv", ("robot1", "robot2", "robot10")),
        (["odom_turtle_1.csv", "odom_wolf_2.csv"], "odom_{robot}.csv", ("turtle_1", "wolf_2")),
        (["odom_tb3_0.csv", "odom_tb3_1.csv"], "odom_{robot}.csv", ("tb3_0", "tb3_1")),
        (["odom_robot_0.csv", "odom_robot_1.csv"], "odom_robot_{robot}.csv", ("0", "1")),
        (["odom_husky 1.csv", "odom_jackal 1.csv"], "odom_{robot} 1.csv", ("husky", "jackal")),
        (["all.csv"], "all.csv", ()),
    ],
)
def test_what_differs_between_names_of_files_is_the_robot(files, pattern, robots):
    assert file_pattern(files) == (pattern, robots)


@pytest.mark.parametrize(
    ("columns", "own", "robots", "pattern"),
    [
        (["uwb_to_2", "uwb_to_3"], "robot1", ("robot1", "robot2", "robot3"), "uwb_to_{other}"),
        (["d_blue"], "red", ("red", "blue"), "d_{other}"),
        (["d1", "d2"], "robot1", ("robot1", "robot2"), ""),  # none of itself: these are of anchors
        (["d2"], "robot1", ("robot1", "robot2", "robot3"), ""),
        (["r12", "r13"], "robot1", ("robot1", "robot2", "robot3"), ""),
        (["to_1", "to_2"], "c", ("a1", "b1", "c"), ""),
    ],
)
def test_columns_of_each_teammate_have_a_pattern(columns, own, robots, pattern):
    assert pattern_of_mates(columns, own, robots, ()) == pattern


@pytest.mark.parametrize(
    ("columns", "pattern"),
    [
        (["d_A1", "d_A2", "d_blue"], "d_{other}"),
        (["d_A1", "d_A2"], "d_{other}"),
        (["d_A1", "d_red"], ""),  # of itself
        (["d_A1", "range_blue"], ""),
        (["d_A1", "d_A1"], ""),
    ],
)
def test_columns_of_teammates_and_places_have_a_pattern(columns, pattern):
    assert pattern_of_mates(columns, "red", ("red", "blue"), ("A1", "A2", "A3")) == pattern


@pytest.mark.parametrize(
    ("names", "places", "pattern"),
    [
        (["/red/anchor1/range", "/red/anchor2/range"], ["1", "2"], "/{robot}/anchor{other}/range"),
        (["/A1/red/rssi", "/A2/red/rssi"], ["A1", "A2"], "/{other}/{robot}/rssi"),
        (["/red/uwb2/range"], ["1", "2"], ""),  # 2 is a radio
        (["/green/A1", "/green/A2"], ["A1", "A2"], ""),
    ],
)
def test_topics_of_a_robot_and_each_place_have_a_pattern(names, places, pattern):
    assert pairs_with_places(names, ("red", "blue"), places) == dict.fromkeys(names * bool(pattern), pattern)


@pytest.mark.parametrize(
    ("names", "pattern"),
    [
        (["/tb_1/range_2", "/tb_2/range_1"], "/{robot}/range_{other}"),
        (["/tb_1/range_2", "/tb_2/range_1", "/tb_1/range_1", "/tb_2/range_2"], ""),  # sonars of each robot
        (["/tb_1/range_2"], ""),
    ],
)
def test_topics_of_a_robot_and_the_number_of_each_other_have_a_pattern(names, pattern):
    assert pairs_by_number(names, ("tb_1", "tb_2")) == dict.fromkeys(names * bool(pattern), pattern)


@pytest.mark.parametrize(
    ("scale", "title", "lost"), [(1, "", 0), (1e9, "", 0), (1, "Ground truth of Monday\n", 0), (1, "", 5)]
)
def test_eight_columns_of_numbers_are_stamp_position_and_orientation(tmp_path, scale, title, lost):
    lines = [f"{scale * (1.7e9 + k / 10):.0f} {k} 1.5 0 0 0 0.6 0.8" for k in range(LINES)]
    lines[:lost] = ["1700000000 nan nan nan nan nan nan nan"] * lost
    (tmp_path / "truth.txt").write_text(title + "\n".join(lines) + "\n")
    found = read_csv(tmp_path / "truth.txt", "truth.txt").guesses
    assert [guess.quantity for guess in found] == ["time", "x", "y", "", "", "", "", "heading"]
    assert [guess.unit for guess in found[:3]] == [{1: "s", 1e9: "ns"}[scale], "m", "m"]


SEVERAL = (
    "Things\n50\n,,red,,,blue,,\nFrame,Sub Frame,RZ,TX,TY,RZ,TX,TY\n,,rad,mm,mm,rad,mm,mm\n" + 9 * "1,0,2,3,4,5,6,7\n"
)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("time,x,y\n", "it has no line of data with 3 fields as in line 1"),
        ("# time,x,y\n", "it has no line of data with 3 fields as in line 1"),
        (SEVERAL, "most lines have 8 fields, and line 1, with the names, 1; leave one line above the numbers"),
    ],
)
def test_a_file_without_a_line_of_names_above_lines_of_numbers_is_refused(tmp_path, text, fault):
    (tmp_path / "odom.csv").write_text(text)
    with pytest.raises(BadInput, match=fault):
        read_csv(tmp_path / "odom.csv", "odom.csv")


@pytest.mark.parametrize(
    ("files", "found"),
    [
        (["red_2024-05-11-10-19-31.csv", "blue_20240511T101932.csv"], ["red_*.csv", "blue_*.csv"]),
        (["a-11.05.2024/uwb.txt", "b-1715422771.123/uwb.txt"], ["a-*/uwb.txt", "b-*/uwb.txt"]),
        (["red_20240511.csv", "red_20240512.csv"], []),  # two runs
        (["odom_20240511.csv", "odom_red.csv"], []),  # odom_*.csv would be both
        (["20240511.csv", "robot_12.csv", "uwb_0x1715422771ab.csv"], []),
    ],
)
def test_dates_in_names_of_files_are_left_open_where_one_file_has_the_rest(files, found):
    assert [*without_dates(files).values()] == found

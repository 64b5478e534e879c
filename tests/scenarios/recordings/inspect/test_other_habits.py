"""One team in the files that others would write: each is read as the same recording, without a log.toml by hand."""

import itertools
import re

import numpy as np
import pandas as pd
import pytest
from made_csv_teams import two_robots

import cooploc as cl
from cooploc import BadInput
from cooploc.scenarios.recordings.inspect.motion import robot_motion
from cooploc.scenarios.recordings.inspect.naming import match_names

pytestmark = pytest.mark.slow  # a second each; test_checks and test_infer_columns are quick
ROBOTS = ("red", "blue")

KINDS = "odom", "truth"


def renamed(words):
    return lambda files: {name: table.rename(columns=words) for name, table in files.items()}


def changed(**columns):
    """The files with functions applied to columns."""
    return lambda files: {
        name: table.assign(**{c: change(table[c]) for c, change in columns.items() if c in table})
        for name, table in files.items()
    }


def dates(form):
    return changed(time=lambda t: pd.to_datetime(t, unit="s").dt.round("us").dt.strftime(form))


def on_globe(files):
    """The truth in degrees on the globe."""
    for robot in ROBOTS:
        x, y = (files[f"truth_{robot}.csv"].pop(q) for q in "xy")
        files[f"truth_{robot}.csv"] = files[f"truth_{robot}.csv"].assign(lat=48 + y / 111_201, lon=11 + x / 74_628)
    return files


def quaternion(names):
    def change(files):
        for robot in ROBOTS:
            half = files[f"truth_{robot}.csv"].pop("theta") / 2
            columns = (0 * half, 0 * half, np.sin(half), np.cos(half))
            files[f"truth_{robot}.csv"][list(names)] = np.stack(columns[-len(names) :], -1)
        return files

    return change


def other_names(files):
    for new, old in (("truth_tb-01.csv", "truth_red.csv"), ("truth_tb-02.csv", "truth_blue.csv")):
        files[new] = files.pop(old)
    files["uwb.csv"] = files["uwb.csv"].replace({"red": "Robot 1", "blue": "Robot 2"})
    return {name.replace("odom_red", "odom_robot1").replace("odom_blue", "odom_robot2"): t for name, t in files.items()}


def wide(files):
    """All in one file, with columns for each robot; headings go on beyond pi."""
    table = pd.DataFrame({"time": files["odom_red.csv"]["time"]})
    for i, robot in enumerate(ROBOTS, 1):
        odometry, truth = files[f"odom_{robot}.csv"], files[f"truth_{robot}.csv"]
        table[f"v{i}"], table[f"w{i}"] = odometry["v"], odometry["omega"]
        table[[f"x{i}", f"y{i}"]], table[f"theta{i}"] = truth[["x", "y"]], np.unwrap(truth["theta"])
    ranges = files["uwb.csv"]
    table["d12"] = np.interp(table["time"], ranges["time"], ranges["range"])
    return {"all.csv": table}


def one_table(files):
    """Lines of all robots in one file of odometry and one of the truth, by rising stamps."""
    for kind in ("odom", "truth"):
        both = pd.concat([files.pop(f"{kind}_{robot}.csv").assign(robot=robot) for robot in ROBOTS])
        files[f"{kind}.csv"] = both.sort_values("time", kind="stable")
    return files


def ranges_each(files):
    ranges = files.pop("uwb.csv")
    for a, b in (ROBOTS, ROBOTS[::-1]):
        files[f"uwb_{a}.csv"] = ranges[ranges["from"] == a][["time", "range"]].rename(columns={"range": f"range_{b}"})
    return files


def pair_alone(files):
    """Ranges in a column that is named after two robots, in a file that says what it is about."""
    return files | {"uwb.csv": files["uwb.csv"][["time", "range"]].rename(columns={"range": "field.red_blue"})}


def matrix(files):
    """Ranges in a column for each pair of numbers, also of a robot and itself."""
    names = {"odom_red.csv": "r1_odom.csv", "odom_blue.csv": "r2_odom.csv"}
    names |= {name.replace("odom", "truth"): new.replace("odom", "truth") for name, new in names.items()}
    d = files.pop("uwb.csv")
    uwb = pd.DataFrame({"time": d["time"], "d11": 0.0, "d12": d["range"], "d21": d["range"], "d22": 0.0})
    return {names[name]: table for name, table in files.items()} | {"uwb.csv": uwb}


def one_export(files):
    """All in one file, a line for whatever was recorded, and empty fields for all else."""
    tables = [t.assign(robot=name[:-4].split("_")[1]) for name, t in files.items() if name != "uwb.csv"]
    return {"export.csv": pd.concat([*tables, files["uwb.csv"].rename(columns={"from": "robot"})]).sort_values("time")}


def folders(files):
    """A folder for each robot, whose ranges name the other alone."""
    found = {f"{name[:-4].split('_')[1]}/{name.split('_')[0]}.csv": t for name, t in files.items() if name != "uwb.csv"}
    for robot in ROBOTS:
        of = files["uwb.csv"].query("`from` == @robot").rename(columns={"to": "id"})
        found[f"{robot}/uwb.csv"] = of.drop(columns="from")
    return found


def bagpy(files):
    """Topics as bagpy writes them, a file for each pair."""
    names = {q: f"transform.translation.{q}" for q in "xy"} | {f"q{q}": f"transform.rotation.{q}" for q in "xyzw"}
    found, poses = {}, quaternion(["qx", "qy", "qz", "qw"])(files)
    for robot, other in (ROBOTS, ROBOTS[::-1]):
        odometry = poses[f"odom_{robot}.csv"].rename(columns={"v": "twist.linear.x", "omega": "twist.angular.z"})
        found[f"{robot}-odom.csv"] = odometry.assign(**{"twist.covariance": "(0.0, 0.0)"})
        found[f"vicon-{robot}-{robot}.csv"] = poses[f"truth_{robot}.csv"].rename(columns=names)
        of = files["uwb.csv"].query("`from` == @robot")[["time", "range"]]
        found[f"{robot}-uwb-{other}.csv"] = of.assign(min_range=0.0, max_range=50.0)
    return found


def two_tags(files):
    """A folder for each robot, whose two tags have numbers; beside the range the raw one, the true one, and anchors."""
    found, tags = folders(files), {"red": ("10", "11"), "blue": ("20", "21")}
    for robot, other in (ROBOTS, ROBOTS[::-1]):
        ranges = found[f"{robot}/uwb.csv"].drop(columns="id").reset_index(drop=True)
        ends = {"from_id": tags[robot], "to_id": tags[other]}
        ranges = ranges.assign(**{c: [names[k % 2] for k in range(len(ranges))] for c, names in ends.items()})
        anchors = ranges.iloc[::5].assign(to_id="1", time=ranges["time"] + 0.01)
        both = pd.concat([ranges, anchors]).sort_values("time")
        found[f"{robot}/uwb.csv"] = both.assign(range_raw=both["range"] + 0.3, gt_range=both["range"] - 0.02)
    return found


def no_reading(files):
    """Ranges of 65.535 m where none was measured."""
    none = files["uwb.csv"].iloc[::7].assign(range=65.535, time=lambda t: t["time"] + 0.01)
    return {**files, "uwb.csv": pd.concat([files["uwb.csv"], none]).sort_values("time")}


def with_units(text):
    """The text with a line of units, in words, below the names of the columns."""
    head, lines = text.split("\n", 1)
    return "\n".join(["// Monday", head, ",".join("s" for _ in head.split(",")), lines])


def as_echo(table, path):
    """As `ros2 topic echo` prints messages."""
    messages = []
    for row in table.itertuples():
        stamp = f"header:\n  stamp:\n    sec: {int(row.time)}\n    nanosec: {round(row.time % 1 * 1e9)}\ndata:\n"
        fields = "".join(f"  {name}: {value!r}\n" for name, value in zip(table.columns[1:], row[2:], strict=True))
        messages.append(f"{stamp}{fields}  covariance:\n  - 0.0\n  - x: 1.0\n---\n")
    path.with_suffix(".txt").write_text("".join(messages) + "header:\n  stamp:\n    sec: 1")


def with_degrees(text):
    """The text with the units of columns below their names."""
    head, lines = text.split("\n", 1)
    units = {"time": "s", "omega": "deg/s", "theta": "deg", "v": "m/s"}
    return "\n".join([head, ",".join(units.get(column, "") for column in head.split(",")), lines])


def in_feet(files):
    feet = changed(**dict.fromkeys(("x", "y", "v", "range"), lambda metres: metres / 0.3048))
    return renamed({"x": "x_ft", "y": "y_ft", "v": "speed_ft_s", "range": "range (feet)"})(feet(files))


SAME, GERMAN = dict, {"time": "Zeit", "v": "Geschwindigkeit", "omega": "Drehrate", "theta": "Winkel"}
GERMAN |= {"from": "von", "to": "nach", "range": "Entfernung"}
SPANISH = {"time": "tiempo", "v": "velocidad", "omega": "velocidad angular", "theta": "orientación"}
SPANISH |= {"from": "desde", "to": "hasta", "range": "distancia"}
ROS = {"time": "field.header.stamp", "v": "field.twist.linear.x", "omega": "field.twist.angular.z"}
DEGREES = dict.fromkeys(("omega", "theta"), np.degrees) | {c: lambda x: 1000 * x for c in ("x", "y", "v", "range")}


def as_json_lines(table, path):
    """A JSON object a line, the last of them torn."""
    text = table.to_json(orient="records", lines=True, double_precision=15)
    path.with_suffix(".jsonl").write_text(text + text[: text.index("\n") // 2])


def as_json(options):
    def write(table, path):
        text = table.reset_index(drop=True).to_json(double_precision=15, **options)
        path.with_suffix(".json").write_text(f'{{"data": {text}}}')

    return write


def numbers_alone(files):
    """Robots by number, poses with quaternions as TUM has them, ranges of each robot's own file."""
    files = quaternion(["qx", "qy", "qz", "qw"])(files)
    ranges = files.pop("uwb.csv")
    for number, robot in enumerate(ROBOTS, 1):
        files[f"odom_{number}.txt"], truth = files.pop(f"odom_{robot}.csv"), files.pop(f"truth_{robot}.csv")
        truth.insert(3, "z", 0.0)
        files[f"gt_{number}.txt"] = truth
        own = ranges[ranges["from"] == robot]
        files[f"uwb_{number}.txt"] = own[["time"]].assign(to=3.0 - number, range=own["range"])
    return files


def spreadsheet(files):
    """Two columns of one name and two without one, and a receiver of satellites beside the true positions."""
    for robot in ROBOTS:
        far = files[f"truth_{robot}.csv"][["time", "x", "y"]] + [0.0, 1.0, -1.0]
        files[f"gnss_{robot}.csv"] = far
    for name, table in files.items():
        files[name] = table.assign(n1=1, e1="", n2=2, e2="").rename(columns={"n1": "n", "n2": "n", "e1": "", "e2": ""})
    return files


def compass(files):
    """Headings clockwise from north, which is along y."""
    turned = changed(theta=lambda heading: np.degrees(np.pi / 2 - heading) % 360)(files)
    return renamed({"theta": "compass_deg"})(turned)


# How the tables are changed, how they are written, and how their text is changed.
HABITS = {
    "Parquet": (SAME, lambda table, path: table.set_index("time").to_parquet(path.with_suffix(".parquet")), None),
    "JSON lines": (SAME, as_json_lines, None),
    "an echo": (SAME, as_echo, None),
    "JSON columns": (SAME, as_json({}), None),
    "JSON objects": (SAME, as_json({"orient": "records"}), None),
    "a compass": (compass, {}, None),
    "decimal commas": (renamed(GERMAN), {"sep": ";", "decimal": ","}, None),
    "Spanish": (renamed(SPANISH), {"encoding": "latin-1"}, None),
    "UTF-16": (SAME, {"encoding": "utf-16"}, None),
    "millimetres and degrees": (changed(**DEGREES), {"encoding": "utf-8-sig", "lineterminator": "\r\n"}, None),
    "feet": (in_feet, {}, None),
    "units below": (changed(omega=np.degrees, theta=np.degrees), {}, with_degrees),
    "microseconds": (lambda f: renamed({"time": "t (µs)"})(changed(time=lambda t: (1e6 * t).round())(f)), {}, None),
    "the only number": (renamed({"range": "r"}), {}, None),
    "nanoseconds": (changed(time=lambda t: (1e9 * t).round().astype("int64")), {"index": True}, None),
    "dates": (dates("%Y-%m-%dT%H:%M:%S.%fZ"), {}, None),
    "times of day": (dates("%H:%M:%S.%f"), {}, None),
    "quaternions": (quaternion(["qx", "qy", "qz", "qw"]), {}, None),
    "quaternions of EuRoC": (quaternion([f"q_RS_{q} []" for q in "xyzw"]), {}, None),
    "half quaternions": (quaternion(["pose.orientation.z", "pose.orientation.w"]), {}, None),
    "names of ROS": (renamed(ROS), {}, lambda text: "%" + text),
    "a comment with the names": (SAME, {"sep": " "}, lambda text: "# by hand\n# " + text),
    "a line of units": (SAME, {}, with_units),
    "empty fields at the ends": (SAME, {}, lambda text: text.replace("\n", ",\n").replace(",\n", "\n", 1)),
    "words": (lambda files: {name: t.assign(status="OK") for name, t in files.items()}, {}, None),
    "other names": (other_names, {}, None),
    "wide": (wide, {}, None),
    "one table": (one_table, {}, None),
    "a column for each": (ranges_each, {}, None),
    "one export": (lambda files: one_export(changed(theta=lambda h: np.unwrap(h) + 4 * np.pi)(files)), {}, None),
    "a column of a pair": (pair_alone, {}, None),
    "folders": (folders, {}, None),
    "two tags": (two_tags, {}, None),
    "bagpy": (bagpy, {}, None),
    "one export with quaternions": (lambda files: one_export(quaternion(["qx", "qy", "qz", "qw"])(files)), {}, None),
    "compressed": (lambda files: {f"{name}.gz": t for name, t in files.items()}, {}, None),
    "ranges that mean none": (no_reading, {}, None),
    "a title": (SAME, {}, lambda text: "Lab 3; by Bob, on Monday\nin the afternoon\n" + text),
    "the last line first": (lambda files: {name: t[::-1] for name, t in files.items()}, {}, None),
    "a write that was interrupted": (SAME, {}, lambda text: text + 4096 * "\0"),
    "a matrix of ranges": (matrix, {}, None),
    "no names": (SAME, {"header": False, "index": True}, None),
    "a spreadsheet": (spreadsheet, {}, None),
    "numbers alone": (numbers_alone, {"header": False, "sep": " "}, None),
    "names again": (SAME, {}, lambda text: text.replace("\n", "\n" + text.split("\n")[0] + "\n", 2)),
}


@pytest.mark.parametrize("habit", HABITS)
def test_the_team_is_read_from_files_as_others_write_them(tmp_path, habit):
    change, options, rewrite = HABITS[habit]
    tables = {name: pd.DataFrame(columns) for name, columns in two_robots(seconds=40).items()}
    want = {
        robot: (tables[f"odom_{robot}.csv"].to_numpy(), tables[f"truth_{robot}.csv"].to_numpy()) for robot in ROBOTS
    }
    for name, table in change(tables).items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)  # pandas compresses what ends with .gz
        if callable(options):
            options(table, path)
        else:
            table.to_csv(path, **({"index": False} | options))
        if rewrite:
            path.write_text(rewrite(path.read_text()))
    inspected = cl.inspect(tmp_path).inspected
    log, day = inspected.log, 86_400 if habit == "times of day" else np.inf
    assert inspected.trial.problem == ""
    assert {finding.kind for finding in inspected.findings} <= {"dropped"}
    assert list(log.readings) == ["range"]
    assert log.readings["range"].values.max() < 60
    for i, one in enumerate(ROBOTS):
        k = log.robots.index(one) if one in log.robots else i
        (t, *u), (_, *pose) = want[one][0].T, want[one][1].T
        np.testing.assert_allclose(log.odometry[k].time, t % day, atol=2e-5)
        np.testing.assert_allclose(log.odometry[k].values, np.transpose(u), atol=1e-6)
        np.testing.assert_allclose(log.truth[k].values[:, :2], np.transpose(pose[:2]), atol=1e-6)
        np.testing.assert_allclose(np.sin(log.truth[k].values[:, 2]), np.sin(pose[2]), atol=1e-6)


def test_columns_for_each_robot_and_anchor_stand_beside_those_of_pairs(tmp_path):
    tables = {name: pd.DataFrame(columns) for name, columns in two_robots(seconds=40).items()}
    table = wide(tables)["all.csv"]
    corners = {"A1": (0.0, 0.0), "A2": (8.0, 8.0)}
    for i, (name, (x, y)) in itertools.product((1, 2), corners.items()):
        table[f"d{i}_{name}"] = np.hypot(table[f"x{i}"] - x, table[f"y{i}"] - y)
    table.to_csv(tmp_path / "all.csv", index=False)
    pd.DataFrame([(name, *at) for name, at in corners.items()], columns=["id", "x", "y"]).to_csv(
        tmp_path / "anchors.csv", index=False
    )
    log = cl.inspect(tmp_path).inspected.log
    assert {channel: len(series.time) for channel, series in log.readings.items()} == {
        "range": len(table),
        "anchor_range": 4 * len(table),
    }


def test_a_lone_robot_that_measured_beacons_needs_no_names_and_steps_are_no_speeds(tmp_path):
    tables = {name: pd.DataFrame(columns) for name, columns in two_robots(seconds=60).items()}
    odometry, truth = tables["odom_red.csv"], tables["truth_red.csv"]
    odometry[["v", "omega"]] *= np.median(np.diff(odometry["time"]))
    beacons = pd.DataFrame({"id": [1, 6], "x": [0.0, 8.0], "y": [0.0, 8.0]})
    ranges = pd.concat(
        [
            truth[["time"]].assign(tag=7.0, to=b.id, r=np.hypot(truth.x - b.x, truth.y - b.y))
            for b in beacons.itertuples()
        ]
    )
    for name, table in {"odom.txt": odometry, "gt.txt": truth, "ranges.txt": ranges.sort_values("time")}.items():
        table.to_csv(tmp_path / name, sep=" ", index=False, header=False)
    beacons.to_csv(tmp_path / "beacons.csv", index=False)
    inspected = cl.inspect(tmp_path).inspected
    assert [(f.kind, f.setting.split(",")[0]) for f in inspected.findings] == [("scale", 'kind = "increment"')]
    assert len(inspected.log.readings["anchor_range"].time) == 2 * len(truth)


def numbered(files):
    """The robots are 1 and 2."""
    return {name.replace("red", "robot1").replace("blue", "robot2"): table for name, table in files.items()}


def test_anchors_are_meant_by_their_numbers(team):
    places = pd.DataFrame({"id": ["a1", "a2"], "x": [0.0, 8.0], "y": [0.0, 8.0]})

    def lines(files):
        ranges = [files["uwb.csv"].assign(to=k, range=9.0) for k in (1, 2)]
        return {**files, "anchors.csv": places, "uwb.csv": pd.concat(ranges).sort_values("time")}

    def columns(files):
        own = files.pop("uwb.csv").drop(columns=["to", "range"]).assign(d1=9.0, d2=9.0)
        return {**files, "anchors.csv": places, "uwb.csv": own}

    for change in (lines, columns):
        readings = cl.inspect(team(change), again=True).inspected.log.readings["anchor_range"]
        assert {*readings.other} == {0, 1}
    found = cl.inspect(team(lambda files: numbered(columns(files))), again=True).inspected
    assert "anchor_range" not in found.log.readings  # d1 may be of robot 1


def test_places_of_who_was_seen_are_sightings_and_tags_stand_beside_anchors(team):
    """dx and dy are places there, and not odometry; beside T2, which is robot2, A1 is an anchor."""
    places = {"A1": (0.0, 0.0), "A2": (8.0, 8.0)}
    anchors = pd.DataFrame([(name, *at) for name, at in places.items()], columns=["id", "x", "y"])

    def change(files):
        uwb = files.pop("uwb.csv")
        seen = uwb.drop(columns="range").rename(columns={"from": "observer", "to": "target"})
        found = {"seen.csv": seen.replace({"red": "robot1", "blue": "robot2"}).assign(dx=3.0, dy=4.0)}
        for robot, mate in (("red", "T2"), ("blue", "T1")):
            own = uwb[uwb["from"] == robot][["time", "range"]]
            every = pd.concat([own.assign(id=mate), *(own.assign(id=name) for name in places)])
            found[f"tag_{robot}.csv"] = every.sort_values("time", kind="stable")
        return numbered({**files, **found}) | {"anchors.csv": anchors}

    readings = cl.inspect(team(change), again=True).inspected.log.readings
    assert {*readings} == {"range", "anchor_range", "sighting"}
    assert {*readings["anchor_range"].other} == {0, 1}
    np.testing.assert_allclose(readings["sighting"].values[0], [5.0, np.arctan2(4, 3)])


def test_lengths_that_span_far_are_metres_where_that_fits_what_else_was_recorded(team):
    """Fifty times as large: a hundred metres. As centimetres they would be driven a hundred times as slowly as said."""
    larger = changed(**dict.fromkeys(("x", "y", "v", "range"), lambda metres: 52 * metres))
    found = cl.inspect(team(larger), again=True).inspected
    assert found.findings == ()
    assert np.ptp(found.log.truth[0].values[:, 0]) > 100
    assert not any("[cm]" in meaning for _, _, meaning, _ in found.columns)
    slower = changed(**dict.fromkeys(("x", "y", "range"), lambda metres: 100 * metres))  # these are centimetres
    found = cl.inspect(team(slower), again=True).inspected
    assert found.findings == ()
    assert np.ptp(found.log.truth[0].values[:, 0]) < 10


def test_robots_and_anchors_may_have_the_same_numbers(team):
    places = {1: (0.0, 0.0), 2: (10.0, 0.0), 3: (5.0, 8.0)}

    def numbers(files):
        robots = {"red": 1, "blue": 2}
        both = [pd.concat([files[f"{kind}_{r}.csv"].assign(id=n) for r, n in robots.items()]) for kind in KINDS]
        truth = both[1].sort_values("time")
        ranges = [
            truth[["time", "id"]].assign(anchor=k, range=np.hypot(truth.x - x, truth.y - y))
            for k, (x, y) in places.items()
        ]
        anchors = pd.DataFrame([(k, *place) for k, place in places.items()], columns=["id", "x", "y"])
        return {
            "odom.csv": both[0].sort_values("time"),
            "truth.csv": truth,
            "uwb.csv": pd.concat(ranges),
            "anchors.csv": anchors,
        }

    found = cl.inspect(team(numbers)).inspected
    assert found.log.anchors.names == ("a1", "a2", "a3")
    assert (list(found.log.readings), found.findings, found.trial.problem) == (["anchor_range"], (), "")


def test_positive_signal_strengths_are_dbm_without_their_sign(team):
    def measured(files):
        files["uwb.csv"]["rssi"] = 50 + 20 * np.log10(files["uwb.csv"].pop("range"))
        return files

    found = cl.inspect(team(measured)).inspected
    assert 'rssi = { column = "rssi", unit = "-dBm" }' in found.text
    assert found.log.readings["rssi"].values.max() < 0


def seen(files):
    """The ranges with bearings, as a camera sees them."""
    ranges = files.pop("uwb.csv")
    at = {robot: files[f"truth_{robot}.csv"] for robot in ROBOTS}
    here, there = (
        np.array(
            [[np.interp(t, at[n]["time"], at[n][q]) for q in "xy"] for t, n in zip(ranges["time"], names, strict=True)]
        )
        for names in (ranges["from"], ranges["to"])
    )
    headings = {robot: np.unwrap(truth["theta"]) for robot, truth in at.items()}
    heading = [np.interp(t, at[n]["time"], headings[n]) for t, n in zip(ranges["time"], ranges["from"], strict=True)]
    (x, y) = (there - here).T
    files["camera.csv"] = ranges.assign(bearing=np.angle(np.exp(1j * (np.arctan2(y, x) - heading))))
    return files


TURNED = {  # how the files are changed: the kind of finding, and what its setting writes into log.toml
    "turn sign": (
        changed(omega=lambda w: -w),
        [('turn_rate = "omega"', 'turn_rate = { column = "omega", unit = "-rad/s" }')],
    ),
    "heading": (changed(theta=lambda h: h + 0.7), [("[truth]", "[truth]\nheading_offset = -0.7")]),
    "clockwise": (
        changed(theta=lambda h: np.pi / 2 - h),
        [
            ("[truth]", "[truth]\nheading_offset = { red = 1.5708, blue = 1.5708 }"),
            ('heading = "theta"', 'heading = { column = "theta", unit = "-rad" }'),
        ],
    ),
    "bearing": (
        lambda files: changed(bearing=lambda b: -b)(seen(files)),
        [('bearing = "bearing"', 'bearing = { column = "bearing", unit = "-rad" }')],
    ),
    "camera": (
        lambda files: changed(bearing=lambda b: b + 0.5)(seen(files)),
        [("[sightings]", "[sightings]\nbearing_offset = -0.5")],
    ),
}


@pytest.mark.parametrize("name", TURNED)
def test_what_is_turned_or_of_the_wrong_sign_is_corrected_by_its_setting(team, name):
    change, settings = TURNED[name]
    folder = team(change)
    inspected = cl.inspect(folder).inspected
    assert {one.kind for one in inspected.findings} == {{"clockwise": "heading", "camera": "bearing"}.get(name, name)}
    text, said = inspected.text, inspected.findings[0].change
    assert all(word in said for word in re.findall(r"-rad|heading_offset|bearing_offset", str(settings)))
    for old, new in settings:
        text = text.replace(old, new, 1)
    (folder / "log.toml").write_text(text)
    assert cl.inspect(folder).inspected.findings == ()


def test_beside_a_robot_by_its_name_a_number_is_of_no_robot():
    assert match_names(["robot1", "robot2", "a1", "a2"], ["robot1", "robot2"]) == {}
    assert match_names(["1", "2"], ["robot1", "robot2"]) == {"1": "robot1", "2": "robot2"}
    assert match_names(["r0", "r01"], ["0", "1"]) == {"r0": "0", "r01": "1"}
    counted_from_one = {"1": "tb3_0", "2": "tb3_1", "3": "tb3_2"}
    assert match_names(["2", "1", "3"], [*counted_from_one.values()]) == counted_from_one
    assert match_names(["1", "2"], [*counted_from_one.values()]) == {"1": "tb3_1", "2": "tb3_2"}
    assert match_names(["2", "3", "4"], ["1", "2", "3"]) == {}  # two of them are robots by their names


def test_numbers_that_a_robot_would_share_with_itself_are_of_anchors(team):
    folder = team(other_names)
    ranges = pd.read_csv(folder / "uwb.csv")[["time", "range"]]
    (folder / "uwb.csv").unlink()
    for robot in (1, 2):
        ranges.assign(anchor_id=[1 + k % 3 for k in range(len(ranges))]).to_csv(
            folder / f"uwb_robot{robot}.csv", index=False
        )
    found = cl.inspect(folder).inspected
    assert "range" not in found.log.readings
    assert any("'1', '2', '3': neither a robot of the team nor a place" in finding.fact for finding in found.findings)


def test_places_in_a_file_that_is_not_read_are_named(team):
    folder = team()
    (folder / "anchors.yaml").write_text("a1: [0, 0]\n")
    assert "anchors.yaml: not read; write its places into [anchors]" in cl.inspect(folder).inspected.unused


def test_columns_that_are_left_are_named_once_for_all_files(team):
    folder = team()
    for name in ("uwb.csv", "truth_red.csv", "truth_blue.csv"):
        table = pd.read_csv(folder / name)
        table.assign(**({"range_raw": 1.0} if name == "uwb.csv" else {"remark": "dry"})).to_csv(
            folder / name, index=False
        )
    unused = cl.inspect(folder).inspected.unused
    assert {"uwb.csv: columns range_raw", "truth_blue.csv, truth_red.csv: columns remark"} <= {*unused}


def test_relative_positions_are_sightings(team):
    def relative(files):
        files = seen(files)
        camera = files["camera.csv"]
        d, bearing = camera.pop("range"), camera.pop("bearing")
        files["camera.csv"] = camera.assign(rel_x=d * np.cos(bearing), rel_y=d * np.sin(bearing))
        return files

    (polar, plain) = (cl.inspect(team(change), again=True).inspected for change in (seen, relative))
    assert 'x = "rel_x"' in plain.text
    assert plain.findings == ()
    np.testing.assert_allclose(plain.log.readings["sighting"].values, polar.log.readings["sighting"].values, atol=1e-9)


def gyroscope(late=0.0, headings=False, counter=False):
    """The odometry in two files: speeds or metres, and turn rates or headings at twice as many stamps."""

    def change(files):
        for robot in ROBOTS:
            both = files.pop(f"odom_{robot}.csv")
            time, v, omega = both[["time", "v", "omega"]].to_numpy(float).T
            driven, heading = (np.append(0.0, np.cumsum(np.diff(time) * rate[:-1])) for rate in (v, omega))
            files[f"wheel_{robot}.csv"] = pd.DataFrame(
                {"time": time, "odometer" if counter else "v": [v, driven][counter]}
            )
            dense = np.sort(np.append(time, time[:-1] + np.diff(time) / 2))
            values = np.interp(dense, time, heading) if headings else omega[np.searchsorted(time, dense, "right") - 1]
            imu = {"time": dense + late, "ax": 0.1, "yaw" if headings else "gz": values}
            files[f"imu_{robot}.csv"] = pd.DataFrame(imu)
        return files

    return change


@pytest.mark.parametrize("how", [{}, {"headings": True}, {"counter": True}])
def test_odometry_in_two_files_is_that_of_one(team, how):
    whole, found = (cl.inspect(folder).inspected.log for folder in (team(), team(gyroscope(**how))))
    for i in range(2):
        one, two = (robot_motion(log, i).odometry for log in (whole, found))
        for of_one, of_two in ((one.length, two.length), (one.turn, two.turn)):
            np.testing.assert_allclose(np.interp(one.time, two.time, of_two) - of_two[0], of_one, atol=2e-4)


def test_a_gyroscope_with_a_clock_of_its_own_is_found_and_corrected(team):
    folder = team(gyroscope(late=2.5))
    found = cl.inspect(folder).inspected
    assert {(one.kind, one.table) for one in found.findings} == {("clock", "turns")}
    offset = found.findings[0].setting.partition(" = ")[2]
    assert abs(float(offset) + 2.5) < 0.6
    text = found.text.replace("[turns]", f"[turns]\nclock_offset = {offset}")
    (folder / "log.toml").write_text(text)
    assert not [one for one in cl.inspect(folder).inspected.findings if one.kind == "clock"]


def test_a_truth_in_degrees_on_the_globe_is_in_metres(team):
    found, files = cl.inspect(team(on_globe)).inspected, two_robots(seconds=60)
    assert "origin = [48.0" in found.text
    assert (found.findings, found.trial.problem) == ((), "")
    for robot, truth in zip(found.log.robots, found.log.truth, strict=True):
        want = np.stack([files[f"truth_{robot}.csv"][q] for q in "xy"], -1)
        np.testing.assert_allclose(truth.values[:, :2] - truth.values[0, :2], want - want[0], atol=0.01)


@pytest.mark.parametrize(("turn", "unit"), [(86_400, 1), (604_800, 1), (2**32, 1000), (2**32, 1e6)])
def test_a_clock_that_begins_again_goes_on(team, turn, unit):
    start = two_robots(seconds=60)["odom_red.csv"]["time"][0]
    found = cl.inspect(team(changed(time=lambda t: ((t - start) * unit + turn - 20 * unit).round(3) % turn))).inspected
    assert {one.kind for one in found.findings} == {"dropped"}
    assert all("they go on from there" in one.fact for one in found.findings)
    for series in found.log.odometry:
        np.testing.assert_allclose(np.diff(series.time), 0.1, atol=2e-3)


def test_speeds_that_are_twice_the_truths_are_found(team):
    found = cl.inspect(team(changed(v=lambda v: 2 * v))).inspected.findings
    assert {(one.kind, one.robot) for one in found} == {("scale", robot) for robot in ROBOTS}


def test_signal_strengths_that_mean_none_are_left_out(team):
    def measured(files):
        rssi = -50 - 20 * np.log10(files["uwb.csv"].pop("range"))
        files["uwb.csv"]["rssi"] = rssi.where(np.arange(len(rssi)) % 7 > 0, -127.0)
        return files

    found = cl.inspect(team(measured)).inspected
    assert "missing_below = -126" in found.text
    assert found.log.readings["rssi"].values.min() > -80


def test_turns_that_cannot_be_joined_are_one_line(team):
    with pytest.raises(BadInput, match=r"wheel_blue.csv, .*imu_blue.csv: they have no time in common; correct time or"):
        cl.inspect(team(gyroscope(late=1e6)))
    folder = team(gyroscope())
    text = cl.inspect(folder).inspected.text
    for changed, said in (
        (text.replace('speed = "v"', 'speed = "v"\nturn_rate = "w"'), "turn rates stand in .odometry., or in .turns."),
        (text.replace("[turns]", "[turns]\nheading = 'yaw'"), "either turn_rate or heading"),
        (text.replace("[turns]", "[turns]\nspeed = 'v'"), "there is no key 'speed' in .turns."),
        (text.replace("[truth]", "[truth]\nheading_offset = { rad = 1.0 }"), "names 'rad'; did you mean 'red'"),
        (text.replace("[truth]", "[truth]\nheading_offset = 'x'"), "truth.heading_offset: it must be a number"),
    ):
        (folder / "log.toml").write_text(changed)
        with pytest.raises(BadInput, match=said):
            cl.simulate("log/all", data=folder)


def test_steps_with_turns_are_of_the_robots_own_frame_and_markers_are_no_robots(team):
    def steps(files):
        for robot in ROBOTS:
            both, truth = files[f"odom_{robot}.csv"], files[f"truth_{robot}.csv"]
            both["dx"], both["dy"], both["dtheta"] = 0.1 * both.pop("v"), 0.0, 0.1 * both.pop("omega")
            truth["m1x"], truth["m1y"], truth["m2x"], truth["m2y"] = 2 * [truth["x"], truth["y"]]
        return files

    found = cl.inspect(team(steps)).inspected
    assert 'kind = "increment"' in found.text
    assert (found.log.robots, found.log.odometry_kind, found.findings) == (("blue", "red"), "pose", ())


def test_texts_without_a_table_are_named(tmp_path):
    (tmp_path / "tag1.log").write_text("DIST,4,AN0 of tag\nDIST,4,AN0 of tag, late\n")
    with pytest.raises(BadInput, match=r"tag1\.log: a text, and no table; save it as CSV"):
        cl.inspect(tmp_path)


def test_speeds_of_two_wheels_say_what_to_write(team):
    def wheels(files):
        both = {r: pd.concat([files[f"odom_{r}.csv"], files[f"truth_{r}.csv"]]).sort_values("time") for r in ROBOTS}
        return {f"{r}.csv": t.rename(columns={"v": "left_speed", "omega": "right_speed"}) for r, t in both.items()}

    with pytest.raises(
        BadInput, match=r"blue\.csv: 'left_speed' is of one wheel: write speed, \(left \+ right\) / 2, and"
    ):
        cl.inspect(team(wheels))


def test_a_counter_of_lines_is_no_stamp(tmp_path):
    for robot in ROBOTS:
        lines = [f"{k},{k / 10},{k % 7},0.3,{k % 3}" for k in range(50)]
        (tmp_path / f"{robot}.csv").write_text("\n".join(["step,x,y,v,w", *lines, ""]))
    with pytest.raises(BadInput, match=r"blue\.csv: no column of it holds stamps; add one, such as `time` \[s\]"):
        cl.inspect(tmp_path)


def test_readings_of_things_without_a_name_say_what_to_write(tmp_path):
    tables = {name: pd.DataFrame(columns) for name, columns in two_robots(seconds=40).items()}
    odometry = tables.pop("odom_red.csv").assign(rssi1=-40, rssi2=-50)
    odometry.to_csv(tmp_path / "odom.csv", index=False)
    tables["truth_red.csv"].to_csv(tmp_path / "truth.csv", index=False)
    found = cl.inspect(tmp_path).inspected
    assert found.log.robots == ("robot",)
    assert 'each = { a1 = "rssi1", a2 = "rssi2" }' in " ".join(found.unused)
    assert "it has no readings beside odometry" in found.trial.lines[0]


@pytest.fixture
def team(tmp_path):
    """The files of two robots, written by a function that changes the tables."""

    def write(change=lambda files: files, place=""):
        (tmp_path / place).mkdir(exist_ok=True)
        for name, table in change({name: pd.DataFrame(c) for name, c in two_robots(seconds=60).items()}).items():
            table.to_csv(tmp_path / place / name, index=False)
        return tmp_path

    return write


def decimetres(files):
    """Ranges in cm that look like mm, so that they are a tenth of the distances."""
    return {
        **files,
        "uwb.csv": files["uwb.csv"]
        .rename(columns={"range": "range_mm"})
        .assign(range_mm=lambda t: 100 * t["range_mm"]),
    }


def odometry_that_began_again(files):
    """Poses by odometry, from the origin again after half of the time."""
    for robot in ROBOTS:
        both, half = files[f"odom_{robot}.csv"], len(files[f"odom_{robot}.csv"]) // 2
        heading = np.concatenate([[0.0], 0.1 * np.cumsum(both.pop("omega"))[:-1]])
        steps = 0.1 * both.pop("v").to_numpy()[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        place = np.concatenate([np.cumsum(steps[:half], axis=0), np.cumsum(steps[half:], axis=0)])
        both["x"], both["y"], both["theta"] = *place.T, heading
    return files


def steps_along_the_axes(files):
    """Steps with turns, not ahead but along the axes of the truth."""
    for robot in ROBOTS:
        both = files[f"odom_{robot}.csv"]
        heading = files[f"truth_{robot}.csv"]["theta"][0] + 0.1 * np.cumsum(both["omega"])
        steps = 0.1 * both.pop("v").to_numpy() * np.array([np.cos(heading), np.sin(heading)])
        both["dx"], both["dy"], both["dtheta"] = *steps, 0.1 * both.pop("omega")
    return files


def later_ranges(files):
    return {**files, "uwb.csv": files["uwb.csv"].assign(time=lambda t: t["time"] + 5000)}


def frozen(files):
    """The truth of both stands still for ten seconds, and jumps."""
    for robot in ROBOTS:
        table = files[f"truth_{robot}.csv"]
        still = table["time"].between(table["time"][0] + 30, table["time"][0] + 40)
        table.loc[still, ["x", "y", "theta"]] = table.loc[still, ["x", "y", "theta"]].iloc[0].to_numpy()
    return files


def test_of_a_truth_that_froze_and_is_early_both_are_found(team):
    findings = cl.inspect(team(lambda files: delayed(frozen(files)))).inspected.findings
    assert {one.kind for one in findings} >= {"clock", "stale"}


def delayed(files):
    return {n: t.assign(time=t["time"] - 8) if n.startswith("truth") else t for n, t in files.items()}


@pytest.mark.parametrize(
    ("change", "kinds", "setting"),
    [
        (later_ranges, {"clock"}, "[ranges] clock_offset = -5000"),
        (frozen, {"stale"}, '[truth] repeats = "stale"'),
        (decimetres, {"unit"}, '[ranges] range: unit = "cm"'),
        (odometry_that_began_again, {"jump"}, "[odometry] x, y: make a run of each part"),
        (changed(omega=lambda w: 0 * w), {"standstill"}, "another file or topic has it"),
        (changed(v=lambda v: 0 * v), {"standstill"}, "another file or topic has it"),
        (steps_along_the_axes, {"frame"}, '[odometry] of steps kind = "displacement"'),
    ],
)
def test_a_fault_of_the_files_is_found_as_what_it_is(team, change, kinds, setting):
    findings = cl.inspect(team(change)).inspected.findings
    assert {one.kind for one in findings} == kinds
    assert all(one.change.startswith(setting) for one in findings)


def test_copies_in_a_folder_below_are_left_out_and_named(team):
    team()
    found = cl.inspect(team(changed(range=lambda d: 1000 * d), "old")).inspected
    assert found.findings == ()
    assert "old/uwb.csv: uwb.csv stands above it" in found.unused


def test_files_of_one_name_in_folders_of_robots_are_no_copies_of_one_above(team, tmp_path):
    team()
    for kind, in_robot in (("odom", "odometry"), ("truth", "truth")):
        for robot in ROBOTS:
            (tmp_path / robot).mkdir(exist_ok=True)
            (tmp_path / f"{kind}_{robot}.csv").rename(tmp_path / robot / f"{in_robot}.csv")
    (tmp_path / "truth.csv").write_text((tmp_path / "red" / "truth.csv").read_text())
    log = cl.inspect(tmp_path).inspected.log
    assert [series.source for series in log.truth] == [str(tmp_path / robot / "truth.csv") for robot in log.robots]


def test_true_positions_that_come_once_in_two_seconds_are_judged_by(team):
    seldom = team(lambda files: {name: t[:: 20 if "truth" in name else 1] for name, t in files.items()})
    inspected = cl.inspect(seldom).inspected
    assert np.median(np.diff(inspected.log.truth[0].time)) == pytest.approx(2.0)
    assert "2 robots, 38" in inspected.trial.lines[0]


def test_an_arena_is_drafted_where_robots_leave_that_of_the_anchors(team):
    places = pd.DataFrame({"name": ["A", "B"], "x": [1.0, 1.2], "y": [1.0, 1.2]})
    for x, drafted in ((0.0, True), (30.0, False)):
        wide = places.assign(x=places["x"] + [-x, x], y=places["y"] + [-x, x])
        found = cl.inspect(team(lambda files, wide=wide: {**files, "anchors.csv": wide}))
        assert ("arena = " in found.log_toml) == drafted


def test_files_of_mrclam_without_barcodes_say_what_is_missing(tmp_path):
    (tmp_path / "Robot1_Odometry.dat").write_text("1.0 0.1 0.0\n")
    with pytest.raises(cl.BadInput, match=r"holds Barcodes\.dat of a data set of MRCLAM: add it"):
        cl.inspect(tmp_path)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (
            ["red 1.0 0.1 0.2", "red 1.1 0.1 0.2"],
            "numbers where the names of the columns should be; add a line of names",
        ),
        (
            ["range2 1.0 2.9 105", "odom2 1.0 0.1", "odom2 2.0 0.1", "range2 2.0 2.9 105"],
            "'range2', 'odom2'.*file of each",
        ),
    ],
)
def test_texts_without_names_of_columns_say_what_to_add(tmp_path, lines, words):
    (tmp_path / "log.txt").write_text("\n".join(lines) + "\n")
    with pytest.raises(cl.BadInput, match=words):
        cl.inspect(tmp_path)

"""What is odd about the files of a team: found, and corrected by the setting that is drafted."""

import itertools
import re
import subprocess

import numpy as np
import pandas as pd
import pytest
from made_csv_teams import ROBOTS, changed, on_globe, other_names, two_robots, wide

import cooploc as cl
from cooploc import BadInput
from cooploc.scenarios.recordings.inspect import motion
from cooploc.scenarios.recordings.inspect.motion import robot_motion
from cooploc.scenarios.recordings.inspect.naming import match_names

pytestmark = pytest.mark.slow  # a second each; test_checks and test_infer_columns are quick
KINDS = "odom", "truth"


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


def with_anchors(files):
    """Ranges of both robots to each other and to three anchors, in one file that names who measured what."""
    places = {"A1": (0.0, 0.0), "A2": (8.0, 0.0), "A3": (0.0, 8.0)}
    tables = [pd.DataFrame(files["uwb.csv"]).iloc[::2]]
    for robot in ("red", "blue"):
        truth = pd.DataFrame(files[f"truth_{robot}.csv"]).iloc[::4]
        for name, (x, y) in places.items():
            distance = np.hypot(truth["x"] - x, truth["y"] - y).to_numpy()
            tables.append(pd.DataFrame({"time": truth["time"], "from": robot, "to": name, "range": distance}))
    anchors = pd.DataFrame([(name, *place) for name, place in places.items()], columns=["id", "x", "y"])
    return {**files, "anchors.csv": anchors, "uwb.csv": pd.concat(tables).sort_values("time", kind="stable")}


def anchors_first(files):
    lines = with_anchors(files)["uwb.csv"]
    turned = lines["to"].str.startswith("A")
    lines.loc[turned, ["from", "to"]] = lines.loc[turned, ["to", "from"]].to_numpy()
    return {**with_anchors(files), "uwb.csv": lines}


def two_files(files):
    found = with_anchors(files)
    lines = found.pop("uwb.csv")
    of_anchors = lines["to"].str.startswith("A")
    return {**found, "anchor_ranges.csv": lines[of_anchors], "inter_ranges.csv": lines[~of_anchors]}


def columns_of_each_robot(files):
    found = with_anchors(files)
    lines = found.pop("uwb.csv")
    for robot, other in (("red", "blue"), ("blue", "red")):
        own = lines[(lines["from"] == robot) | (lines["to"] == robot)]
        own = own.assign(to=own["to"].where(own["to"] != robot, other))
        wide = own.pivot_table(index="time", columns="to", values="range").add_prefix("d_").reset_index()
        found[f"uwb_{robot}.csv"] = wide.drop(columns="d_A3" if robot == "blue" else [])
    return found


@pytest.mark.parametrize(
    ("change", "missing"),
    [(with_anchors, []), (anchors_first, []), (two_files, []), (columns_of_each_robot, [("blue", "A3")])],
)
def test_ranges_to_teammates_and_anchors_are_read_however_they_are_filed(team, change, missing):
    found = cl.inspect(team(change)).inspected
    assert not found.trial.problem
    log = found.log
    readings = log.readings["anchor_range"]
    pairs = {(log.robots[i], log.anchors.names[k]) for i, k in zip(readings.robot, readings.other, strict=True)}
    assert pairs == {(r, a) for r in log.robots for a in ("A1", "A2", "A3")} - {*missing}
    assert len(log.readings["range"].time) > 100
    off = readings.values[:, 0] - motion.distances(log, "anchor_range")
    assert np.nanmax(np.abs(off)) < 0.05


@pytest.mark.parametrize("camera", [False, True])
def test_markers_by_number_and_place_are_of_robots_that_were_seen(team, camera):
    def detections(files):
        time = files["truth_red.csv"]["time"][::3]
        poses = {robot: files[f"truth_{robot}.csv"][["x", "y", "theta"]].to_numpy()[::3] for robot in ("red", "blue")}
        parts = []
        for robot, mate, tag in (("red", "blue", 11), ("blue", "red", 5)):
            dx, dy = (poses[mate] - poses[robot])[:, :2].T
            c, s = np.cos(poses[robot][:, 2]), np.sin(poses[robot][:, 2])
            ahead, left = c * dx + s * dy, c * dy - s * dx
            axes = {"tx": -left, "ty": 0.1, "tz": ahead} if camera else {"x": ahead, "y": left}
            seen = pd.DataFrame({"time": time, "robot": robot, "tag_id": tag, **axes})
            parts.append(seen[ahead > np.abs(left)])
        return {**files, "detections.csv": pd.concat(parts).sort_values("time", kind="stable")}

    found = cl.inspect(team(detections)).inspected
    assert re.search(r"nodes = { (11 = .blue., 5 = .red.|5 = .red., 11 = .blue.) }", found.text)
    assert {f.kind for f in found.findings} <= {"dropped"}
    assert not found.trial.problem
    seen = found.log.readings["sighting"]
    off = seen.values[:, 1] - motion.bearings(found.log, "sighting")
    assert np.nanmax(np.abs(np.angle(np.exp(1j * off)))) < 0.2


def test_names_that_are_numbers_of_lines_are_no_radios(team):
    def numbered(files):
        lines = files["uwb.csv"]
        return {**files, "uwb.csv": lines.assign(to=range(1000, 1000 + len(lines)))}

    assert "nodes" not in cl.inspect(team(numbered)).log_toml


def test_detections_of_a_camera_above_all_are_the_truth_if_there_is_no_other(team):
    def above(files):
        seen = [
            files.pop(f"truth_{r}.csv").assign(robot=r, tag_id=k)[["time", "robot", "tag_id", "x", "y"]]
            for k, r in enumerate(("red", "blue"), 5)
        ]
        return {**files, "detections.csv": pd.concat(seen).sort_values("time", kind="stable")}

    found = cl.inspect(team(above)).inspected
    assert not found.trial.problem
    assert all(truth is not None for truth in found.log.truth)
    assert {*found.log.readings} == {"range"}


def test_radios_in_the_files_of_robots_are_told_by_their_ranges(team):
    def own(files):
        found = with_anchors(files)
        lines = found.pop("uwb.csv").replace({"to": {"red": "101", "blue": "102", "A1": "1", "A2": "2", "A3": "3"}})
        for robot in ("red", "blue"):
            found[f"uwb_{robot}.csv"] = lines[lines["from"] == robot].drop(columns="from").rename(columns={"to": "id"})
        return {**found, "anchors.csv": found["anchors.csv"].assign(id=[1, 2, 3])}

    found = cl.inspect(team(own)).inspected
    assert 'nodes = { 102 = "blue" }' in found.text  # red measured blue, and blue not red
    assert np.isfinite(found.log.readings["range"].values).sum() > 100


@pytest.mark.parametrize("between", [True, False])
def test_radios_that_are_called_by_no_robot_are_told_by_their_ranges(team, between):
    """Of two robots alone it makes no difference which is whose: the anchors decide."""
    called = {"red": "0xA1", "blue": "17", "A1": "1", "A2": "2", "A3": "3"}

    def tags(files):
        found = with_anchors(files)
        lines = found["uwb.csv"].replace({"from": called, "to": called}).rename(columns={"from": "id_a", "to": "id_b"})
        lines = lines if between else lines[lines["id_b"].isin(["1", "2", "3"])]
        anchors = found["anchors.csv"].replace({"id": called})
        itself = lines.iloc[:20].assign(
            id_b=lines["id_a"].iloc[:20], range=0.0
        )  # as radios write that list all in reach
        lines = pd.concat([lines, itself]).sort_values("time", kind="stable")
        rssi = (-40 - 20 * np.log10(lines["range"].clip(lower=0.1))).round(1)
        stamps = lines["time"] if between else (1000 * lines["time"]).round()  # [ms]: a column with its unit
        return {**found, "uwb.csv": lines.assign(rssi=rssi, time=stamps), "anchors.csv": anchors}

    found = cl.inspect(team(tags)).inspected
    assert found.text.count('nodes = { 17 = "blue", 0xA1 = "red" }') == 2  # of ranges and of RSSI
    assert {"range", "rssi"} & {*found.log.readings} == ({"range", "rssi"} if between else set())
    off = found.log.readings["anchor_range"].values[:, 0] - motion.distances(found.log, "anchor_range")
    assert np.nanmax(np.abs(off)) < 0.05


@pytest.mark.parametrize("heights", ["1.5", "{ A1 = 1.5, A2 = 1.5, A3 = 1.5 }"])
def test_slant_ranges_to_high_anchors_are_found_and_corrected(team, heights):
    def slant(files):
        lines = with_anchors(files)["uwb.csv"]
        high = lines["to"].str.startswith("A")
        lines.loc[high, "range"] = np.hypot(lines.loc[high, "range"], 1.5)
        low = lines[high].iloc[:3].assign(range=1.4, time=lines["time"].iloc[:3].to_numpy() + 0.01)
        return {**with_anchors(files), "uwb.csv": pd.concat([lines, low])}

    folder = team(slant)
    found = cl.inspect(folder)
    (one,) = (f for f in found.inspected.findings if f.table == "anchors")
    assert one.kind == "height"
    assert float(one.setting.removeprefix("height = ")) == pytest.approx(1.5, abs=0.1)
    (folder / "log.toml").write_text(found.log_toml.replace("\n[anchors]\n", f"\n[anchors]\nheight = {heights}\n"))
    log = cl.inspect(folder).inspected.log
    assert any("left out 3 ranges no longer than the anchor's height" in line for line in log.warnings)
    off = log.readings["anchor_range"].values[:, 0] - motion.distances(log, "anchor_range")
    assert np.nanmax(np.abs(off)) < 0.05
    (folder / "log.toml").write_text((folder / "log.toml").read_text().replace(heights, "{ A9 = 1.0 }"))
    with pytest.raises(BadInput, match="height names 'A9'"):
        cl.inspect(folder)


def test_of_two_files_of_the_same_ranges_one_is_to_be_chosen(team):
    def twice(files):
        lines = files.pop("uwb.csv")
        return {**files, "uwb_raw.csv": lines, "uwb_filtered.csv": lines.assign(range=lines["range"].round(1))}

    found = cl.inspect(team(twice)).inspected
    assert "range" not in found.log.readings
    (line,) = (line for line in found.unused if "looks like ranges" in line)
    assert line.endswith("keep one of these files, or call them by robots")


def test_columns_beside_a_range_that_are_none(team):
    def measured(files):
        lines = with_anchors(files)["uwb.csv"]
        powers = lines.assign(fp_power=-80.0, rx_power=-70.0 - lines["range"], tof_ns=lines["range"] / 0.3)
        return {**with_anchors(files), "uwb.csv": powers}

    found = cl.inspect(team(measured)).inspected
    columns = {row[1]: row[2:] for row in found.columns if row[0] == "uwb.csv"}
    assert columns["rx_power"][0].startswith("rssi")
    assert "time of flight" in columns["tof_ns"][1]
    assert {"range", "anchor_range", "anchor_rssi"} <= {*found.log.readings}


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
    assert match_names(["0", "1", "2"], ["1", "2", "3"]) == {"0": "1", "1": "2", "2": "3"}  # counted from 0
    assert match_names(["robot1", "robot0"], ["Robot1", "Robot2"]) == {"robot0": "Robot1", "robot1": "Robot2"}
    assert match_names(["robot1", "robot2"], ["Robot1", "Robot2"]) == {"robot1": "Robot1", "robot2": "Robot2"}
    assert match_names(["a0", "b1"], ["tb_1", "tb_2"]) == {"b1": "tb_1"}  # called otherwise, they are not counted


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
    assert any("'1', '2', '3': neither a robot of the team nor an anchor" in finding.fact for finding in found.findings)


def test_places_in_a_file_that_is_not_read_are_named(team):
    folder = team()
    for text in ("a1: [0, 0\n", "a1: [.nan, 0]\n", "height: 2\nwidth: 3\n", "[{x: 0, y: 0}, {x: 1, y: 1}]\n", ""):
        (folder / "anchors.yaml").write_text(text)
        unused = cl.inspect(folder, again=True).inspected.unused
        assert "anchors.yaml: not read; write its places into [anchors]" in unused


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


@pytest.mark.parametrize(("none", "below"), [(-127.0, -126), (-80.0, -79.2)])
def test_signal_strengths_that_mean_none_are_left_out(team, none, below):
    def measured(files):
        rssi = -50 - 20 * np.log10(files["uwb.csv"].pop("range"))
        files["uwb.csv"]["dBm"] = rssi.where(np.arange(len(rssi)) % 7 > 0, none)
        return files

    found = cl.inspect(team(measured)).inspected
    assert f"missing_below = {below}" in found.text
    assert found.log.readings["rssi"].values.min() > -72


def test_signal_strengths_that_anchors_measured_are_of_the_robots(team):
    def measured(files):
        files = anchors_first(files)
        signals = files["uwb.csv"].assign(rssi=lambda t: -50 - 20 * np.log10(t.pop("range")))
        return {**files, "uwb.csv": signals}

    found = cl.inspect(team(measured)).inspected
    assert len(found.log.readings["anchor_rssi"].time) > 100
    assert not found.findings


def test_turns_that_cannot_be_joined_are_one_line(team):
    with pytest.raises(BadInput, match=r"wheel_blue.csv, .*imu_blue.csv: they have no time in common; correct time or"):
        cl.inspect(team(gyroscope(late=1e6)))
    folder = team(gyroscope())
    text = cl.inspect(folder).inspected.text
    for wrong, said in (
        (text.replace('speed = "v"', 'speed = "v"\nturn_rate = "w"'), "turn rates stand in .odometry., or in .turns."),
        (text.replace("[turns]", "[turns]\nheading = 'yaw'"), "either turn_rate or heading"),
        (text.replace("[turns]", "[turns]\nspeed = 'v'"), "there is no key 'speed' in .turns."),
        (text.replace("[truth]", "[truth]\nheading_offset = { rad = 1.0 }"), "names 'rad'; did you mean 'red'"),
        (text.replace("[truth]", "[truth]\nheading_offset = 'x'"), "truth.heading_offset: it must be a number"),
    ):
        (folder / "log.toml").write_text(wrong)
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


@pytest.mark.parametrize(("columns", "so"), [("step,x,y,v,w", ""), ("v,w", ", and so no odometry")])
def test_a_counter_of_lines_is_no_stamp(tmp_path, columns, so):
    for robot in ROBOTS:
        lines = [[k, k / 10, k % 7, 0.3, k % 3] for k in range(50)]
        lines = [",".join(map(str, line[-columns.count(",") - 1 :])) for line in lines]
        (tmp_path / f"odom_{robot}.csv").write_text("\n".join([columns, *lines, ""]))
    with pytest.raises(BadInput, match=rf"blue\.csv: no column of it holds stamps{so}; add one, such as `time` \[s\]"):
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
        (odometry_that_began_again, {"jump"}, "nothing: make a run of each part"),
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


def test_a_robot_that_mostly_stands_has_no_other_scale(team):
    def stands(files):
        rng = np.random.default_rng(1)
        for table in files.values():
            still, tail = np.arange(len(table)) < 0.8 * len(table), int(0.8 * len(table))
            for c in set(table) & {"v", "omega"}:
                table.loc[still, c] = 2e-5
            for c in set(table) & {"x", "y", "theta"}:
                table.loc[still, c] = table[c][tail] + rng.normal(0, 2e-4, still.sum())
        return {name: table for name, table in files.items() if name != "uwb.csv"}

    assert "scale" not in {finding.kind for finding in cl.inspect(team(stands)).inspected.findings}


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


@pytest.mark.parametrize("stamp_first", [False, True])
@pytest.mark.parametrize("headings", [False, True])
def test_of_lines_of_several_kinds_the_command_that_is_named_makes_files_that_are_read(tmp_path, stamp_first, headings):
    tables = two_robots(seconds=40)
    for robot in ROBOTS:
        lines = list[str]()
        for kind, name in (("$ODO", f"odom_{robot}.csv"), ("GT", f"truth_{robot}.csv")):
            for stamp, *rest in zip(*tables[name].values(), strict=True):
                values = " ".join(map(str, rest if headings else rest[:2]))
                lines.append(f"{stamp} {kind} {values}" if stamp_first else f"{kind} {stamp} {values}")
        (tmp_path / f"{robot}.txt").write_text("\n".join(lines) + "\n")
    said = r"kinds \('\$ODO', 'GT'\); write a file of each, such as grep -F '\$ODO' blue.txt > odo_blue.txt"
    with pytest.raises(cl.BadInput, match=said) as e:
        cl.inspect(tmp_path)
    command = str(e.value).partition("such as ")[2]
    for robot in ROBOTS:
        own = command.replace("blue", robot)
        for one in (own, own.replace("$ODO", "GT").replace("odo", "gt")):
            subprocess.run(one, shell=True, check=True, cwd=tmp_path)
        (tmp_path / f"{robot}.txt").unlink()
    log = cl.inspect(tmp_path).inspected.log
    assert sorted(log.robots) == sorted(ROBOTS)
    for k, robot in enumerate(log.robots):
        for series, kind in ((log.odometry, "odom"), (log.truth, "truth")):
            time, *values = tables[f"{kind}_{robot}.csv"].values()
            np.testing.assert_allclose(series[k].time, time, atol=1e-6)
            np.testing.assert_allclose(series[k].values[:, :2], np.transpose(values[:2]), atol=1e-9)


@pytest.mark.parametrize("beside", ["anchors", "anchors, a file for each robot", "a third robot", "RSSI of each robot"])
def test_a_range_that_names_nothing_is_of_both_robots_only_where_there_is_nothing_else(tmp_path, beside):
    tables = {name: pd.DataFrame(columns) for name, columns in two_robots(seconds=40).items()}
    tables["uwb.csv"] = tables["uwb.csv"][["time", "range"]]
    if beside.startswith("anchors"):
        tables["anchors.csv"] = pd.DataFrame({"id": ["A1", "A2"], "x": [0.0, 8.0], "y": [0.0, 8.0]})
    elif beside == "a third robot":
        for kind in KINDS:
            tables[f"{kind}_green.csv"] = tables[f"{kind}_red.csv"]
    said = "uwb.csv: looks like ranges, but does not say whose it is"
    if beside.endswith("each robot"):
        ranges, said = tables.pop("uwb.csv"), "uwb_blue.csv, uwb_red.csv: ranges of things without a name"
        if beside.startswith("RSSI"):  # of an access point, perhaps
            ranges, said = (
                ranges.assign(range=-40 - 5 * ranges["range"]).rename(columns={"range": "rssi"}),
                said.replace("ranges", "rssi"),
            )
        tables |= {f"uwb_{robot}.csv": ranges for robot in ROBOTS}
    for name, table in tables.items():
        table.to_csv(tmp_path / name, index=False)
    inspected = cl.inspect(tmp_path).inspected
    assert inspected.log.readings == {}
    assert any(said in line for line in inspected.unused)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (
            ["red 1.0 0.1 0.2", "red 1.1 0.1 0.2"],
            "numbers where the names of the columns should be; add a line of names",
        ),
        (
            [f"{k} {np.cos(k / 9)} {np.sin(k / 9)}" for k in range(50)],  # positions, or speeds
            "numbers where the names .*; add a line of names$",
        ),
        (
            ["range2 1.0 2.9 105", "odom2 1.0 0.1", "odom2 2.0 0.1", "range2 2.0 2.9 105"],
            "'range2', 'odom2'.*file of each",
        ),
    ],
)
def test_texts_without_names_of_columns_say_what_to_add(tmp_path, lines, words):
    (tmp_path / "odom.txt").write_text("\n".join(lines) + "\n")
    with pytest.raises(cl.BadInput, match=words):
        cl.inspect(tmp_path)


def test_runs_of_several_dates_are_to_be_put_into_directories_and_long_lists_are_short(tmp_path):
    table = pd.DataFrame(two_robots(seconds=20)["truth_red.csv"]).assign(v=0.2, omega=0.1)
    for day in range(11, 20):
        table.assign(**({"more": 1} if day > 15 else {})).to_csv(tmp_path / f"log_202405{day}_101931.csv", index=False)
    with pytest.raises(cl.BadInput, match=r"differ in dates \(20240511, .* and 6 more\); put the files of each run"):
        cl.inspect(tmp_path)
    for name, file in two_robots(seconds=40).items():
        pd.DataFrame(file).to_csv(tmp_path / name, index=False)
    for file in tmp_path.glob("log_*"):
        file.write_text("time,a,b\n" + "1.0,2.0,3.0,4.0\n" * 9)
    lines = [line for line in cl.inspect(tmp_path).inspected.unused if "log_2024" in line]
    assert len(lines) == 4

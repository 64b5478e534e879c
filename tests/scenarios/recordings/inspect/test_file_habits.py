"""One team in the files that others would write: each is read as the same recording, without a log.toml by hand."""

import itertools
import json

import numpy as np
import pandas as pd
import pytest
from made_csv_teams import ROBOTS, changed, other_names, two_robots, wide

import cooploc as cl
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings import schema
from cooploc.scenarios.recordings.scenario import TeamFolder

pytestmark = pytest.mark.slow  # a second each; test_checks and test_infer_columns are quick
KINDS = "odom", "truth"


def renamed(words):
    return lambda files: {name: table.rename(columns=words) for name, table in files.items()}


def with_column(name, values):
    """Another column in the files of odometry and truth, of a file's name and its number of lines."""
    return lambda files: {f: t if f == "uwb.csv" else t.assign(**{name: values(f, len(t))}) for f, t in files.items()}


def dates(form):
    return changed(time=lambda t: pd.to_datetime(t, unit="s").dt.round("us").dt.strftime(form))


def quaternion(names):
    def change(files):
        for robot in ROBOTS:
            half = files[f"truth_{robot}.csv"].pop("theta") / 2
            columns = (0 * half, 0 * half, np.sin(half), np.cos(half))
            files[f"truth_{robot}.csv"][list(names)] = np.stack(columns[-len(names) :], -1)
        return files

    return change


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


def of_the_other(files):
    """Ranges of each robot in a file of its own, which does not say that they are of its only teammate."""
    files = ranges_each(files)
    return files | {f"uwb_{a}.csv": files[f"uwb_{a}.csv"].set_axis(["time", "range"], axis=1) for a in ROBOTS}


def of_both(files):
    """Ranges in a file that names neither robot."""
    return files | {"uwb.csv": files["uwb.csv"][["time", "range"]]}


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
    found, tags = folders(files), {"red": ("1000010", "1000011"), "blue": ("1000020", "1000021")}
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


def dated(form):
    """Each file with the second at which its logger began, as in `form`."""
    began = {name: pd.Timestamp("2024-05-11 10:19:31") + pd.Timedelta(k, "s") for k, name in enumerate(two_robots())}

    def change(files):
        stamps = {name: began[name].strftime(form.partition("|")[2]) for name in files}
        parts = {name: name.removesuffix(".csv").split("_")[::-1] for name in files}  # robot, kind
        return {form.partition("|")[0].format(stamps[n], *parts[n][:1], parts[n][-1]): t for n, t in files.items()}

    return change


def echo_csv(files):
    """As `ros2 topic echo --csv` prints Odometry and PoseStamped: without names."""
    files = quaternion(["qx", "qy", "qz", "qw"])(files)
    for robot, kind in itertools.product(ROBOTS, KINDS):
        table = files[f"{kind}_{robot}.csv"]
        sec, rest = np.divmod(table.pop("time"), 1)
        stamped = pd.DataFrame({"sec": sec.astype(int), "nanosec": (1e9 * rest).round().astype(int), "frame": "map"})
        if kind == "odom":
            stamped = stamped.assign(child=robot, **{f"p{k}": float(k == 6) for k in range(7)})
            stamped = stamped.assign(
                **{f"c{k}": 0.0 for k in range(36)}, v=table["v"], **{f"v{k}": 0.0 for k in range(4)}
            )
            files[f"odom_{robot}.csv"] = stamped.assign(w=table["omega"], **{f"d{k}": 0.0 for k in range(36)})
        else:
            table.insert(2, "z", 0.0)
            files[f"truth_{robot}.csv"] = stamped.join(table)
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


def along_fixed_axes(files):
    """Velocities along x and y of the world in place of speeds, in mm/s."""
    for robot in ROBOTS:
        odometry = files[f"odom_{robot}.csv"]
        speed, heading = 1000 * odometry.pop("v"), 2.0 + 0.1 * odometry["omega"].cumsum()
        odometry[["vx_mm", "vy_mm"]] = np.stack([speed * np.cos(heading), speed * np.sin(heading)], -1)
    return files


# How the tables are changed, how they are written, and how their text is changed.
HABITS = {
    "Parquet": (SAME, lambda table, path: table.set_index("time").to_parquet(path.with_suffix(".parquet")), None),
    "JSON lines": (SAME, as_json_lines, None),
    "an echo": (SAME, as_echo, None),
    "JSON columns": (SAME, as_json({}), None),
    "JSON objects": (SAME, as_json({"orient": "records"}), None),
    "a compass": (compass, {}, None),
    "velocities": (along_fixed_axes, {}, None),
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
    "a number of each robot": (with_column("id", lambda file, n: 7 + ("red" in file)), {}, None),
    "one name of all": (with_column("vehicle", lambda file, n: "ours"), {}, None),
    "a name that is empty": (with_column("name", lambda file, n: ""), {}, None),
    "a number of each line": (with_column("id", lambda file, n: np.arange(n)), {}, None),
    "seconds of MATLAB": (changed(time=lambda t: t.map("{:.6f} sec".format)), {}, None),
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
    "of the other robot": (of_the_other, {}, None),
    "of both robots": (of_both, {}, None),
    "columns of a radio": (renamed({"from": "uwb_from", "to": "uwb_to", "range": "uwb_range"}), {}, None),
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
    "dates in names": (dated("{2}_{1}_{0}.csv|%Y-%m-%d-%H-%M-%S"), {}, None),
    "dates first": (dated("{0}_{2}_{1}.csv|%d.%m.%Y %Hh%M.%S"), {}, None),
    "dates in folders": (dated("{1}/{2}_{0}.csv|%Y%m%d_%H%M%S"), {}, None),
    "folders with dates": (dated("{1}-{0}/{2}.csv|%Y_%m_%d-%H_%M_%S"), {}, None),
    "seconds since 1970": (dated("{1}_{2}_{0}.csv|%s"), {}, None),
    "echo as CSV": (echo_csv, {"header": False}, None),
    "numbers alone": (numbers_alone, {"header": False, "sep": " "}, None),
    "names again": (SAME, {}, lambda text: text.replace("\n", "\n" + text.split("\n")[0] + "\n", 2)),
}

LOSING = ("JSON lines", "units below", "a line of units", "two tags", "the last line first", "names again")
LOSING += ("a write that was interrupted",)


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
    assert {finding.kind for finding in inspected.findings} == ({"dropped"} if habit in LOSING else set())
    assert list(log.readings) == ["range"]
    assert log.readings["range"].values.max() < 60
    for i, one in enumerate(ROBOTS):
        k = log.robots.index(one) if one in log.robots else i
        (t, *u), (_, *pose) = want[one][0].T, want[one][1].T
        np.testing.assert_allclose(log.odometry[k].time, t % day, atol=2e-5)
        np.testing.assert_allclose(log.odometry[k].values, np.transpose(u), atol=1e-6)
        np.testing.assert_allclose(log.truth[k].values[:, :2], np.transpose(pose[:2]), atol=1e-6)
        np.testing.assert_allclose(np.sin(log.truth[k].values[:, 2]), np.sin(pose[2]), atol=1e-6)


PLACES = {"A1": (0.0, 0.0), "A2": (8.0, 0.0), "A3": (8.0, 8.0)}


def away(files, robot, name="{}"):
    """A robot's distances from the places, in columns called by their names, or by their numbers."""
    t, x, y, _ = files[f"truth_{robot}.csv"].to_numpy(float).T
    found = {name.format(place, place[1:]): np.hypot(x - a, y - b) for place, (a, b) in PLACES.items()}
    return pd.DataFrame({"time": t, **found})


def alone(files):
    """The files of red, and anchors that are called 1, 2, 3."""
    anchors = files["anchors.csv"].assign(id=[1, 2, 3])
    return {"odom.csv": files["odom_red.csv"], "truth.csv": files["truth_red.csv"], "anchors.csv": anchors}


def one_log(files):
    """Red's odometry, truth and distances in the columns of one file."""
    odometry, measured = files["odom_red.csv"], away(files, "red", "r{1}").drop(columns="time")
    columns = [odometry, files["truth_red.csv"].drop(columns="time"), measured]
    return {"log.csv": pd.concat(columns, axis=1), "anchors.csv": alone(files)["anchors.csv"]}


def places_in(name, text):
    """The anchors as a text of another kind."""

    def change(files):
        del files["anchors.csv"]
        return files | {f"uwb_{r}.csv": away(files, r) for r in ROBOTS} | {name: text}

    return change


TEXTS = {
    "anchors.txt": "".join(f"{name} {x} {y}\n" for name, (x, y) in PLACES.items()),
    "anchors.yaml": "".join(f"{name}: [{x}, {y}, 1.5]\n" for name, (x, y) in PLACES.items()),
    "uwb_anchors.yml": "anchors:\n" + "".join(f"- {{id: {name}, x: {x}, y: {y}}}\n" for name, (x, y) in PLACES.items()),
    "anchors.json": json.dumps({"anchors": {name: {"position": place} for name, place in PLACES.items()}}),
}


def readings_in_json(files):
    """Distances in files that are called by tags, and hold no places."""
    one = {r: pd.melt(away(files, r), "time", var_name="anchor", value_name="range") for r in ROBOTS}
    return files | {f"tag_{r}.json": table.sort_values("time").to_json(orient="records") for r, table in one.items()}


def places_beside_ranges(files):
    """The place of an anchor in each line of what was measured, as PX4 and the DWM1001 log it."""
    del files["anchors.csv"]
    for r in ROBOTS:
        one = pd.melt(away(files, r), "time", var_name="anchor_id", value_name="range")
        one[["anchor_x", "anchor_y"]] = [PLACES[name] for name in one["anchor_id"]]
        nothing = pd.DataFrame({"time": one["time"].max() + np.arange(1.0, 9.0), "anchor_x": 5.0, "anchor_y": 5.0})
        files = files | {f"uwb_{r}.csv": pd.concat([one.sort_values("time", kind="stable"), nothing])}
    return files


def column_for_two(files):
    red, blue = (away(files, robot, f"{robot}_{{}}") for robot in ROBOTS)
    return files | {"uwb.csv": red.merge(blue, "outer", "time")}


def file_for_two(files):
    both = {(r, place): away(files, r)[["time", place]] for r in ROBOTS for place in PLACES}
    return files | {f"{r}_{place}.csv": one.rename(columns={place: "range"}) for (r, place), one in both.items()}


@pytest.mark.parametrize(
    ("change", "robots"),
    [
        (column_for_two, 2),
        (file_for_two, 2),
        (readings_in_json, 2),
        (places_beside_ranges, 2),
        *((places_in(name, text), 2) for name, text in TEXTS.items()),
        (lambda files: files | {f"uwb_{r}.csv": away(files, r, "r{1}") for r in ROBOTS}, 2),
        (lambda files: alone(files) | {"uwb.csv": away(files, "red", "r{1}")}, 1),
        (one_log, 1),
    ],
    ids=["a column for two", "a file for two", "tags", "places", *TEXTS, "numbers", "one robot", "one file"],
)
def test_distances_from_anchors_are_read_from_files_as_others_write_them(tmp_path, change, robots):
    files = {name: pd.DataFrame(columns) for name, columns in two_robots(seconds=60).items() if name != "uwb.csv"}
    files["anchors.csv"] = pd.DataFrame([(name, *place) for name, place in PLACES.items()], columns=["id", "x", "y"])
    for name, table in change(files).items():
        if isinstance(table, str):
            (tmp_path / name).write_text(table)
        else:
            table.to_csv(tmp_path / name, index=False)
    found = cl.inspect(tmp_path).inspected
    assert len(found.log.robots) == robots
    assert list(found.log.readings) == ["anchor_range"]
    readings = found.log.readings["anchor_range"]
    assert np.bincount(readings.other).tolist() == [robots * len(files["truth_red.csv"])] * 3
    assert found.findings == ()


def test_folders_of_robots_may_be_links_and_a_link_that_leads_back_ends(tmp_path):
    for robot in ROBOTS:
        (tmp_path / "disk" / robot).mkdir(parents=True)
        for kind in KINDS:
            columns = two_robots(seconds=60)[f"{kind}_{robot}.csv"]
            pd.DataFrame(columns).to_csv(tmp_path / "disk" / robot / f"{kind}.csv", index=False)
        (tmp_path / "lab").mkdir(exist_ok=True)
        (tmp_path / "lab" / robot).symlink_to(tmp_path / "disk" / robot)
    for name in ("latest", "best", "red"):  # not followed again and again
        (tmp_path / "disk" / "red" / name).symlink_to(tmp_path / "disk" / "red")
    assert sorted(cl.inspect(tmp_path / "lab").inspected.log.robots) == sorted(ROBOTS)


def in_runs(folder, form, runs, zero=0.0):
    """Files of runs, of other motions, by `form` of kind, robot and run; without `zero`, an hour after each other."""
    for k, run in enumerate(runs):
        for name, columns in two_robots(seed=k + 1, seconds=30).items():
            kind, _, robot = name.removesuffix(".csv").partition("_")
            path = folder / form.format(kind=kind, robot=robot, run=run).replace("__", "_").replace("_.", ".").strip(
                "/"
            )
            path.parent.mkdir(parents=True, exist_ok=True)
            shifted = {c: v + zero + 3600 * k * (zero == 0) if c == "time" else v for c, v in columns.items()}
            pd.DataFrame(shifted).to_csv(path, index=False)
    (folder / "anchors.csv").write_text("name,x,y\nA1,0,0\nA2,1,0\n")


@pytest.mark.parametrize(
    ("form", "runs"),
    [
        ("{run}_{kind}_{robot}.csv", ("01", "02")),
        ("{kind}_{robot}_{run}.csv", ("dawn", "dusk")),
        ("{robot}/{run}/{kind}.csv", ("2024-05-11", "2024-05-12")),
        ("{kind}/{run}/{robot}.csv", ("01", "02")),
        ("{kind}/{robot}_{run}.csv", ("run 1", "run 2")),
        ("{run}/{robot}/{kind}.csv", ("01", "02")),
        ("{kind}/{robot}.csv", ("one",)),
    ],
)
def test_runs_are_told_by_a_word_in_the_names_of_files(tmp_path, form, runs):
    in_runs(tmp_path, form, runs)
    found = cl.inspect(tmp_path).inspected
    assert (len(found.runs), found.trial.problem, {*found.log.robots}) == (len(runs), "", {*ROBOTS})
    assert found.log.anchors.names == ("A1", "A2")
    read = TeamFolder(tmp_path, schema.parse(tmp_path / "log.toml", found.text))
    for k, run in enumerate(read.places):
        files, log = two_robots(seed=k + 1, seconds=30), read.log(run)
        assert len(log.readings["range"].time) == len(files["uwb.csv"]["time"])
        for robot, odometry in zip(log.robots, log.odometry, strict=True):
            np.testing.assert_allclose(odometry.values[:, 0], files[f"odom_{robot}.csv"]["v"], atol=1e-9)


def in_one_table(columns, words, name="trial"):
    """The lines of all runs, each with its word in a column; the clocks of all begin alike."""
    parts = [pd.DataFrame(of).assign(**{name: word}) for word, of in zip(words, columns, strict=True)]
    return pd.concat(parts, ignore_index=True)


@pytest.mark.parametrize("words", [(1, 2), (1.0, 2.0), ("dawn", "dusk")], ids=str)
@pytest.mark.parametrize("order", ["trial", "time"])
def test_a_column_tells_the_runs_of_a_file(tmp_path, words, order):
    each = [two_robots(seed=k + 1, seconds=30) for k in range(2)]
    for name in each[0]:
        table = in_one_table([of[name] for of in each], words).sort_values(order, kind="stable")
        table.to_csv(tmp_path / name, index=False)
    found = cl.inspect(tmp_path).inspected
    runs = tuple(word if isinstance(word, str) else f"trial{word:.0f}" for word in words)
    assert (found.runs, found.trial.problem, found.findings) == (runs, "", ())
    read = TeamFolder(tmp_path, schema.parse(tmp_path / "log.toml", found.text))
    for run, files in zip(runs, each, strict=True):
        log = read.log(run)
        np.testing.assert_array_equal(log.readings["range"].values[:, 0], files["uwb.csv"]["range"])
        for robot, odometry in zip(log.robots, log.odometry, strict=True):
            np.testing.assert_allclose(odometry.values[:, 0], files[f"odom_{robot}.csv"]["v"], atol=1e-9)


def test_a_last_run_that_ended_at_once_does_not_hide_the_others(tmp_path):
    each = [two_robots(seed=k + 1, seconds=30) for k in range(2)]
    for name in each[0]:
        table = in_one_table([of[name] for of in each], (1, 2))
        ended = pd.DataFrame(each[0][name])[:3].assign(trial=3)
        pd.concat([table, ended, ended[:1].assign(trial="")]).to_csv(tmp_path / name, index=False)
    found = cl.inspect(tmp_path).inspected
    assert (found.runs, found.trial.problem) == (("trial1", "trial2", "trial3"), "")
    assert len(found.log.readings["range"].time) == len(each[0]["uwb.csv"]["time"])


@pytest.mark.parametrize(
    "flag", [lambda t: t > 10, lambda t: t // 5 % 2, lambda t: 0 * t + 4], ids=["began to run", "now and then", "one"]
)
def test_a_column_that_changes_while_time_goes_on_tells_no_runs(tmp_path, flag):
    for name, columns in two_robots(seconds=30).items():
        pd.DataFrame(columns | {"run": flag(columns["time"]).astype(int)}).to_csv(tmp_path / name, index=False)
    found = cl.inspect(tmp_path).inspected
    assert (len(found.runs), found.trial.problem, found.findings) == (1, "", ())


def test_a_file_without_the_column_of_runs_is_named(tmp_path):
    each = [two_robots(seed=k + 1, seconds=30) for k in range(2)]
    for name in each[0]:
        table = in_one_table([of[name] for of in each], (1, 2))
        table.drop(columns=["trial"] * (name == "uwb.csv")).to_csv(tmp_path / name, index=False)
    with pytest.raises(BadInput, match=r"has runs in the column 'trial', and uwb\.csv has none; add it, or write"):
        cl.inspect(tmp_path)


def test_runs_whose_clocks_begin_alike_are_told_by_words_such_as_trial_1(tmp_path):
    in_runs(tmp_path / "runs", "{robot}_{kind}_{run}.csv", ("trial1", "trial2"), zero=1.0)
    assert cl.inspect(tmp_path / "runs").inspected.runs == ("trial1", "trial2")
    in_runs(tmp_path / "none", "{robot}_{kind}_{run}.csv", ("trial1",), zero=1.0)
    assert cl.inspect(tmp_path / "none").inspected.runs == ("none",)


def test_a_robot_whose_clock_is_far_off_is_no_run(tmp_path):
    for name, columns in two_robots(seconds=30).items():
        late = {"time": columns["time"] + 3600} if "red" in name else {}
        pd.DataFrame(columns | late).to_csv(tmp_path / name, index=False)
    found = cl.inspect(tmp_path).inspected
    assert len(found.runs) == 1
    assert found.unused == ("blue: without truth, or too late or too early for the others",)


def test_parts_of_readings_alone_are_no_runs(tmp_path):
    files = two_robots(seconds=40)
    ranges = pd.DataFrame(files.pop("uwb.csv"))
    for name, columns in files.items():
        pd.DataFrame(columns).to_csv(tmp_path / name, index=False)
    for part, lines in (("dawn", ranges[:80]), ("dusk", ranges[80:])):
        lines.to_csv(tmp_path / f"uwb_{part}.csv", index=False)
        lines.assign(range=-50.0).rename(columns={"range": "rssi"}).to_csv(tmp_path / f"rssi_{part}.csv", index=False)
    found = cl.inspect(tmp_path).inspected
    assert (len(found.runs), {*found.log.robots}) == (1, {*ROBOTS})


def test_a_broken_file_of_the_first_run_is_the_one_that_is_named(tmp_path):
    in_runs(tmp_path, "{kind}/{robot}_{run}.csv", ("dawn", "dusk"))
    (tmp_path / "odom" / "red_dawn.csv").write_text("")
    with pytest.raises(cl.BadInput, match=r"odom/red_dawn.csv, line 1: .*the file is empty; get it again"):
        cl.inspect(tmp_path)

"""A log.toml for a ROS bag: odometry, truth and ranges among its topics, their robots, and the robots' radios."""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType

import numpy as np

from cooploc.estimators.errors import BadInput, first_of
from cooploc.scenarios.recordings.bag_storage import NUMBERS, is_bag, standard_types
from cooploc.scenarios.recordings.bags import (
    TopicInfo,
    TopicSeries,
    find_runs,
    read_fields,
    read_topics,
    text_folders,
    topics,
)
from cooploc.scenarios.recordings.inspect.columns import CsvTable, Guess, infer_unit, table_of_fields
from cooploc.scenarios.recordings.inspect.csv_draft import column_entry, frame_entries, tables_beside_bag
from cooploc.scenarios.recordings.inspect.draft_toml import Draft, DraftTable, Entry
from cooploc.scenarios.recordings.inspect.naming import (
    CERTAIN,
    ESTIMATES,
    ODOMETRY,
    SEEN,
    TRUTH,
    clean_name,
    file_pattern,
    is_plain,
    is_second_choice,
    match_names,
    name_meaning,
    numbers_of,
    pairs_by_number,
    pairs_of_robots,
    pairs_with_places,
    words_of,
)
from cooploc.scenarios.recordings.inspect.places import is_table, split_places
from cooploc.scenarios.recordings.inspect.table_parts import HELD, first_columns, is_held
from cooploc.scenarios.recordings.radio_nodes import NodeRanges, assign
from cooploc.scenarios.recordings.team_log import Series
from cooploc.scenarios.recordings.text_files import files_below

# Words of topics whose poses are odometry, estimates, or were wanted.
NOT_TRUE = ODOMETRY | ESTIMATES | {"goal", "goals", "waypoint", "setpoint", "target", "desired", "plan", "initialpose"}
RANGE, IMU = "sensor_msgs/msg/Range", "sensor_msgs/msg/Imu"
FRAME = "header.frame_id"
# Usual types that are read by their fields.
OF_FIELDS = ("tf2_msgs/msg/TFMessage", "geometry_msgs/msg/Vector3Stamped", "sensor_msgs/msg/NavSatFix", IMU)
SPEED = {"Odometry": "twist.twist.linear.x", "TwistWithCovarianceStamped": "twist.twist.linear.x"}
SPEED |= {"TwistStamped": "twist.linear.x", "Twist": "linear.x"}  # type -> field
STATES = TRUTH & CERTAIN  # words by which a topic of Odometry is the truth, as of a simulator
NO_MEASUREMENTS = ("std_msgs", "rcl_interfaces", "rosgraph_msgs", "diagnostic_msgs", "tf2_msgs", "visualization_msgs")
VISUAL = ODOMETRY | {"slam", "orb", "vio", "vins", "vo"}  # in names of topics with poses that drift as odometry does
# type -> fields of position and orientation
PLACE = {"PoseStamped": ("pose.position", "pose.orientation"), "Pose": ("position", "orientation")}
PLACE |= {"TransformStamped": ("transform.translation", "transform.rotation")}
UPRIGHT = ("position.z", "translation.z")  # of what was seen
FLAT = 0.2  # [m] that robots move at least, and share of it by which a floor is flat at most
EACH = 'each = { NAME = "data.0", ... } for the robots or anchors that it is of, in their order'
SURE = 2.0  # times the misfit of the best assignment of radios that the next best must have


def bag_draft(path: Path) -> Draft:
    """Return the draft for a bag: odometry by its type, truth by other poses, ranges by the names of two in a topic.

    What these leave open is looked for in the fields of messages of other types, and in text files beside.
    """
    runs = list(find_runs(path).values()) if path.is_dir() else [path]
    whole = path if all(map(is_bag, runs)) else runs[0]
    every, each = topics(whole)[0], [{t.name for t in topics(run)[0]} for run in runs] if len(runs) > 1 else []
    there = [t for t in every if t.messages > 1 and all(t.name in names for names in each)]
    found = {t.name: t for t in there if t.columns}
    unknown = [t.name for t in there if not t.columns and (t.type not in standard_types() or t.type in OF_FIELDS)]
    of_fields = {t: table_of_fields(t, f) for t, f in (read_fields(whole, unknown) if unknown else {}).items()}
    kept, places = split_places([*of_fields.values()])
    of_fields = dict(zip(of_fields, kept, strict=True))
    states = {name for name in found if STATES & {*words_of(name)}}
    wheels, more = _wheels([t for t in found.values() if t.name not in states], of_fields)
    poses = _poses(found, (*wheels.values(), *more.values()), states)
    truth = _truth_topics(wheels | more, poses, states)
    inspect_each = "; ".join(f"cooploc inspect {run}" for run in runs)
    differ = f"{path}: the topics of its {len(runs)} runs differ; inspect each: {inspect_each}"
    if not wheels and each:
        raise BadInput(differ)
    if not wheels:
        names = ", ".join(f"{t.name} ({t.type.rpartition('/')[2]})" for t in there)[:300]
        remedy = "compute them from wheels, and write odom_NAME.csv beside it, and log.toml by hand"
        lack = "no robot has odometry (nav_msgs/Odometry, or speeds and turn rates)"
        raise BadInput(f"{path}: {lack}; {remedy}; topics: {names}")
    wheels = {robot: (wheels | more)[robot] for robot in truth or wheels}
    robots, numbers = list(wheels), {name: t.type for name, t in found.items() if t.type in (RANGE, *NUMBERS)}
    series = read_topics(whole, [t for t in (*wheels.values(), *truth.values(), *numbers) if t in found])[0]
    imus = [t.name for t in there if t.type == IMU]
    gyroscopes = {robot: topic for robot in robots if (topic := _topic_about(robot, imus))}
    tables = _odometry(wheels, series, of_fields, gyroscopes)
    tables += [_truth(truth, series)] if truth else _truth_of_fields(of_fields, robots)
    tables += _ranges(numbers, robots, truth, series)
    in_bag, beside = {table.name for table in tables}, Draft(())
    for home in text_folders(runs[0]):
        below = files_below(home) if path.is_dir() and home.is_relative_to(path) else home.glob("*")
        texts = [p for p in sorted(below) if is_table(p)]
        beside = beside if beside.tables else tables_beside_bag(home, texts, robots, in_bag, places)
    fixed = [one for table in beside.tables if table.name in ("anchors", "landmarks") for one in table.entries[0].value]
    left = {t: kind for t, kind in numbers.items() if not _tables_of(t, tables, robots)}
    of_numbers, by_frame, frames = _readings_of_one(whole, left, series, robots, fixed)
    tables += [*of_numbers, *(one for one in beside.tables if one.name not in {table.name for table in of_numbers})]
    untrue = {t: f for t, f in of_fields.items() if "truth" not in _tables_of(t, tables, robots)}
    tables += _readings_of_fields(untrue | by_frame, robots, fixed)
    seen = pairs_of_robots([name for name in poses if SEEN & {*words_of(name)}], robots, "range")
    why = "poses in topics with the names of two robots, in the axes of the first"
    tables += [DraftTable("sightings", (Entry("topic", p, why, "likely"),)) for p in dict.fromkeys(seen.values())]
    has_truth = "truth" in {table.name for table in tables}
    if not has_truth and any(t.type.endswith("/Odometry") and t.name not in names for t in every for names in each):
        raise BadInput(differ)
    why = f"what differs between topics of odometry{' with a truth' * bool(truth)}"
    entries = Entry("format", "bag", "a ROS bag"), Entry("robots", robots, why, "likely")
    used = {t.name: ", ".join(of) for t in every if (of := _tables_of(t.name, tables, robots))}
    columns, unused = _topic_rows(every, found, used, frames)
    if not has_truth:
        unused.insert(0, "truth, as no pose has the name or number of a robot with odometry, nor a text file beside")
    return Draft(entries, tuple(tables), (*beside.columns, *columns), (*beside.unused, *unused))


def _poses(found: Mapping[str, TopicInfo], wheels: Collection[str], states: Collection[str]) -> list[str]:
    """Return the topics of poses that may be true: of `states`, or neither odometry, an estimate nor a goal."""
    poses = [name for name, t in found.items() if "x [m]" in t.columns and "PoseArray" not in t.type]
    return [n for n in poses if n not in wheels and (n in states or not NOT_TRUE & {*words_of(n)})]


def _truth_topics(wheels: Collection[str], poses: Sequence[str], states: Collection[str]) -> dict[str, str]:
    """Return the topics of true poses by robot, of `states` first; of a single robot its name need not be there."""
    certain = [name for name in poses if name in states]
    about = {robot: _topic_about(robot, certain) or _topic_about(robot, poses) for robot in wheels}
    truth = {robot: name for robot, name in about.items() if name} or _topics_by_number([*wheels], poses)
    return truth or ({robot: name for robot in wheels for name in certain} if len(wheels) == 1 else {})


def _topic_rows(
    every: Sequence[TopicInfo], known: Collection[str], used: Mapping[str, str], frames: Mapping[str, Sequence[str]]
) -> tuple[list[tuple[str, str, str, str]], list[str]]:
    """Return a row for each topic that is `known` or `used`, and lines on those that are not used.

    `frames` are those of ranges that do not say otherwise what was measured.
    """
    columns, unused = list[tuple[str, str, str, str]](), list[str]()
    for t in every:
        if t.name not in known and t.name not in used:
            continue
        form, rate = t.type.rpartition("/")[2], f"{t.messages} messages, {t.rate:.3g} Hz, {t.last - t.first:.3g} s"
        columns.append((t.name, form, used.get(t.name, "not used"), rate))
        if t.name not in used:
            more = ": does not say what was measured; write {other} for its name" if t.type == RANGE else ""
            if len(names := frames.get(t.name, ())) > 1:
                some = ", ".join(names[:5]) + ", ..." * (len(names) > 5)
                more = f": of frames {some}, whose places are not known; if these are anchors, write their id, x, y"
                more += " into anchors.csv beside"
            unused.append(f"{t.name} ({form}, {t.messages}){more}")
    strange = [t for t in every if not t.columns and t.name not in used]
    of_readings = {t.name for t in strange if name_meaning(t.name)[0] in ("range", "rssi")}  # also in a std_msgs/String
    unread = []
    for t in strange:
        if "MultiArray" in t.type and t.name in of_readings:
            unused.append(f"{t.name}, an array that does not say of what: write {EACH}")
        elif "MultiArray" in t.type or t.name in of_readings or not t.type.startswith(NO_MEASUREMENTS):
            unread.append(f"{t.name} ({t.type})")
    if unread:
        kinds = f"topics of types that are not read: {first_of(unread, 5)}"
        unused.append(f"{kinds}; what they measured may be in CSV files beside")
    return columns, unused


def _tables_of(topic: str, tables: Sequence[DraftTable], robots: Sequence[str]) -> list[str]:
    """Return the names of the tables that read a topic."""
    found = []
    for table in tables:
        values = {e.key: e.value for e in table.entries}
        words = "|".join(map(re.escape, robots)) if table.name in ("odometry", "turns", "truth") else "[^/]+"
        for pattern in (*values.get("topics", {}).values(), *filter(None, [values.get("topic")])):
            parts = re.split(r"\{(?:robot|other)\}", pattern)
            found += [table.name] * bool(re.fullmatch(f"({words})".join(map(re.escape, parts)), topic))
    return list(dict.fromkeys(found))


# --- Names


def topics_by_robot(topics: Sequence[str]) -> dict[str, str]:
    """Map robots to topics: the part of the names that differs between most of them; the first topic of each robot."""
    marked = [
        (name, part, "/".join("{robot}" if piece == part else piece for piece in name.split("/")))
        for name in topics
        for part in name.strip("/").split("/")
    ]
    if not marked:
        return {}
    best, most = Counter(pattern for _, _, pattern in marked).most_common(1)[0]
    if most < 2:
        words = {name: name.strip("/").split("/")[:-1] for name in reversed(topics)}
        return {next((w for w in words[name] if not {*words_of(w)} <= ODOMETRY), "robot"): name for name in words}
    found = {part: name for name, part, pattern in reversed(marked) if pattern == best}
    if all(ODOMETRY & {*words_of(robot)} for robot in found):  # /odom_1 is of 1
        if alone := [name for robot, name in found.items() if {*words_of(robot)} <= ODOMETRY and robot.isalpha()]:
            return {"robot": alone[-1]}  # /odom beside /raw_odom
        names = list(found.values())
        found = dict(zip(file_pattern([f"{name}." for name in names])[1], names, strict=False)) or found
    letters = {re.sub(r"\d", "", robot) for robot in found}
    for name, part, _ in marked:  # the same kind of robot under another topic
        if part not in found and re.search(r"\d", part) and re.sub(r"\d", "", part) in letters:
            found[part] = name
    return dict(sorted(found.items()))


def _topic_about(robot: str, topics: Sequence[str]) -> str:
    """Return the first topic about a robot: with its name as a word, its name, or its first letters and its number."""
    whole = re.compile(rf"(?<![A-Za-z0-9]){re.escape(robot)}(?![A-Za-z0-9])", re.IGNORECASE)
    kind = re.fullmatch(r"([A-Za-z]*)[_-]?(\d+)", robot)

    def has_number(topic: str) -> bool:
        parts = re.findall(r"([A-Za-z]+)[_-]?(\d+)", topic.lower()) if kind else ()
        return any(kind and int(n) == int(kind[2]) and word.startswith(kind[1].lower()[:4]) for word, n in parts)

    rules = (lambda topic: bool(whole.search(topic)), lambda topic: _names(topic, robot), has_number)
    return next((topic for rule in rules for topic in topics if rule(topic)), "")


def _topics_by_number(robots: Sequence[str], topics: Sequence[str]) -> dict[str, str]:
    """Return the topic of each robot, if they are alike but for the last number: /mocap_2 of robot_2; else none."""
    numbers, found = numbers_of(robots), dict[str, dict[str, str]]()
    for topic in topics:
        for number in re.findall(r"\d+", topic)[-1:]:
            if robot := numbers.get(str(int(number))):
                found.setdefault("{}".join(topic.rsplit(number, 1)), {})[robot] = topic
    whole = [of for of in found.values() if {*of} == {*robots}]
    return whole[0] if len(whole) == 1 else {}


def _names(topic: str, robot: str) -> bool:
    """Return whether a robot's name is in a topic: robot_1 is not in /robot_12/odom."""
    return bool(re.search(rf"{re.escape(robot)}(?!\d)", topic))


def _robot_of(topic: str, robots: Sequence[str]) -> str:
    """Return the robot whose name is in a topic, or the only one; "" where there is none."""
    there = [robot for robot in robots if _names(topic, robot)]
    return max(there, key=len, default=robots[0] if len(robots) == 1 else "")


def _pair(topic: str) -> tuple[str, str] | None:
    """Return the two parts of a name that differ in their number alone: the nodes of a range."""
    parts = [part for part in topic.split("/") if re.search(r"\d", part)]
    alike = [(a, b) for a, b in pairwise(parts) if re.sub(r"\d", "", a) == re.sub(r"\d", "", b)]
    return alike[0] if alike and alike[0][0] != alike[0][1] else None


def _topics(by_robot: Mapping[str, str], why: str) -> Entry:
    """Return one pattern if all topics have it, else the topic of each robot."""
    patterns = {topic.replace(robot, "{robot}") for robot, topic in by_robot.items()}
    if len(patterns) == 1 and "{robot}" in (pattern := patterns.pop()):
        return Entry("topic", pattern, why, "likely")
    return Entry("topics", dict(by_robot), why, "likely")


# --- Tables


def _wheels(found: Sequence[TopicInfo], of_fields: Mapping[str, CsvTable]) -> tuple[dict[str, str], dict[str, str]]:
    """Return the topics of odometry by robot: odometry counts first, then speeds, commands, and poses by a camera.

    The second are of the same kind, of robots that have it by another name or of a filter.
    """
    fields = [
        topic
        for topic, table in of_fields.items()
        if first_columns(table.guesses, ("speed",)) and not TRUTH & {*words_of(topic)}
        if not first_columns(table.guesses, ("robot", "other"))
    ]
    for forms in (["Odometry"], ["TwistStamped", "TwistWithCovarianceStamped"], [], ["Twist"]):
        if some := [t.name for t in found if t.type.rpartition("/")[2] in forms] if forms else fields:
            own = topics_by_robot([name for name in some if not ESTIMATES & {*words_of(name)}] or some)
            return own, _of_other_robots(own, some if forms else [])
    return topics_by_robot([t.name for t in found if "x [m]" in t.columns and VISUAL & {*words_of(t.name)}]), {}


def _of_other_robots(own: Mapping[str, str], topics: Sequence[str]) -> dict[str, str]:
    """Return the first topic of each other robot by name: /blue/odometry/filtered beside /red/odom and /green/odom."""
    places = {topic.split("/").index(robot) for robot, topic in own.items() if robot in topic.split("/")}
    parts = {topic: topic.split("/") for topic in reversed(topics)}
    k = min(places, default=0)
    return {of[k]: topic for topic, of in parts.items() if k and len(of) > k + 1 and of[k] not in own}


def _truth(truth: Mapping[str, str], series: Mapping[str, TopicSeries]) -> DraftTable:
    """Return the truth in poses; where all robots move along x and z alone, y is up, as some trackers have it.

    Without headings where these never change.
    """
    where = _topics(truth, "a pose under the name or number of a robot that is not odometry")
    every = [series[topic] for topic in truth.values()]
    width, height = (max(np.ptp(one.select(q, table="truth")) for one in every) for q in ("y [m]", "z [m]"))
    form = every[0].type.rpartition("/")[2]
    if form not in PLACE or height < FLAT or width > FLAT * height:
        poses = [one.select("heading [rad]", "x [m]", "y [m]") for one in every]
        if form not in PLACE or not all(is_held(pose[:, :1], pose[:, 1:]) for pose in poses):
            return DraftTable("truth", (where,))
        why = f"orientations are {HELD}"
        return DraftTable("truth", (where, *(Entry(q, f"{PLACE[form][0]}.{q}", why, "likely") for q in "xy")))
    (place, turn), why = PLACE[form], f"y is up: it changes by {width:.2g} m, and z by {height:.2g} m"
    y, heading = {"column": f"{place}.z", "unit": "-m"}, {"quaternion": [f"{turn}.y", f"{turn}.w"]}
    entries = [Entry("x", f"{place}.x", why, "likely"), Entry("y", y, why, "likely")]
    return DraftTable("truth", (where, *entries, Entry("heading", heading, why, "likely")))


def _truth_of_fields(of_fields: Mapping[str, CsvTable], robots: Sequence[str]) -> list[DraftTable]:
    """Return the truth among messages that are read by their fields: by a field with names of robots, or by topic."""
    why, about = "its messages have places", dict[str, dict[str, Guess]]()
    for topic, table in of_fields.items():
        own = first_columns(table.guesses, ("x", "y", "heading"))
        if not {"x", "y"} <= own.keys() or NOT_TRUE & {*words_of(topic)}:
            continue
        names = {g.column: table.names(g.column) for g in table.guesses if _may_name(g)}
        if max(map(len, names.values()), default=0) < 2:
            about[topic] = own
            continue
        column, words = max(names.items(), key=lambda one: len({*one[1]} & {*robots}))
        meant = {word: word for word in words if word in robots} | match_names(words, robots)
        if {*meant.values()} >= {*robots} and not _is_moved_by_odometry(table, column, {*meant}):
            nodes = {word: robot for word, robot in meant.items() if word != robot}
            entries = [Entry("topic", topic, f"{why} of robots by name", "likely"), Entry("robot", column, "names")]
            entries += [column_entry(quantity, guess) for quantity, guess in own.items()] + frame_entries(own, table)
            entries += [Entry("nodes", nodes, "these words and names of robots are alike", "likely")] * bool(nodes)
            return [DraftTable("truth", tuple(entries))]
    there = {robot: topic for robot in robots if (topic := _topic_about(robot, list(about)))}
    fields = [[column_entry(quantity, guess) for quantity, guess in about[topic].items()] for topic in there.values()]
    if not fields or any([e.value for e in one] != [e.value for e in fields[0]] for one in fields):
        return []
    topic = next(iter(there.values()))
    origin = frame_entries(about[topic], of_fields[topic])
    return [DraftTable("truth", (_topics(there, f"{why} of each robot"), *fields[0], *origin))]


def _may_name(field: Guess) -> bool:
    """Return whether the words in a field may be names of robots."""
    return field.quantity in ("robot", "other") or "child_frame_id" in field.column


def _is_moved_by_odometry(table: CsvTable, child: str, words: set[str]) -> bool:
    """Return whether the frames of robots stand in frames of odometry, as /tf has them of what wheels say."""
    parents = table.columns.get(child.replace("child_frame_id", "header.frame_id"), ())
    pairs = zip(table.columns[child], parents, strict=False) if "child_frame_id" in child else ()
    return any(ODOMETRY & {*words_of(str(parent))} for one, parent in pairs if one in words)


def _readings_of_fields(
    of_fields: Mapping[str, CsvTable], robots: Sequence[str], fixed: Sequence[str]
) -> list[DraftTable]:
    """Return sightings, ranges and RSSI in messages of types that are not usual, by the names of their fields."""
    lines: dict[tuple[str, str, str], tuple[Entry, ...]] = {}
    heard: dict[tuple[str, str, str], list[tuple[str, list[str], list[str]]]] = {}  # robot, words, and its own
    by_number = pairs_by_number(of_fields, robots)
    by_topic = by_number | pairs_with_places(of_fields, robots, fixed) | pairs_of_robots(of_fields, robots, "range")
    for topic, table in of_fields.items():
        own = _robot_of(topic, robots)
        whose, things = ([g for g in table.guesses if g.quantity == name] for name in ("robot", "other"))
        if len(ends := [*whose, *things]) > (not own):
            other = things[0] if things and (own or whose) else ends[-1]
            named, place = [("robot", ends[0])] * (not own) + [("other", other)], _place(other)
            pattern = topic.replace(own, "{robot}") if own else topic
        elif topic in by_topic:
            pattern, named, place = by_topic[topic], [], ""
        else:
            continue
        for table_name, columns in _reading_columns(topic, table, place).items():
            words = [word for _, guess in named for word in table.names(guess.column)]
            key = table_name, pattern, next(iter(columns.values())).column
            heard.setdefault(key, []).append((own, words, table.names(ends[0].column) if len(ends) > 1 else []))
            own_fields = (column_entry(quantity, guess) for quantity, guess in (*columns.items(), *named))
            lines[key] = Entry("topic", pattern, "its messages have such fields", "likely"), *own_fields
    why = "these words in the messages and the names of the robots are alike, or are of one robot's topic"
    found = []
    for key, entries in lines.items():
        nodes = match_names([w for _, words, _ in heard[key] for w in words if clean_name(w) not in fixed], robots)
        if any(own and own == nodes.get(word) for own, words, _ in heard[key] for word in words):
            nodes = {}  # no robot measures itself: these are of anchors
        nodes |= numbers_of(robots) if key[1] in by_number.values() else {}
        nodes |= {mine[0]: own for own, words, mine in heard[key] if own and len(mine) == 1 and mine[0] not in words}
        found.append(DraftTable(key[0], (*entries, *[Entry("nodes", nodes, why, "likely")] * bool(nodes))))
    return found


def _reading_columns(topic: str, table: CsvTable, place: str) -> dict[str, dict[str, Guess]]:
    """Return the columns of each table that fields make, those in the part of a message that names things first."""
    found = dict[str, dict[str, Guess]]()
    for name, quantity in (("ranges", "range"), ("rssi", "rssi")):

        def order(g: Guess, quantity: str = quantity) -> tuple[bool, ...]:
            last = g.column.rpartition(".")[2]
            return _place(g) != place, is_second_choice(last), name_meaning(last)[0] != quantity, not is_plain(last)

        if some := sorted((g for g in table.guesses if g.quantity == quantity), key=order):
            found[name] = {quantity: some[0]}
            beside = first_columns([g for g in table.guesses if _place(g) == _place(some[0])], ("bearing",))
            if quantity == "range" and beside:
                found["sightings"] = found.pop(name) | beside
    at = next((g.column.removesuffix(".z") for g in table.guesses if g.column.endswith(UPRIGHT)), "")
    if found or not SEEN & {*words_of(topic)}:
        return found
    if at:
        x, y, z = (f"{at}.{q}" for q in "xyz")
        is_optical = np.ptp(table.numbers(z)) > np.ptp(table.numbers(y))  # of two axes the upright one changes little
        why = (
            f"axes of {'a camera, z ahead and x to the right' if is_optical else 'a robot, x ahead and y to the left'}"
        )
        ahead, left = (z, x) if is_optical else (x, y)
        unit = "-m" if is_optical else "m"
        found["sightings"] = {"x": Guess(ahead, "x", "m", "", why), "y": Guess(left, "y", unit, "", why)}
    elif {"x", "y"} == (own := first_columns(table.guesses, ("x", "y"))).keys():
        found["sightings"] = {q: guess._replace(reason=f"{guess.reason}, in {topic}") for q, guess in own.items()}
    return found


def _ranges_by_frame(
    tables: Mapping[str, CsvTable], robots: Sequence[str], fixed: Sequence[str]
) -> dict[str, CsvTable]:
    """Return the fields of sensor_msgs/Range in robots' own topics where the frames are what was measured."""
    found = {}
    for topic, table in tables.items():
        own = _robot_of(topic, robots)
        named = {part for word in table.names(FRAME) for part in word.split("/")}
        if own and own not in named and named & {*robots, *fixed}:  # sonar_1 is of no robot
            why = "the frames of its headers are robots or places"
            guesses = (g._replace(quantity="other", reason=why) if "frame_id" in g.column else g for g in table.guesses)
            found[topic] = table._replace(guesses=tuple(guesses))
    return found


def _place(field: Guess) -> str:
    """Return the part of a message that a field is in: "nodes" of nodes.id."""
    return field.column.rpartition(".")[0]


def _odometry(
    wheels: Mapping[str, str],
    series: Mapping[str, TopicSeries],
    of_fields: Mapping[str, CsvTable],
    imus: Mapping[str, str],
) -> list[DraftTable]:
    """Return poses, if their headings turn as their turn rates say and their places change; else velocities.

    Where they never turn, turn rates are those of `imus`, the topics of gyroscopes by robot.
    """
    first, every = next(iter(wheels.values())), [series[topic] for topic in wheels.values() if topic in series]
    filtered = first_of(topic for topic in wheels.values() if ESTIMATES & {*words_of(topic)})
    also = f"; {filtered} is what a filter says, perhaps of more than wheels" * bool(filtered)
    kind, why, where = "velocity", "its messages have speeds", _topics(wheels, f"its messages are of motion{also}")
    if every and every[0].type.endswith("/Odometry"):
        where = _topics(wheels, f"its type is Odometry{also}")
        why = "the headings of the poses do not turn as the turn rates beside them"
        if all(map(_turns_as_stated, every)) and any(np.ptp(one.select("x [m]")) > 0.01 for one in every):
            kind, why = "pose", "poses lose nothing with a lost message"
    elif every and "x [m]" in every[0].columns:
        return [DraftTable("odometry", (Entry("kind", "pose", "its messages are poses", "perhaps"), where))]
    own = first_columns(of_fields[first].guesses, ("speed", "turn_rate")) if first in of_fields else {}
    fields = [column_entry(quantity, guess) for quantity, guess in own.items()]
    turns = "turn_rate" in own or any(one.select("omega [rad/s]").any() for one in every)
    if kind == "pose" or turns or (len(imus) < len(wheels) and not fields):
        return [DraftTable("odometry", (Entry("kind", kind, why, "likely"), where, *fields))]
    if not imus and fields:
        lack = "its messages have speeds and no turn rates, and there is no topic of sensor_msgs/Imu"
        raise BadInput(f"topic {first}: {lack}; add turn rates, as of a gyroscope, in a CSV file beside ([turns])")
    fields = fields or [Entry("speed", SPEED[every[0].type.rpartition("/")[2]], "its speeds", "likely")]
    rate = Entry("turn_rate", "angular_velocity.z", "turn rates of a gyroscope, as odometry has none", "likely")
    return [
        DraftTable("odometry", (Entry("kind", kind, why, "likely"), where, *fields)),
        DraftTable("turns", (_topics(imus, "their type is Imu"), rate)),
    ]


def _turns_as_stated(series: TopicSeries) -> bool:
    """Return whether headings change by half to twice the integrated turn rate, or neither turns by a radian in all."""
    heading, rate = series.select("heading [rad]", "omega [rad/s]").T
    if not np.isfinite(heading).all() or len(heading) < 2:
        return False
    turned, stated = np.abs(np.diff(np.unwrap(heading))).sum(), np.abs(np.diff(series.time) * rate[1:]).sum()
    return bool(max(turned, stated) < 1.0 or stated == 0 or stated / 2 < turned < 2 * stated)


def _ranges(
    numbers: Mapping[str, str], robots: Sequence[str], truth: Mapping[str, str], series: Mapping[str, TopicSeries]
) -> list[DraftTable]:
    """Return ranges and RSSI in topics of one number, by the names of two robots or of two radios.

    `numbers` are their types.
    """
    named = pairs_of_robots(numbers, robots)
    by_number = {t: p for t, p in pairs_by_number(numbers, robots).items() if t not in named}
    left = [t for t in numbers if t not in (*named, *by_number) and "Int" not in numbers[t]]
    radios = {pair: t for t in left if (pair := _pair(t))}
    found = [_ranges_of_radios(radios, truth, series)] if radios else []
    return found + _tables_of_numbers(named, series) + _tables_of_numbers(by_number, series, numbers_of(robots))


def _readings_of_one(
    whole: Path, numbers: Mapping[str, str], series: Mapping[str, TopicSeries], robots: Sequence[str], fixed: list[str]
) -> tuple[list[DraftTable], dict[str, CsvTable], dict[str, list[str]]]:
    """Return the readings in topics of one number that name no two robots: of `fixed` places, or of the only teammate.

    The fields of those where a frame is what was measured are the second, and the frames of each topic the third.
    """
    left = [t for t, kind in numbers.items() if kind == RANGE or name_meaning(t)[0] in ("range", "rssi")]
    ranges = [t for t in left if numbers[t] == RANGE]
    framed = {t: table_of_fields(t, f) for t, f in (read_fields(whole, ranges) if ranges else {}).items()}
    by_frame, frames = _ranges_by_frame(framed, robots, fixed), {t: one.names(FRAME) for t, one in framed.items()}
    alone = [t for t in left if t not in by_frame and len(frames.get(t, ())) < 2]
    of_places = pairs_with_places(alone, robots, fixed)
    of_mate = [t for t in alone if t not in of_places]
    return _tables_of_numbers(of_places | _topics_of_one(of_mate, robots), series), by_frame, frames


def _topics_of_one(left: Sequence[str], robots: Sequence[str]) -> dict[str, str]:
    """Return the pattern of ranges, and of RSSI, where each of two robots has one topic: it measured its teammate."""
    found = dict[str, str]()
    for is_rssi in (False, True):
        kind = [t for t in left if (name_meaning(t)[0] == "rssi") == is_rssi]
        each = {robot: [t for t in kind if _names(t, robot)] for robot in robots}
        patterns = {t.replace(robot, "{robot}") for robot, own in each.items() for t in own}
        if len(robots) == 2 and len(patterns) == 1 and all(len(own) == 1 for own in each.values()):
            found |= {own[0]: pattern for own in each.values() for pattern in patterns}
    return found


def _tables_of_numbers(
    named: Mapping[str, str], series: Mapping[str, TopicSeries], nodes: Mapping[str, str] = MappingProxyType({})
) -> list[DraftTable]:
    """Return ranges and RSSI of each pattern of topics, with their unit; `nodes` are the names of robots in them."""
    found = list[DraftTable]()
    for pattern in dict.fromkeys(named.values()):
        is_rssi = name_meaning(pattern)[0] == "rssi"
        values = np.concatenate([series[t].values[:, 0] for t, p in named.items() if p == pattern])
        unit, why = infer_unit("range", "", values, np.inf)
        entries = [Entry("topic", pattern, "topics with the names of robots", "likely")]
        entries += [Entry("unit", unit, why, "likely")] * (unit != "m" and not is_rssi)
        entries += [Entry("nodes", dict(nodes), "the last numbers of their names", "likely")] * bool(nodes)
        found.append(DraftTable("rssi" if is_rssi else "ranges", tuple(entries)))
    return found


def _ranges_of_radios(
    ranges: Mapping[tuple[str, str], str], truth: Mapping[str, str], series: Mapping[str, TopicSeries]
) -> DraftTable:
    """Return the ranges, and which radio is on which robot: by the truth, from which it may be found."""
    (a, b), topic = next(iter(ranges.items()))
    pattern = topic.replace(f"/{a}", "/{robot}", 1).replace(f"/{b}", "/{other}", 1)
    entry = Entry("topic", pattern, f"{len(ranges)} topics with two numbered nodes", "likely")
    if len(truth) < 2:
        return DraftTable("ranges", (entry,))
    every = [NodeRanges(x, y, series[t].time, series[t].values[:, 0]) for (x, y), t in ranges.items()]
    poses = {robot: series[t].select("x [m]", "y [m]", "heading [rad]") for robot, t in truth.items()}
    found = assign(every, {robot: Series(series[t].time, poses[robot], t) for robot, t in truth.items()})
    why = (
        f"ranges fit the distances by the truth to {found.residual:.3f} m (median, less a bias of each pair); "
        f"the next best assignment to {found.second:.3f} m"
    )
    sure = "likely" if found.second > SURE * found.residual else "perhaps"
    if len(found.nodes) == 2 and not found.others:
        why, sure = "two radios on two robots: which is whose makes no difference to ranges", "perhaps"
    nodes = Entry("nodes", {node: robot for robot, node in found.nodes.items()}, why, sure)
    others = f"Nodes on no robot: {', '.join(found.others)}. Survey them, and name them in [anchors] places."
    return DraftTable("ranges", (entry, nodes), (others,) * bool(found.others))

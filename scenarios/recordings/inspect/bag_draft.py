"""A log.toml for a ROS bag: odometry, truth and ranges among its topics, their robots, and the robots' radios."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.bag_storage import is_bag, standard_types
from cooploc.scenarios.recordings.bags import TopicSeries, find_runs, read_fields, read_topics, text_folders, topics
from cooploc.scenarios.recordings.inspect.columns import Guess, table_of_fields
from cooploc.scenarios.recordings.inspect.csv_draft import column_entry, split_readings, tables_beside_bag
from cooploc.scenarios.recordings.inspect.draft_toml import Draft, DraftTable, Entry
from cooploc.scenarios.recordings.inspect.naming import (
    ODOMETRY,
    TRUTH,
    clean_name,
    match_names,
    name_meaning,
    pairs_of_robots,
    words_of,
)
from cooploc.scenarios.recordings.radio_nodes import NodeRanges, assign
from cooploc.scenarios.recordings.team_log import Series
from cooploc.scenarios.recordings.text_files import is_text

NUMBERS = ("sensor_msgs/msg/Range", "std_msgs/msg/Float32", "std_msgs/msg/Float64")
STATES = TRUTH - {"ground", "pos", "cap"}  # words by which a topic of Odometry is the truth, as of a simulator
NO_MEASUREMENTS = ("std_msgs", "rcl_interfaces", "rosgraph_msgs", "diagnostic_msgs", "tf2_msgs", "visualization_msgs")
SURE = 2.0  # times the misfit of the best assignment of radios that the next best must have


def bag_draft(path: Path) -> Draft:
    """Return the draft for a bag: odometry by its type, truth by other poses, ranges by two nodes in a topic's name."""
    runs = list(find_runs(path).values()) if path.is_dir() else [path]
    whole = path if all(map(is_bag, runs)) else runs[0]
    every, each = topics(whole)[0], [{t.name for t in topics(run)[0]} for run in runs] if len(runs) > 1 else []
    found = [t for t in every if t.messages > 1 and t.columns and all(t.name in names for names in each)]
    states = {t.name for t in found if STATES & {*words_of(t.name)}}
    wheels = _by_robot([t.name for t in found if t.type.endswith("/Odometry") and t.name not in states])
    poses = [
        t.name
        for t in found
        if "x [m]" in t.columns and t.name not in wheels.values() and "PoseArray" not in t.type
        if t.name in states or not ODOMETRY & {*words_of(t.name)}
    ]
    truth = {robot: name for robot in wheels if (name := next((p for p in poses if _is_about(p, robot)), ""))}
    if len(wheels) == 1 and not truth:  # its name need not be there
        truth = {robot: name for robot in wheels for name in poses if name in states}
    inspect_each = "; ".join(f"cooploc inspect {run}" for run in runs)
    differ = f"{path}: the topics of its {len(runs)} runs differ; inspect each: {inspect_each}"
    if not wheels and each:
        raise BadInput(differ)
    if not wheels:
        names = ", ".join(t.name for t in found)[:300]
        raise BadInput(f"{path}: no robot has odometry (nav_msgs/Odometry); topics: {names}")
    wheels = {robot: wheels[robot] for robot in truth or wheels}
    named = pairs_of_robots([t.name for t in found if t.type in NUMBERS], list(wheels))
    ranges = {p: t.name for t in found if t.type in NUMBERS and t.name not in named and (p := _pair(t.name))}
    series = read_topics(whole, [*wheels.values(), *truth.values(), *ranges.values()])[0]
    why = "a pose under the name or number of a robot that is not odometry"
    tables = [_odometry(wheels, series)]
    tables += [DraftTable("truth", (_topics(truth, why),))] if truth else []
    if ranges:
        tables.append(_ranges(ranges, truth, series))
    for pattern in dict.fromkeys(named.values()):
        entry = Entry("topic", pattern, "topics with the names of two robots", "likely")
        tables.append(DraftTable(f"{name_meaning(pattern)[0]}s".replace("rssis", "rssi"), (entry,)))
    unknown = [t for t in every if t.messages > 1 and not t.columns and t.type not in standard_types()]
    there, beside = {table.name for table in tables}, Draft(())
    for home in text_folders(runs[0]):
        below = home.rglob("*") if path.is_dir() and home.is_relative_to(path) else home.glob("*")
        texts = [p for p in sorted(below) if is_text(p)]
        beside = beside if beside.tables else tables_beside_bag(home, texts, list(wheels), there)
    tables += beside.tables
    fixed = [name for table in tables if table.name in ("anchors", "landmarks") for name in table.entries[0].value]
    of_fields, measured = _field_tables(whole, [t.name for t in unknown], list(wheels), fixed)
    tables += of_fields
    has_truth = "truth" in {table.name for table in tables}
    if not has_truth and any(t.type.endswith("/Odometry") and t.name not in names for t in every for names in each):
        raise BadInput(differ)
    entries = (
        Entry("format", "bag", "a ROS bag"),
        Entry(
            "robots", list(wheels), f"what differs between topics of odometry{' with a truth' * bool(truth)}", "likely"
        ),
    )
    used = dict.fromkeys(wheels.values(), "odometry") | dict.fromkeys(truth.values(), "truth")
    used |= dict.fromkeys(ranges.values(), "range") | {t: name_meaning(p)[0] for t, p in named.items()}
    used |= measured
    columns, unused = [*beside.columns], [*beside.unused]
    if not has_truth:
        unused.append("truth, as no pose has the name or number of a robot with odometry, nor a text file beside")
    for t in (*found, *(t for t in unknown if t.name in measured)):
        form, rate = t.type.rpartition("/")[2], f"{t.messages} messages, {t.rate:.3g} Hz, {t.last - t.first:.3g} s"
        columns.append((t.name, form, used.get(t.name, "not used"), rate))
        if t.name not in used:
            unused.append(f"{t.name} ({form}, {t.messages})")
    strange = [t for t in every if not (t.columns or t.name in measured or t.type.startswith(NO_MEASUREMENTS))]
    if unread := [f"{t.name} ({t.type})" for t in strange]:
        some = ", ".join(unread[:5]) + f" and {len(unread) - 5} more" * (len(unread) > 5)
        unused.append(f"topics of types that are not read: {some}; what they measured may be in CSV files beside")
    return Draft(entries, tuple(tables), tuple(columns), tuple(unused))


# --- Names


def _by_robot(topics: Sequence[str]) -> dict[str, str]:
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
        parts = {name: name.strip("/").split("/") for name in reversed(topics)}
        return {parts[name][0] if len(parts[name]) > 1 else "robot": name for name in parts}
    found = {part: name for name, part, pattern in reversed(marked) if pattern == best}
    letters = {re.sub(r"\d", "", robot) for robot in found}
    for name, part, _ in marked:  # the same kind of robot under another topic
        if part not in found and re.search(r"\d", part) and re.sub(r"\d", "", part) in letters:
            found[part] = name
    return dict(sorted(found.items()))


def _is_about(topic: str, robot: str) -> bool:
    """Return whether a topic has a robot's name, or a part with its number whose first letters are the robot's."""
    if robot in topic:
        return True
    letters, number = re.match(r"([A-Za-z]*)[_-]?(\d*)", robot).groups()  # type: ignore[union-attr]
    parts = re.findall(r"([A-Za-z]+)[_-]?(\d+)", topic)
    same_number = [word.lower() for word, digits in parts if number and int(digits) == int(number)]
    return any(word.startswith(letters.lower()[:4]) for word in same_number)


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


def _field_tables(
    path: Path, topics: Sequence[str], robots: Sequence[str], fixed: Sequence[str]
) -> tuple[list[DraftTable], dict[str, str]]:
    """Return ranges and RSSI in messages of types that are not known, by the names of their fields; and the topics."""
    lines: dict[tuple[str, str, str], tuple[Entry, ...]] = {}
    nodes: dict[tuple[str, str, str], dict[str, str]] = {}
    used: dict[str, str] = {}
    for topic, fields in read_fields(path, topics).items() if topics else ():
        table = table_of_fields(topic, fields)
        own = next((robot for robot in robots if robot in topic or len(robots) == 1), "")
        ends = [g for quantity in ("robot", "other") for g in table.guesses if g.quantity == quantity]
        named = [("robot", ends[0])] * (not own) + [("other", ends[-1])] if len(ends) > (not own) else []
        for kind in ("range", "rssi") if named else ():
            place, of_kind = _place(ends[-1]), [g for g in table.guesses if g.quantity == kind]
            groups = split_readings([g for g in of_kind if _place(g) == place] or of_kind, named=True)
            if not groups:
                continue
            pattern = topic.replace(own, "{robot}") if own else topic
            words = [word for _, guess in named for word in table.names(guess.column)]
            mine = table.names(ends[0].column) if own and len(ends) > 1 else []
            key = kind, pattern, groups[0][0].column
            known = nodes.setdefault(key, {})
            alike = match_names([word for word in words if clean_name(word) not in fixed], robots)
            known |= (
                {} if own in alike.values() else alike
            )  # a robot does not measure itself: these are anchors' numbers
            known |= {mine[0]: own} if len(mine) == 1 and mine[0] not in words else {}
            of_fields = (column_entry(quantity, guess) for quantity, guess in ((kind, groups[0][0]), *named))
            lines[key] = Entry("topic", pattern, "its messages have such fields", "likely"), *of_fields
            used[topic] = f"{used[topic]}, {kind}" if topic in used else kind
    why = "these words in the messages and the names of the robots are alike, or are of one robot's topic"
    found = []
    for key, entries in lines.items():
        of = (Entry("nodes", nodes[key], why, "likely"),) * bool(nodes[key])
        found.append(DraftTable("rssi" if key[0] == "rssi" else "ranges", (*entries, *of)))
    return found, used


def _place(field: Guess) -> str:
    """Return the part of a message that a field is in: "nodes" of nodes.id."""
    return field.column.rpartition(".")[0]


def _odometry(wheels: Mapping[str, str], series: Mapping[str, TopicSeries]) -> DraftTable:
    """Return poses, if their headings turn as their turn rates say and their places change; else velocities."""
    every = [series[topic] for topic in wheels.values()]
    kind, why = "velocity", "the headings of the poses do not turn as the turn rates beside them"
    if all(map(_turns_as_stated, every)) and any(np.ptp(one.select("x [m]")) > 0.01 for one in every):
        kind, why = "pose", "poses lose nothing with a lost message"
    return DraftTable("odometry", (Entry("kind", kind, why, "likely"), _topics(wheels, "its type is Odometry")))


def _turns_as_stated(series: TopicSeries) -> bool:
    """Return whether headings change by half to twice the integrated turn rate, or neither turns by a radian in all."""
    heading, rate = series.select("heading [rad]", "omega [rad/s]").T
    if not np.isfinite(heading).all() or len(heading) < 2:
        return False
    turned, stated = np.abs(np.diff(np.unwrap(heading))).sum(), np.abs(np.diff(series.time) * rate[1:]).sum()
    return bool(max(turned, stated) < 1.0 or stated == 0 or stated / 2 < turned < 2 * stated)


def _ranges(
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

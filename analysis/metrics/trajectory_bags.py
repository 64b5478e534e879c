"""Poses of robots in ROS bags, as programs for localization publish them.

Topics of nav_msgs/Odometry and geometry_msgs/PoseWithCovarianceStamped have the robots' names in their own; of several
topics of a robot, that with the method's name in it. Where a bag has none of these, topics of poses without covariances
count, such as geometry_msgs/PoseStamped; then the last nav_msgs/Path of each topic, but for plans; then /tf, where the
base of each robot is placed in the root of its tree of frames, between stamps by interpolation, in the plane. A path
whose topic has the method's name, and /tf for the method `tf`, count before all of these. Topics whose names say that
they are the truth (`/vicon/red/pose`, `/red/ground_truth`) are of the truth alone; without any, it is in Gazebo's
ModelStates.
"""

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings import bag_storage
from cooploc.scenarios.recordings.bag_storage import KINDS, Bag, Message, is_bag, stamp_of
from cooploc.scenarios.recordings.inspect.bag_draft import topics_by_robot
from cooploc.scenarios.recordings.inspect.naming import match_names, side_of, words_of
from cooploc.scenarios.recordings.sampling import interpolate
from cooploc.scenarios.recordings.sqlite_recovery import recover

TRUTH = "truth"  # whose poses are the true ones
WITH_COVARIANCE = ("nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseWithCovarianceStamped")
POSES = (
    *WITH_COVARIANCE,
    *(f"geometry_msgs/msg/{kind}" for kind in ("PoseStamped", "TransformStamped", "Pose", "Pose2D", "PointStamped")),
)
PATH, STATES = "nav_msgs/msg/Path", "gazebo_msgs/msg/ModelStates"
FRAMES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
PLANS = {"plan", "planned", "goal", "reference", "desired"}  # words of paths that are to be driven
STILL = 0.05  # [m] a model that extends less is furniture
BASES = "base_footprint", "base_link", "base"  # frames of robots


class BagPoses(NamedTuple):
    """The poses of one robot, in the order of the bag."""

    topic: str
    rows: Array  # (m, 14)  stamp [s], x, y, z [m], heading [rad], and its covariance with x, y (3, 3), 0 if not known
    is_named: bool  # whether the topic has the robot's name


def read_poses(place: Path, robots: Sequence[str], method: str) -> tuple[dict[str, BagPoses], list[str]]:
    """Read the poses in a bag, or in those of a directory, by robot, and notes; of a damaged one what is recovered."""
    rows: dict[str, list[tuple[float, ...]]] = {}
    path, paths, bags, notes = place, dict[Path, str](), list[Bag](), list[str]()
    with suppress(BadInput):  # where there is none
        paths = bag_storage.bags_of_robots(place) if place.is_dir() or is_bag(place) else {}
    with ExitStack() as stack:
        try:
            for path in paths:
                bags += _open_or_recover(path, stack, notes)
            if any(paths.values()):
                bags = _name_after_robots([*paths.values()], bags, robots)
            there = {t: kind for bag in bags for t, kind in bag.types.items() if bag.counts.get(t, 1)}
            poses = {t: kind for t, kind in there.items() if kind in POSES}
            paths_of = {t: PATH for t, kind in there.items() if kind == PATH and not PLANS & {*words_of(t)}}
            named = [of for of in (poses, paths_of) if any(method in t.split("/") for t in of)]
            kinds = {} if method == "tf" else next(filter(None, [*named, poses, paths_of]), {})
            is_unsaid = method == TRUTH and TRUTH not in map(side_of, kinds)
            if STATES in there.values() and (is_unsaid or not kinds):
                rows = _poses_of_models(bags)
                kinds = dict.fromkeys(rows, STATES)
            elif not kinds:
                rows = _poses_of_frames(bags)
                kinds = dict.fromkeys(rows, FRAMES[0])
            chosen = _topics_of_robots(place, kinds, robots, method)
            for bag in bags if not rows else ():
                _collect_poses(bag, rows, {topic: kinds[topic] for topic in chosen.values()})
        except BadInput:
            raise
        except Exception as e:  # rosbags raises whatever its parsers raise on damaged files
            raise BadInput(f"{path}: cannot be read as a bag ({_reason(e)}); repair it") from None
    if lost := [topic for topic in chosen.values() if not rows.get(topic)]:
        raise BadInput(f"{place}: topic {lost[0]} has no message that can be read: get the bag again")
    if method == TRUTH:
        odometry = [topic for topic in chosen.values() if side_of(topic) == "odometry"]
        notes += [f"{place}: topics such as {topic} are taken for the truth" for topic in odometry[:1]]
    is_one = len(robots) < 2
    return {r: BagPoses(t, np.array(rows[t]), is_one or r in t.split("/")) for r, t in chosen.items()}, notes


def _reason(e: Exception) -> str:
    return " ".join(str(e).split())[:100]


def _open_or_recover(path: Path, stack: ExitStack, notes: list[str]) -> list[Bag]:
    """Open a bag; of a damaged one return what is recovered of each file, and note how much."""
    try:
        return [stack.enter_context(bag_storage.open_bag(path))]
    except Exception as e:  # rosbags raises whatever its parsers raise on damaged files
        recovered = [recover(file, _reason(e)) for file in bag_storage.storage_files(path)]
    notes += [warning for _, warning in recovered]
    counts = (Counter(topic for topic, *_ in bag.messages(bag.types)) for bag, _ in recovered)
    return [bag._replace(counts=dict.fromkeys(bag.types, 0) | n) for (bag, _), n in zip(recovered, counts, strict=True)]


def _name_after_robots(prefixes: Sequence[str], bags: Sequence[Bag], robots: Sequence[str]) -> list[Bag]:
    """Return bags that robots recorded at the same time, with topics that several have named after the bags.

    /odom in red.bag and in blue.bag is /red/odom and /blue/odom. Topics that name robots, and several true ones, which
    each robot then has of all, keep their names, and are those of the bag with most of their messages.
    """
    count = Counter(t for bag in bags for t, kind in bag.types.items() if kind in (*POSES, PATH, *FRAMES))
    shared = {topic for topic, n in count.items() if n > 1}
    same = {topic for topic in shared if {*robots} & {*topic.split("/")}}
    if not robots and len(true := {topic for topic in shared if side_of(topic) == TRUTH}) > 1:
        same = true

    def renamed(bag: Bag, prefix: str) -> Bag:
        names = {t: prefix + t if t in shared - same else t for t in bag.types}
        for topic in same & names.keys():
            if bag is not max(bags, key=lambda one: one.counts.get(topic, 0)):
                del names[topic]
        own = {name: t for t, name in names.items()}
        types = {name: bag.types[t] for t, name in names.items()}
        counts = {name: bag.counts.get(t, 1) for t, name in names.items()}

        def messages(topics: Collection[str]) -> Iterator[Message]:
            return ((names[t], at, raw) for t, at, raw in bag.messages([own[name] for name in topics if name in own]))

        return Bag(types, counts, messages, bag.decode)

    return [renamed(bag, prefix) for bag, prefix in zip(bags, prefixes, strict=True)]


def _topics_of_robots(place: Path, kinds: Mapping[str, str], robots: Sequence[str], method: str) -> dict[str, str]:
    """Return the topic of each robot among those of poses, whose types are `kinds`.

    Topics that are called by the truth are of the truth alone, and of the others those with covariances come first.
    """
    if not kinds:
        poses = f"a bag with poses, such as {' or '.join(POSES[:2])}"
        remedy = "write messages of other types as NAME.csv, with time, x, y and heading"
        raise BadInput(f"{place} holds no NAME.txt or NAME.csv, nor {poses}, a nav_msgs/Path or /tf; {remedy}")
    parts = {topic: topic.strip("/").split("/") for topic in kinds}
    true = [topic for topic in kinds if side_of(topic) == TRUTH and method not in {*parts[topic]} - {TRUTH}]
    own = (true if method == TRUTH else [topic for topic in kinds if topic not in true]) or [*kinds]
    if len(robots) < 2 and method != TRUTH:
        own = [topic for topic in own if method in parts[topic]] or own
    own = [topic for topic in own if kinds[topic] in WITH_COVARIANCE] or own
    topics: dict[str, list[str]] = {}
    for topic in own:
        others = [part for part in parts[topic] if part != method] or ["robot"]
        for robot in [one for one in robots if one in parts[topic]] if robots else others[:1]:
            topics.setdefault(robot, []).append(topic)
    if len(robots) == len(own) == 1:  # whatever its name
        topics = {robots[0]: own}
    elif not topics or (not robots and len(topics) == 1 < len(own)):  # /vrpn/red/pose is of red, /tb3_0/odom of robot0
        by_name = topics_by_robot(own)
        meant = match_names(by_name, robots) if robots else {name: name for name in by_name}
        topics = {meant[name]: [topic] for name, topic in by_name.items() if name in meant}
        topics = topics or {robot: own for robot in robots if len(robots) == 1}
    for robot, several in topics.items():
        named = [topic for topic in several if method in parts[topic]]
        if len(several) > 1 and len(named) != 1:
            raise BadInput(
                f"{place} has topics {', '.join(several)} of robot {robot!r}: name the method like a part of one of "
                f"them, as in --tum {several[0].rpartition('/')[2]}={place}; here it is {method!r}"
            )
        topics[robot] = named if len(several) > 1 else several
    return {robot: several[0] for robot, several in topics.items()}


def _collect_poses(bag: Bag, rows: dict[str, list[tuple[float, ...]]], kinds: Mapping[str, str]) -> None:
    """Add the stamp, pose and covariance of every message of these topics in a bag to the rows of its topic."""
    whole: dict[str, Any] = {}
    for topic, received, raw in bag.messages([topic for topic in kinds if topic in bag.types]):
        if kinds[topic] == PATH:  # each has all poses until then
            whole[topic] = raw
            continue
        message = bag.decode(raw, kinds[topic])
        pose = KINDS[kinds[topic]].rows(message)[0][:4]
        C = np.asarray(message.pose.covariance if kinds[topic] in WITH_COVARIANCE else np.zeros(36), float)
        C = C.reshape(6, 6)[np.ix_([0, 1, 5], [0, 1, 5])]
        stamp = 1e-9 * (stamp_of(message) or received)
        rows.setdefault(topic, []).append((stamp, *pose, *C.ravel()))
    for topic, raw in whole.items():
        rows[topic] = []  # of several bags the last one's
        for one in bag.decode(raw, PATH).poses:
            pose = KINDS["geometry_msgs/msg/PoseStamped"].rows(one)[0]
            rows[topic].append((1e-9 * (stamp_of(one) or 0), *pose, *np.zeros(9)))


def _poses_of_frames(bags: Sequence[Bag]) -> dict[str, list[tuple[float, ...]]]:
    """Return the poses of robots in /tf, by names like those of topics: /red/tf of the frame red/base_link.

    They are those of the frames in `BASES`, else of all moving frames in which no other one moves. Topics like /red/tf
    have a tree of frames for each robot, whose names may be alike.
    """
    trees: dict[str, dict[tuple[str, str], list[tuple[float, ...]]]] = {}  # of each robot's topics, or of all
    for bag in bags:
        for topic, received, raw in bag.messages([t for t, kind in bag.types.items() if kind in FRAMES]):
            links = trees.setdefault(topic.rpartition("/")[0], {})
            for one in bag.decode(raw, bag.types[topic]).transforms:
                x, y, _, heading = KINDS["geometry_msgs/msg/TransformStamped"].rows(one)[0]
                frames = one.child_frame_id.strip("/"), one.header.frame_id.strip("/")
                links.setdefault(frames, []).append((1e-9 * (stamp_of(one) or received), x, y, heading))
    found = {}
    for owner, links in trees.items():
        parents = dict(sorted(links, key=lambda frames: len(links[frames])))  # of several, the most frequent one
        bases = ([frame for frame in parents if re.search(rf"(^|[/_]){base}$", frame)] for base in BASES)
        moving = [frame for frame, parent in parents.items() if not _is_fixed(np.array(links[frame, parent]))]
        leaves = [frame for frame in moving if frame not in map(parents.get, moving)]
        frames_of_robots = next(filter(None, bases), leaves)
        for frame in frames_of_robots:
            name = re.sub(rf"(^|[/_])({'|'.join(BASES)})$", "", frame) or frame
            rows = _place_in_root([np.array(sorted(links[step])) for step in _steps_to_root(frame, parents)])
            own = owner if owner and len(frames_of_robots) == 1 else f"{owner}/{name}"
            found[f"{own}/tf"] = [(*row[:3], 0.0, row[3], *np.zeros(9)) for row in rows.tolist()]
    return {name: rows for name, rows in found.items() if len(rows) > 1}


def _poses_of_models(bags: Sequence[Bag]) -> dict[str, list[tuple[float, ...]]]:
    """Return the poses of Gazebo's models that move, by names like those of topics: /red/gazebo/model_states."""
    rows: dict[str, list[tuple[float, ...]]] = {}
    for bag in bags:
        for topic, received, raw in bag.messages([t for t, kind in bag.types.items() if kind == STATES]):
            message = bag.decode(raw, STATES)
            for name, pose in zip(message.name, message.pose, strict=True):
                at = KINDS["geometry_msgs/msg/Pose"].rows(pose)[0]
                rows.setdefault(f"/{name}{topic}", []).append((1e-9 * received, *at, *np.zeros(9)))
    return {name: of for name, of in rows.items() if np.ptp(np.array(of)[:, 1:3], axis=0).max() > STILL}


def _steps_to_root(frame: str, parents: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return the steps (frame, its parent) from a frame to the root of its tree, each frame once."""
    steps: list[tuple[str, str]] = []
    while frame in parents and len(steps) < len(parents):
        steps.append((frame, parents[frame]))
        frame = parents[frame]
    return steps


def _is_fixed(step: Array) -> bool:
    """Return whether transforms (k, 4) are one, as it is said once, or again and again."""
    return bool((step[:, 1:] == step[0, 1:]).all())


def _place_in_root(steps: Sequence[Array]) -> Array:
    """Return stamps and poses (m, 4) in the root, of the transforms (k, 4) of each step from a frame up to it.

    The stamps are those of the step with the most, where all others are known.
    """
    stamps = np.unique(max(steps, key=len)[:, 0])
    pose = np.zeros((len(stamps), 3))
    for step in steps:
        values = np.column_stack([step[:, 1:3], np.unwrap(step[:, 3])])
        fixed = np.tile(values[0], (len(stamps), 1))
        at = fixed if _is_fixed(step) else interpolate(step[:, 0], values, stamps, np.inf)
        c, s = np.cos(at[:, 2]), np.sin(at[:, 2])
        x, y = at[:, 0] + c * pose[:, 0] - s * pose[:, 1], at[:, 1] + s * pose[:, 0] + c * pose[:, 1]
        pose = np.column_stack([x, y, pose[:, 2] + at[:, 2]])
    known = np.isfinite(pose).all(axis=1)
    return np.column_stack([stamps, pose])[known]

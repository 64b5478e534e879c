"""Small bags of all three kinds, written by rosbags: two robots drive circles, see things and measure ranges."""

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
KINDS = ("ros1", "sqlite3", "mcap")
START = 1_700_000_000  # [s]
DELAY = 5_000_000  # [ns] from a header's stamp to its receipt
RATE = 10.0
TOPICS = {
    "/red/odom": "nav_msgs/msg/Odometry",
    "/blue/odom": "nav_msgs/msg/Odometry",
    "/mocap/red": "geometry_msgs/msg/PoseStamped",
    "/mocap/blue": "geometry_msgs/msg/TransformStamped",
    "/amcl/red": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "/red/cmd": "geometry_msgs/msg/Twist",
    "/blue/cmd": "geometry_msgs/msg/TwistStamped",
    "/red/seen": "geometry_msgs/msg/PoseArray",
    "/uwb/red/blue": "sensor_msgs/msg/Range",
    "/rssi/red/blue": "std_msgs/msg/Float32",
    "/range/red/dock": "std_msgs/msg/Float64",
    "/chatter": "std_msgs/msg/String",
}


def made_bag(folder, kind, seconds=2.0, behind=0, start=START, name="team", names=None, compressed=False):
    """Path of a bag, and what it holds: topic -> stamps [s] and rows. The headers' clock is `behind` by so many s.

    `names`: the topics that it has, by their names in TOPICS, and what they are called.
    """
    store, truth = (ROS1 if kind == "ros1" else ROS2), {}
    path, names = folder / (f"{name}.bag" if kind == "ros1" else name), names or {topic: topic for topic in TOPICS}
    if kind == "ros1":
        writer = Writer1(path)
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
    if compressed:
        writer.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
    with writer:
        topics = {topic: name for topic, name in TOPICS.items() if topic in names}
        connections = {t: writer.add_connection(names[t], name, typestore=store) for t, name in topics.items()}
        for k in range(int(seconds * RATE)):
            for topic, name in topics.items():
                t = round(k * 1e9 / RATE)
                message, added = _message(store, start * 10**9 + t - behind * 10**9, topic, k)
                serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
                writer.write(connections[topic], start * 10**9 + t + DELAY, bytes(serialize(message, name)))
                stamps, rows = truth.setdefault(topic, ([], []))
                rows += added
                stamps += [start + k / RATE + (0 if hasattr(message, "header") else DELAY / 1e9)] * len(added)
    return path, {topic: (np.array(stamps), np.array(rows)) for topic, (stamps, rows) in truth.items()}


def made_message(store, name, ns, values):
    """A message of any type with some of its fields, such as {"pose.position.x": 1.0}, and zeros.

    Stamps are `ns`, or those that are given as "header.stamp.ns".
    """

    def value_of(node, kind, given, inside):
        if node == Nodetype.NAME:
            return made_message(store, kind, ns, inside)
        if node == Nodetype.BASE:
            return given if given is not None else "" if kind[0] == "string" else 0.0 if "float" in kind[0] else 0
        (element, of), size = kind
        if element == Nodetype.NAME:
            return [made_message(store, of, ns, one) for one in given or ()]
        return given if of[0] == "string" else np.array(np.zeros(size) if given is None else given, of[0])

    if name == "builtin_interfaces/msg/Time":
        ns = values.get("ns", ns)
        return store.types[name](sec=ns // 10**9, nanosec=ns % 10**9)
    parts = {}
    for key, one in values.items():
        field, _, rest = key.partition(".")
        parts.setdefault(field, {})[rest] = one
    fields = {}
    for field, (node, kind) in store.fielddefs[name][1]:
        inside = parts.get(field, {})
        fields[field] = value_of(node, kind, inside.get(""), inside)
    return store.types[name](**fields)


def write_messages(path, messages, definitions=None):
    """A ROS 2 bag of (topic, type, seconds, fields), received a millisecond later; `definitions` are of other types."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, definition in (definitions or {}).items():
        store.register(get_types_from_msg(definition, name))
    with Writer2(path, version=9) as writer:
        connections = {}
        for topic, name, seconds, fields in sorted(messages, key=lambda one: one[2]):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            ns = round(seconds * 1e9)
            content = store.serialize_cdr(made_message(store, name, ns, fields), name)
            writer.write(connections[topic], ns + 10**6, bytes(content))


def pose_at(x, y, z, heading, prefix=""):
    """The fields of a pose."""
    turn = {f"{prefix}orientation.z": np.sin(heading / 2), f"{prefix}orientation.w": np.cos(heading / 2)}
    return {f"{prefix}position.{q}": float(value) for q, value in zip("xyz", (x, y, z), strict=True)} | turn


def _message(store, ns, topic, k):
    """A message, and its rows: on a circle of radius 2 m, or what is seen or measured there."""
    side = 0.0 if "red" in topic else np.pi
    angle = 0.1 * k / RATE + side
    heading = angle + np.pi / 2 - 2 * side
    at = 2 * np.cos(angle), 2 * np.sin(angle), 0.15, heading
    name, (v, omega) = TOPICS[topic], (0.2, 0.1)
    twist, far, number = {"linear.x": v, "angular.z": omega}, 4.0 + 0.125 * (k % 5), -40.0 - k % 7
    seen = [(3.0 + i, 0.5 * i, 0.1, 0.0) for i in range(k % 3)]
    moved = {f"translation.{q}": value for q, value in zip("xyz", at, strict=False)}
    turned = {"rotation.z": np.sin(heading / 2), "rotation.w": np.cos(heading / 2)}

    def inside(prefix, values):
        return {f"{prefix}.{key}": value for key, value in values.items()}

    values, rows = {
        "Odometry": (pose_at(*at, "pose.pose.") | inside("twist.twist", twist), [(*at, v, omega)]),
        "PoseStamped": (pose_at(*at, "pose."), [at]),
        "PoseWithCovarianceStamped": (pose_at(*at, "pose.pose."), [at]),
        "TransformStamped": (inside("transform", moved | turned), [at]),
        "Twist": (twist, [(v, omega)]),
        "TwistStamped": (inside("twist", twist), [(v, omega)]),
        "PoseArray": ({"poses": [pose_at(*row) for row in seen]}, seen),
        "Range": ({"range": far, "max_range": 100.0}, [(far,)]),
        "String": ({"data": "hello " * (k % 4)}, [(0.0,)]),
    }.get(name.split("/")[-1], ({"data": number}, [(number,)]))
    return made_message(store, name, ns, values), rows

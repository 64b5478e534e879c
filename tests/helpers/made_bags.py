"""Small bags of all three kinds, written by rosbags: two robots drive circles, see things and measure ranges."""

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

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


def _message(store, ns, topic, k):
    """A message, and its rows: on a circle of radius 2 m, or what is seen or measured there."""

    def of(package, name, **fields):
        return store.types[f"{package}_msgs/msg/{name}"](**fields)

    def geometry(name, **fields):
        return of("geometry", name, **fields)

    def pose_of(x, y, z, heading):
        turn = geometry("Quaternion", x=0.0, y=0.0, z=np.sin(heading / 2), w=np.cos(heading / 2))
        return geometry("Pose", position=geometry("Point", x=x, y=y, z=z), orientation=turn)

    stamp = store.types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
    header = of("std", "Header", stamp=stamp, frame_id="world", **({"seq": 0} if store is ROS1 else {}))
    side = 0.0 if "red" in topic else np.pi
    angle = 0.1 * k / RATE + side
    at = x, y, z, _ = 2 * np.cos(angle), 2 * np.sin(angle), 0.15, angle + np.pi / 2 - 2 * side
    pose, v, omega = pose_of(*at), 0.2, 0.1
    linear, angular = geometry("Vector3", x=v, y=0.0, z=0.0), geometry("Vector3", x=0.0, y=0.0, z=omega)
    twist = geometry("Twist", linear=linear, angular=angular)
    posed = geometry("PoseWithCovariance", pose=pose, covariance=np.zeros(36))
    name = TOPICS[topic].split("/")[-1]
    if name == "Odometry":
        moved = geometry("TwistWithCovariance", twist=twist, covariance=np.zeros(36))
        message = of("nav", name, header=header, child_frame_id="base_link", pose=posed, twist=moved)
        return message, [(*at, v, omega)]
    if name == "PoseStamped":
        return geometry(name, header=header, pose=pose), [at]
    if name == "PoseWithCovarianceStamped":
        return geometry(name, header=header, pose=posed), [at]
    if name == "TransformStamped":
        place = geometry("Vector3", x=x, y=y, z=z)
        transform = geometry("Transform", translation=place, rotation=pose.orientation)
        return geometry(name, header=header, child_frame_id="blue", transform=transform), [at]
    if name == "Twist":
        return twist, [(v, omega)]
    if name == "TwistStamped":
        return geometry(name, header=header, twist=twist), [(v, omega)]
    if name == "PoseArray":
        rows = [(3.0 + i, 0.5 * i, 0.1, 0.0) for i in range(k % 3)]
        return geometry(name, header=header, poses=[pose_of(*row) for row in rows]), rows
    if name == "Range":
        limits = {"radiation_type": 0, "field_of_view": 0.0, "min_range": 0.0, "max_range": 100.0}
        far = 4.0 + 0.125 * (k % 5)
        return of("sensor", name, header=header, range=far, **limits), [(far,)]
    if name == "String":
        return of("std", name, data="hello " * (k % 4)), [(0.0,)]
    return of("std", name, data=-40.0 - k % 7), [(-40.0 - k % 7,)]

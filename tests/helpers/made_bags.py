"""Small bags of all three kinds, written by rosbags: two robots drive circles, see things and measure ranges."""

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
KINDS = ("ros1", "sqlite3", "mcap")
START = 1_700_000_000  # [s]
DELAY = 5_000_000  # [ns] from a header's stamp to its receipt
RATE = 10.0


def made_bag(folder, kind, seconds=2.0, behind=0, start=START):
    """Path of a bag, and what it holds: topic -> stamps [s] and rows. The headers' clock is `behind` by so many s."""
    store, truth = (ROS1 if kind == "ros1" else ROS2), {}
    path = folder / ("team.bag" if kind == "ros1" else "team")
    if kind == "ros1":
        writer = Writer1(path)
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        connections = {
            topic: writer.add_connection(topic, type_name, typestore=store) for topic, type_name in TOPICS.items()
        }
        for k in range(int(seconds * RATE)):
            for topic, type_name in TOPICS.items():
                t = round(k * 1e9 / RATE)
                message, row = BUILDERS[type_name](store, start * 10**9 + t - behind * 10**9, topic, k)
                serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
                writer.write(connections[topic], start * 10**9 + t + DELAY, bytes(serialize(message, type_name)))
                stamps, rows = truth.setdefault(topic, ([], []))
                added = row if isinstance(row, list) else [row]
                rows += added
                stamps += [start + k / RATE + (0 if hasattr(message, "header") else DELAY / 1e9)] * len(added)
    return path, {topic: (np.array(stamps), np.array(rows)) for topic, (stamps, rows) in truth.items()}


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


def truth_of(topic, k):
    """x, y, z, heading, v, omega of a robot on a circle of radius 2 m."""
    side = 0.0 if "red" in topic else np.pi
    angle = 0.1 * k / RATE + side
    return 2 * np.cos(angle), 2 * np.sin(angle), 0.15, angle + np.pi / 2 - 2 * side, 0.2, 0.1


def _header(store, ns):
    stamp = store.types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
    named = {"stamp": stamp, "frame_id": "world"}
    if store is ROS1:
        named["seq"] = 0
    return store.types["std_msgs/msg/Header"](**named)


def _pose(store, x, y, z, heading):
    point = store.types["geometry_msgs/msg/Point"](x=x, y=y, z=z)
    return store.types["geometry_msgs/msg/Pose"](position=point, orientation=_turn(store, heading))


def _turn(store, heading):
    return store.types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=np.sin(heading / 2), w=np.cos(heading / 2))


def _twist(store, v, omega):
    vector = store.types["geometry_msgs/msg/Vector3"]
    return store.types["geometry_msgs/msg/Twist"](
        linear=vector(x=v, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=omega)
    )


def _with_covariance(store, name, value):
    return store.types[f"geometry_msgs/msg/{name}WithCovariance"](**{name.lower(): value, "covariance": np.zeros(36)})


def _odometry(store, ns, topic, k):
    x, y, z, heading, v, omega = truth_of(topic, k)
    message = store.types["nav_msgs/msg/Odometry"](
        header=_header(store, ns),
        child_frame_id="base_link",
        pose=_with_covariance(store, "Pose", _pose(store, x, y, z, heading)),
        twist=_with_covariance(store, "Twist", _twist(store, v, omega)),
    )
    return message, (x, y, z, heading, v, omega)


def _pose_stamped(store, ns, topic, k):
    row = truth_of(topic, k)[:4]
    return store.types["geometry_msgs/msg/PoseStamped"](header=_header(store, ns), pose=_pose(store, *row)), row


def _pose_covariance(store, ns, topic, k):
    row = truth_of(topic, k)[:4]
    pose = _with_covariance(store, "Pose", _pose(store, *row))
    return store.types["geometry_msgs/msg/PoseWithCovarianceStamped"](header=_header(store, ns), pose=pose), row


def _transform(store, ns, topic, k):
    x, y, z, heading = row = truth_of(topic, k)[:4]
    transform = store.types["geometry_msgs/msg/Transform"](
        translation=store.types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z), rotation=_turn(store, heading)
    )
    kind = store.types["geometry_msgs/msg/TransformStamped"]
    return kind(header=_header(store, ns), child_frame_id="blue", transform=transform), row


def _twist_plain(store, ns, topic, k):
    row = truth_of(topic, k)[4:]
    return _twist(store, *row), row


def _twist_stamped(store, ns, topic, k):
    row = truth_of(topic, k)[4:]
    return store.types["geometry_msgs/msg/TwistStamped"](header=_header(store, ns), twist=_twist(store, *row)), row


def _pose_array(store, ns, topic, k):
    rows = [(3.0 + i, 0.5 * i, 0.1, 0.0) for i in range(k % 3)]
    poses = [_pose(store, *row) for row in rows]
    return store.types["geometry_msgs/msg/PoseArray"](header=_header(store, ns), poses=poses), rows


def _range(store, ns, topic, k):
    row = (4.0 + 0.125 * (k % 5),)
    message = store.types["sensor_msgs/msg/Range"](
        header=_header(store, ns), radiation_type=0, field_of_view=0.0, min_range=0.0, max_range=100.0, range=row[0]
    )
    return message, row


def _number(bits):
    def build(store, ns, topic, k):
        return store.types[f"std_msgs/msg/Float{bits}"](data=-40.0 - k % 7), (-40.0 - k % 7,)

    return build


def _string(store, ns, topic, k):
    return store.types["std_msgs/msg/String"](data="hello " * (k % 4)), (0.0,)


BUILDERS = {
    "nav_msgs/msg/Odometry": _odometry,
    "geometry_msgs/msg/PoseStamped": _pose_stamped,
    "geometry_msgs/msg/PoseWithCovarianceStamped": _pose_covariance,
    "geometry_msgs/msg/TransformStamped": _transform,
    "geometry_msgs/msg/Twist": _twist_plain,
    "geometry_msgs/msg/TwistStamped": _twist_stamped,
    "geometry_msgs/msg/PoseArray": _pose_array,
    "sensor_msgs/msg/Range": _range,
    "std_msgs/msg/Float32": _number(32),
    "std_msgs/msg/Float64": _number(64),
    "std_msgs/msg/String": _string,
}

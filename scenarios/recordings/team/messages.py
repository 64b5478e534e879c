"""What is read of a ROS message: its columns of numbers, and its own stamp.

ROS 1 and ROS 2 give these types the same fields (REP 103: SI units, x forward, y left). A robot that drives on a floor
needs x, y and heading; z stays, as a radio or a marker sits at some height.

Source: the message definitions of std_msgs, geometry_msgs, nav_msgs and sensor_msgs, https://github.com/ros2/common_interfaces.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

Row = tuple[float, ...]
POSE = ("x [m]", "y [m]", "z [m]", "heading [rad]")
TWIST = ("v [m/s]", "omega [rad/s]")


class Kind(NamedTuple):
    """How one type of message is read."""

    columns: tuple[str, ...]
    rows: Callable[[Any], list[Row]]  # of one message; one row, except of arrays


def heading(q: Any) -> float:
    """The angle about z [rad] of a quaternion with fields x, y, z, w; nan where all are zero, as nobody set them."""
    if not (q.x or q.y or q.z or q.w):
        return np.nan
    return float(np.arctan2(2 * (q.w * q.z + q.x * q.y), q.w**2 + q.x**2 - q.y**2 - q.z**2))


def _pose(place: Any, turn: Any) -> Row:
    return (place.x, place.y, place.z, heading(turn))


def _twist(t: Any) -> Row:
    return (t.linear.x, t.angular.z)


def _odometry(m: Any) -> list[Row]:
    return [_pose(m.pose.pose.position, m.pose.pose.orientation) + _twist(m.twist.twist)]


KINDS: Mapping[str, Kind] = {
    "nav_msgs/msg/Odometry": Kind(POSE + TWIST, _odometry),
    "geometry_msgs/msg/PoseStamped": Kind(POSE, lambda m: [_pose(m.pose.position, m.pose.orientation)]),
    "geometry_msgs/msg/PoseWithCovarianceStamped": Kind(
        POSE, lambda m: [_pose(m.pose.pose.position, m.pose.pose.orientation)]
    ),
    "geometry_msgs/msg/TransformStamped": Kind(POSE, lambda m: [_pose(m.transform.translation, m.transform.rotation)]),
    "geometry_msgs/msg/Twist": Kind(TWIST, lambda m: [_twist(m)]),
    "geometry_msgs/msg/TwistStamped": Kind(TWIST, lambda m: [_twist(m.twist)]),
    "geometry_msgs/msg/PoseArray": Kind(POSE, lambda m: [_pose(p.position, p.orientation) for p in m.poses]),
    "sensor_msgs/msg/Range": Kind(("range [m]",), lambda m: [(m.range,)]),
    "std_msgs/msg/Float32": Kind(("value",), lambda m: [(m.data,)]),
    "std_msgs/msg/Float64": Kind(("value",), lambda m: [(m.data,)]),
}


def stamp_of(message: Any) -> int | None:
    """A message's own stamp [ns], or None where its type has no header or nobody set it."""
    header = getattr(message, "header", None)
    if header is None:
        return None
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec) or None

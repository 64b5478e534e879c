"""What the name of a column says: its quantity, its unit, and whose it is."""

import re
from itertools import pairwise
from typing import NamedTuple

# Quantity -> words that name it. The first quantity with a word of the column wins, so the special come first.
WORDS: dict[str, tuple[str, ...]] = {
    "nsec": ("nsec", "nsecs", "nanosec", "nanoseconds", "nanosecs"),
    "sec": ("sec", "secs", "seconds"),
    "time": ("t", "time", "stamp", "timestamp", "ts", "clock"),
    "turn_rate": ("w", "omega", "wz", "yawrate", "gyro", "angvel", "turnrate"),
    "rssi": ("rssi", "signal", "dbm", "power"),
    "bearing": ("bearing", "azimuth", "aoa", "doa"),
    "heading": ("yaw", "theta", "heading", "th", "psi", "orientation", "azimut"),
    "range": ("range", "ranges", "dist", "distance", "tof", "uwb"),
    "dx": ("dx", "deltax"),
    "dy": ("dy", "deltay"),
    "length": ("length", "path", "odometer", "mileage", "travelled", "metres", "meters"),
    "speed": ("v", "vx", "vel", "velocity", "speed", "vlin"),
    "x": ("x", "px", "posx", "east", "easting"),
    "y": ("y", "py", "posy", "north", "northing"),
    "other": ("to", "other", "target", "responder", "tag", "subject", "anchor", "landmark", "dst", "dest", "receiver"),
    "robot": ("robot", "id", "from", "name", "agent", "vehicle", "source", "src", "initiator", "node", "sender"),
}
PAIRS = {  # two words that together name one quantity
    ("yaw", "rate"): "turn_rate",
    ("turn", "rate"): "turn_rate",
    ("ang", "vel"): "turn_rate",
    ("vel", "w"): "turn_rate",
    ("angular", "z"): "turn_rate",
    ("angular", "velocity"): "turn_rate",
    ("angular", "vel"): "turn_rate",
    ("linear", "x"): "speed",
    ("vel", "v"): "speed",
    ("vel", "x"): "speed",
    ("vel", "y"): "",
    ("delta", "x"): "dx",
    ("delta", "y"): "dy",
}
TRUTH = ("truth", "true", "gt", "groundtruth", "ground", "mocap", "vicon", "optitrack", "vrpn", "pos", "cap")
ODOMETRY = ("odom", "odometry", "odo", "wheel", "wheels", "encoder", "imu", "cmd")
ANCHORS = ("anchor", "anchors", "node", "nodes", "beacon", "beacons", "ap")
LANDMARKS = ("landmark", "landmarks", "marker", "markers", "tag", "tags")
UNITS = {
    "mm": "mm",
    "cm": "cm",
    "m": "m",
    "millimeters": "mm",
    "millimetres": "mm",
    "deg": "deg",
    "degs": "deg",
    "degree": "deg",
    "degrees": "deg",
    "rad": "rad",
    "radians": "rad",
    "ms": "ms",
    "us": "us",
    "ns": "ns",
    "s": "s",
    "dbm": "dBm",
    "mps": "m/s",
    "kmh": "km/h",
}
RATES = {"mm": "mm/s", "cm": "cm/s", "m": "m/s", "deg": "deg/s", "rad": "rad/s"}


class Named(NamedTuple):
    """What a column's name says; "" where it says nothing."""

    quantity: str
    unit: str
    side: str  # "truth" or "odometry"


def words_of(name: str) -> list[str]:
    """The words of a name in small letters: camelCase, digits and signs divide it."""
    apart = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return [word.lower() for word in re.findall(r"[A-Za-z]+", apart)]


def named(column: str) -> Named:
    """What a column's name says of it."""
    inside = re.search(r"[\[(]([^\])]*)[\])]", column)
    outside = re.sub(r"[\[(][^\])]*[\])]", " ", column)
    words = words_of(outside)
    side = side_of(words)
    pair = next((pair for pair in pairwise(words) if pair in PAIRS), None)
    quantity = PAIRS[pair] if pair else next((q for q, known in WORDS.items() if any(w in known for w in words)), "")
    return Named(quantity, _unit(words_of(inside[1]) if inside else words[1:], quantity), side)


def side_of(words: list[str]) -> str:
    """Whether words speak of truth or of odometry."""
    if any(word in ODOMETRY for word in words):
        return "odometry"
    return "truth" if any(word in TRUTH for word in words) else ""


def _unit(words: list[str], quantity: str) -> str:
    """The unit that words name, made a rate where the quantity is one."""
    found = next((UNITS[word] for word in words if word in UNITS), "")
    if quantity in ("sec", "nsec"):
        return ""
    if quantity in ("speed", "turn_rate"):
        return RATES.get(found, found if found in ("km/h", "m/s") else "")
    fits = {"time": ("s", "ms", "us", "ns"), "rssi": ("dBm",), "heading": ("rad", "deg"), "bearing": ("rad", "deg")}
    return found if found in fits.get(quantity, ("m", "cm", "mm")) else ""

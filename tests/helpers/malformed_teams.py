"""The two robots in CSV files, with something wrong in what is written: which file, and how its bytes change."""

import re

ODOMETRY, TRUTH, RANGES = "odom_red.csv", "truth_red.csv", "uwb.csv"


def _line(number, new):
    return lambda raw: b"\n".join([*raw.split(b"\n")[:number], new, *raw.split(b"\n")[number + 1 :]])


def _first(count):
    return lambda raw: b"\n".join(raw.split(b"\n")[:count]) + b"\n"


def _column(index, new):
    """Every field of a column, but for its name."""
    return lambda raw: re.sub(rb"(?m)(?<=\n)((?:[^,\n]*,){%d})[^,\n]+" % index, rb"\g<1>" + new, raw)


# what is wrong -> file, and change. Each must give one line, or be read with what is left.
CHANGES = {
    "an empty file": (ODOMETRY, lambda raw: b""),
    "one line of odometry": (ODOMETRY, _first(2)),
    "one line of truth": (TRUTH, _first(2)),
    "one range": (RANGES, _first(2)),
    "no header": (ODOMETRY, lambda raw: raw.partition(b"\n")[2]),
    "two columns of one name": (ODOMETRY, _line(0, b"time,v,v")),
    "a header too short": (ODOMETRY, _line(0, b"time,v")),
    "a word for a number": (ODOMETRY, _line(5, b"1700000000.5,fast,0.1")),
    "1e300": (TRUTH, _line(5, b"1700000000.5,1e300,0.1,0.1")),
    "stamps all equal": (TRUTH, _column(0, b"1700000000.0")),
    "a step back by an hour": (ODOMETRY, _line(600, b"1699996400.0,0.3,0.1")),
    "an empty column of truth": (TRUTH, _column(1, b"")),
    "an empty column of stamps": (TRUTH, _column(0, b"")),
    "truth that stands": (TRUTH, lambda raw: _column(2, b"1")(_column(1, b"1")(raw))),
    "odometry of zeros": (ODOMETRY, lambda raw: _column(2, b"0")(_column(1, b"0")(raw))),
    "ranges of zero": (RANGES, _column(3, b"0")),
    "a robot that measures itself": (RANGES, _column(2, b"red")),
    "unknown robots": (RANGES, lambda raw: raw.replace(b"red", b"green").replace(b"blue", b"black")),
    "robots without names": (RANGES, _column(1, b"")),
    "names with control characters": (RANGES, _column(1, b"\x1b[31mred")),
    "a field with quotes that never end": (RANGES, _line(3, b'1700000001.0,"red,blue,1.0')),
    "semicolons": (ODOMETRY, lambda raw: raw.replace(b",", b";")),
    "commas as decimal points": (ODOMETRY, lambda raw: raw.replace(b",", b";").replace(b".", b",")),
    "line ends of Windows": (ODOMETRY, lambda raw: raw.replace(b"\n", b"\r\n")),
    "a byte order mark": (ODOMETRY, lambda raw: b"\xef\xbb\xbf" + raw),
    "bytes that are no text": (ODOMETRY, lambda raw: raw[:200] + b"\xff\xfe\x80" + raw[200:]),
    "half of a file": (TRUTH, lambda raw: raw[: len(raw) // 2]),
}
ABSENT = {
    "no odometry": ("odom_red.csv", "odom_blue.csv"),
    "no truth": ("truth_red.csv", "truth_blue.csv"),
    "no ranges": ("uwb.csv",),
    "one file": ("odom_red.csv", "odom_blue.csv", "truth_red.csv", "uwb.csv"),
}
MALFORMED = [*CHANGES, *ABSENT]


def spoil(folder, name):
    """Do what is wrong to the files in a directory."""
    for file in ABSENT.get(name, ()):
        (folder / file).unlink()
    if name in CHANGES:
        file, change = CHANGES[name]
        (folder / file).write_bytes(change((folder / file).read_bytes()))

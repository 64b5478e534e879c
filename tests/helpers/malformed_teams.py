"""The two robots in CSV files, with something wrong in what is written: a function of the directory for each."""


def _edited(name, change):
    def spoil(folder):
        path = folder / name
        path.write_text(change(path.read_text()))

    return spoil


def _bytes(name, change):
    def spoil(folder):
        path = folder / name
        path.write_bytes(change(path.read_bytes()))

    return spoil


def _line(number, new):
    def change(text):
        lines = text.split("\n")
        lines[number] = new
        return "\n".join(lines)

    return change


def _first(count):
    return lambda text: "\n".join(text.split("\n")[:count]) + "\n"


def _column(index, new):
    def change(text):
        head, *lines = text.strip().split("\n")
        rows = [line.split(",") for line in lines]
        return "\n".join([head, *(",".join([*row[:index], new, *row[index + 1 :]]) for row in rows)]) + "\n"

    return change


def _without(*names):
    def spoil(folder):
        for name in names:
            (folder / name).unlink()

    return spoil


ODOMETRY, TRUTH, RANGES = "odom_red.csv", "truth_red.csv", "uwb.csv"
# what is wrong -> how. Each must give one line, or be read with what is left.
MALFORMED = {
    "an empty file": _edited(ODOMETRY, lambda text: ""),
    "a header alone": _edited(ODOMETRY, _first(1)),
    "one line of odometry": _edited(ODOMETRY, _first(2)),
    "one line of truth": _edited(TRUTH, _first(2)),
    "one range": _edited(RANGES, _first(2)),
    "no header": _edited(ODOMETRY, lambda text: text.partition("\n")[2]),
    "two columns of one name": _edited(ODOMETRY, _line(0, "time,v,v")),
    "a header too short": _edited(ODOMETRY, _line(0, "time,v")),
    "a word for a number": _edited(ODOMETRY, _line(5, "1700000000.5,fast,0.1")),
    "nan": _edited(ODOMETRY, _line(5, "1700000000.5,nan,0.1")),
    "1e300": _edited(TRUTH, _line(5, "1700000000.5,1e300,0.1,0.1")),
    "a stamp of nan": _edited(TRUTH, _line(5, "nan,1.0,0.1,0.1")),
    "stamps all equal": _edited(TRUTH, _column(0, "1700000000.0")),
    "a step back by an hour": _edited(ODOMETRY, _line(600, "1699996400.0,0.3,0.1")),
    "an empty column of truth": _edited(TRUTH, _column(1, "")),
    "an empty column of stamps": _edited(TRUTH, _column(0, "")),
    "truth that stands": _edited(TRUTH, lambda text: _column(2, "1")(_column(1, "1")(text))),
    "odometry of zeros": _edited(ODOMETRY, lambda text: _column(2, "0")(_column(1, "0")(text))),
    "ranges of zero": _edited(RANGES, _column(3, "0")),
    "a robot that measures itself": _edited(RANGES, _column(2, "red")),
    "robots nobody knows": _edited(RANGES, lambda text: text.replace("red", "green").replace("blue", "black")),
    "robots without names": _edited(RANGES, _column(1, "")),
    "names with control characters": _edited(RANGES, _column(1, "\x1b[31mred")),
    "a field with quotes that never end": _edited(RANGES, _line(3, '1700000001.0,"red,blue,1.0')),
    "semicolons": _edited(ODOMETRY, lambda text: text.replace(",", ";")),
    "commas as decimal points": _edited(ODOMETRY, lambda text: text.replace(",", ";").replace(".", ",")),
    "line ends of Windows": _bytes(ODOMETRY, lambda raw: raw.replace(b"\n", b"\r\n")),
    "a byte order mark": _bytes(ODOMETRY, lambda raw: b"\xef\xbb\xbf" + raw),
    "bytes that are no text": _bytes(ODOMETRY, lambda raw: raw[:200] + b"\xff\xfe\x80" + raw[200:]),
    "a last line cut off": _bytes(ODOMETRY, lambda raw: raw[:-9]),
    "half of a file": _bytes(TRUTH, lambda raw: raw[: len(raw) // 2]),
    "no odometry": _without("odom_red.csv", "odom_blue.csv"),
    "no truth": _without("truth_red.csv", "truth_blue.csv"),
    "truth of one robot": _without("truth_red.csv"),
    "no ranges": _without("uwb.csv"),
    "one file": _without("odom_red.csv", "odom_blue.csv", "truth_red.csv", "uwb.csv"),
    "a file that is none": lambda folder: (folder / "notes.txt").write_text("We drove in the hall.\nIt was cold.\n"),
}

"""The files of an MRCLAM data set.

A measurement carries a barcode, which `Barcodes.dat` maps to a subject: a robot (1 to n) or a landmark.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.text_tables import Table, read_table, require_unique, require_whole, sort_by_time


class DataSet(NamedTuple):
    """The files of a data set, robots in order."""

    truth: list[Table]  # time, x, y, heading
    odometry: list[Table]  # time, v, omega
    readings: list[Table]  # time, barcode, range, bearing
    steps_back: dict[str, int]  # by file: how often its clock stepped back
    landmarks: Array  # (l, 2) [m] in the order of Landmark_Groundtruth.dat
    subjects: tuple[int, ...]  # (l,) the landmarks' numbers
    columns: Mapping[int, int]  # barcode -> robot 0..n-1, or n + landmark


def read_data_set(data: Path) -> DataSet:
    """Every file of the data set in a directory.

    Raises:
        BadInput: a file is missing or malformed; names file, line and remedy.

    """
    if not data.is_dir():
        raise BadInput(
            f"{data}: there is no such directory; name the one that holds Barcodes.dat and Robot1_Odometry.dat"
        )
    found = [re.fullmatch(r"Robot([1-9]\d*)_Odometry\.dat", path.name) for path in data.iterdir()]
    n = max((int(match[1]) for match in found if match), default=1)
    surveyed = read_table(data / "Landmark_Groundtruth.dat", ("subject", "x [m]", "y [m]", "x sd [m]", "y sd [m]"))
    columns = _columns(read_table(data / "Barcodes.dat", ("subject", "barcode")), surveyed, n)
    steps_back: dict[str, int] = {}

    def team(kind: str, *names: str) -> list[Table]:
        tables = [read_table(data / f"Robot{i + 1}_{kind}.dat", ("time [s]", *names)) for i in range(n)]
        ordered = [sort_by_time(table) for table in tables]
        steps_back.update({table.path.name: steps for table, steps in ordered if steps})
        return [table for table, _ in ordered]

    truth = team("Groundtruth", "x [m]", "y [m]", "heading [rad]")
    odometry = team("Odometry", "v [m/s]", "omega [rad/s]")
    readings = team("Measurement", "barcode", "range [m]", "bearing [rad]")
    for table in readings:
        require_whole(table, 1, "barcode")
    subjects = tuple(map(int, surveyed.values[:, 0]))
    return DataSet(truth, odometry, readings, steps_back, surveyed.values[:, 1:3], subjects, columns)


def unknown_barcodes(files: DataSet) -> dict[str, Any]:
    """Barcodes of no subject (misread, or of a landmark not surveyed): how many, and where the first is."""
    found: dict[str, Any] = {}
    for table in files.readings:
        for row, code in enumerate(map(int, table.values[:, 1])):
            if code not in files.columns:
                first = f"{table.path.name}, line {table.line[row]}"
                found.setdefault(str(code), {"count": 0, "first": first})["count"] += 1
    return found


def _columns(barcodes: Table, surveyed: Table, n: int) -> dict[int, int]:
    """Barcode -> robot 0..n-1, or n + landmark.

    Raises:
        BadInput: a number is there twice, a landmark has a robot's number, or a subject has no barcode.

    """
    for table, column, name in ((barcodes, 0, "subject"), (barcodes, 1, "barcode"), (surveyed, 0, "subject")):
        require_unique(table, column, name)
    code = {int(subject): int(barcode) for subject, barcode in barcodes.values}
    columns = {}
    for subject in range(1, n + 1):
        if subject not in code:
            raise BadInput(f"{barcodes.path}: robot {subject} has no barcode; add its line")
        columns[code[subject]] = subject - 1
    for row, subject in enumerate(map(int, surveyed.values[:, 0])):
        where = f"{surveyed.at(row)}: landmark {subject}"
        if subject <= n:
            raise BadInput(f"{where} has a robot's number; number landmarks above {n}")
        if subject not in code:
            raise BadInput(f"{where} has no barcode; add its line to {barcodes.path.name}")
        columns[code[subject]] = n + row
    return columns

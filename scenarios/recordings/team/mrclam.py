"""UTIAS MRCLAM data sets, and recordings in their text files, as recordings of a team of any number of robots.

The family `mrclam` reads the same files with its own models; here models are fitted, as on every recording of a team.
"""

from pathlib import Path

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.mrclam_files import DataSet, read_data_set
from cooploc.scenarios.recordings.team.channels import Measured, divided
from cooploc.scenarios.recordings.team.schema import TeamDescription
from cooploc.scenarios.recordings.team.series import in_order
from cooploc.scenarios.recordings.team.team_log import Places, Series, TeamLog
from cooploc.scenarios.recordings.text_tables import Table

BARCODES = "Barcodes.dat"


def runs(data: Path, description: TeamDescription) -> dict[str, Path]:
    """The data sets in a directory: itself, or each directory in it.

    Raises:
        BadInput: there are none.

    """
    if (data / BARCODES).exists():
        return {data.resolve().name: data}
    found = {path.name: path for path in sorted(data.iterdir()) if (path / BARCODES).exists()}
    if not found:
        raise BadInput(f"{data}: neither it nor a directory in it holds {BARCODES}; name a data set of MRCLAM")
    return found


def read(data: Path, place: Path, name: str, description: TeamDescription) -> TeamLog:
    """One data set: robots "1", "2" ..., landmarks by their numbers.

    Raises:
        BadInput: a file is missing or malformed; names file, line and remedy.

    """
    files = read_data_set(place)
    robots = tuple(str(i + 1) for i in range(len(files.odometry)))
    landmarks = tuple(str(subject) for subject in files.subjects)
    warnings: list[str] = []
    odometry = tuple(_series(table, warnings) for table in files.odometry)
    truth = tuple(_series(table, warnings) for table in files.truth)
    measured = [_measured(files, i, (*robots, *landmarks)) for i in range(len(robots))]
    readings, told = divided("sighting", measured, robots, landmarks)
    places, none = Places(landmarks, files.landmarks), Places((), np.empty((0, 2)))
    return TeamLog(name, robots, "velocity", odometry, truth, readings, places, none, (*warnings, *told))


def _series(table: Table, warnings: list[str]) -> Series:
    series, told = in_order(table.values[:, 0], table.values[:, 1:], str(table.path), table.at)
    warnings += told
    return series


def _measured(files: DataSet, robot: int, names: tuple[str, ...]) -> Measured:
    table = files.readings[robot]
    codes = [int(code) for code in table.values[:, 1]]
    other = [names[files.columns[code]] if code in files.columns else f"barcode {code}" for code in codes]
    return Measured(table.values[:, 0], [str(robot + 1)] * len(codes), other, table.values[:, 2:], str(table.path))

"""The text files of MRCLAM, of any number of robots."""

import os
from pathlib import Path

import numpy as np
import pytest

import cooploc as cl
from cooploc.scenarios.recordings import mrclam, schema
from cooploc.scenarios.recordings.mrclam import read_data_set

SET6 = Path(os.environ.get("COOPLOC_DATA", "../shared/data")) / "mrclam6"


def data_set(folder, robots):
    """Robots on lines beside each other; each sees the next one and the only landmark, number 21."""
    codes = {subject: 5 + 9 * subject for subject in (*range(1, robots + 1), 21)}
    (folder / "Barcodes.dat").write_text("".join(f"{s} {c}\n" for s, c in codes.items()))
    (folder / "Landmark_Groundtruth.dat").write_text("21 1.5 2.5 0.001 0.001\n")
    for i in range(1, robots + 1):
        files = {
            "Groundtruth": "".join(f"{t / 10:.1f} {t / 100:.2f} {i} 0.0\n" for t in range(30)),
            "Odometry": "".join(f"{t / 10:.1f} 0.1 0.0\n" for t in range(30)),
            "Measurement": f"0.5 {codes[i % robots + 1]} 1.0 1.5\n1.0 {codes[21]} 1.2 0.3\n1.5 99999 1 1\n",
        }
        for name, text in files.items():
            (folder / f"Robot{i}_{name}.dat").write_text(text)
    return folder


@pytest.mark.parametrize("robots", [1, 2, 7])
def test_a_data_set_of_any_number_of_robots_is_simulated(tmp_path, robots):
    truth, stream = cl.simulate("mrclam/all", data=data_set(tmp_path, robots))
    assert stream.robots == robots
    assert truth.x.shape[2] == robots
    assert np.isfinite(stream.senses.landmark[..., 0]).sum() == robots
    assert np.isfinite(stream.senses.sighting[..., 0]).sum() == (robots if robots > 1 else 0)


@pytest.mark.parametrize("robots", [1, 2, 7])
def test_a_data_set_of_any_number_of_robots_is_a_log_of_a_team(tmp_path, robots):
    (tmp_path / "log.toml").write_text('format = "mrclam"')
    data_set(tmp_path, robots)
    description = schema.load(tmp_path / "log.toml")
    log = mrclam.read(tmp_path, tmp_path, "made", description)
    assert log.robots == tuple(str(i + 1) for i in range(robots))
    assert log.landmarks.names == ("21",)
    assert [len(series.time) for series in (*log.odometry, *log.truth)] == [30] * (2 * robots)
    assert len(log.readings["landmark"].time) == robots
    assert sum("barcode 99999" in warning for warning in log.warnings) == robots
    if robots > 1:
        assert log.readings["sighting"].other.tolist() == [(i + 1) % robots for i in range(robots)]
    assert mrclam.runs(tmp_path.parent, description)[tmp_path.name] == tmp_path


@pytest.mark.skipif(not SET6.exists(), reason="needs ../shared/data/mrclam6")
def test_data_set_6_has_all_its_readings(tmp_path):
    (tmp_path / "log.toml").write_text('format = "mrclam"')
    log = mrclam.read(SET6, SET6, "6", schema.load(tmp_path / "log.toml"))
    files = read_data_set(SET6)
    known = sum(int(code) in files.columns for table in files.readings for code in table.values[:, 1])
    itself = sum(
        files.columns.get(int(code)) == i for i, table in enumerate(files.readings) for code in table.values[:, 1]
    )
    assert sum(len(readings.time) for readings in log.readings.values()) == known - itself
    assert len(log.robots) == 5
    assert len(log.landmarks.names) == 15

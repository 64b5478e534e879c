"""Recordings that came to harm: read, or one line that names the file."""

import shutil

import pytest
from attempts import attempted, cases
from damage import HARM, harm_file
from hypothesis import given
from hypothesis import strategies as st
from made_logs import describe, lines, write
from made_team import describe as describe_team
from made_team import write as write_team

import cooploc as cl

MRCLAM = {
    "Barcodes": "# Subject #    Barcode #\n  1 \t 5 \n  2 \t 14 \n 6 \t 72\n",
    "Landmark_Groundtruth": "# Subject #    x [m]    y [m]\n  6 \t 0.5 \t 0.5 \t 0.0 \t 0.0\n",
    "Groundtruth": "".join(f"{t / 10:.3f}\t{t / 100:.3f}\t0.2\t0.1\n" for t in range(20)),
    "Odometry": "".join(f"{t / 10:.3f}\t0.1\t0.01\n" for t in range(20)),
    "Measurement": "0.5\t72\t0.4\t0.1\n0.9\t14\t0.7\t0.3\n1.3\t5\t0.7\t-0.3\n",
}
WORDS = st.sampled_from(
    ["nan", "inf", "1e308", "-1e308", "1e-308", "0", "-1", "", "x", "1e9", "99999999999999999999", '"', "٣"]
)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A data set of MRCLAM and a log, as they should be."""
    folder = tmp_path_factory.mktemp("recordings")
    for name in ("mrclam", "log"):
        (folder / name).mkdir()
    for name, text in MRCLAM.items():
        of_robots = name in ("Groundtruth", "Odometry", "Measurement")
        for file in [f"Robot{k}_{name}" for k in (1, 2)] if of_robots else [name]:
            (folder / "mrclam" / f"{file}.dat").write_text(text)
    describe(folder / "log")
    for i, name in enumerate("ab"):
        write(folder / "log", name, lines(i, ticks=12))
    write_team(folder / "team", seconds=6.0, hertz=10.0)
    describe_team(folder / "team", ("seconds = 60.0", "seconds = 4.0"))
    return folder


def simulated(kind, data):
    return cl.simulate({"mrclam": "mrclam/all", "log": "log/all", "team": "log/all"}[kind], data=data)


@pytest.fixture(scope="module")
def copied(sound, tmp_path_factory):
    def copy(kind):
        place = tmp_path_factory.getbasetemp() / "recorded"
        shutil.rmtree(place, ignore_errors=True)
        return shutil.copytree(sound / kind, place)

    return copy


@pytest.mark.parametrize("kind", ["mrclam", "log", "team"])
def test_a_sound_recording_is_read(sound, kind):
    assert simulated(kind, sound / kind)[1].robots >= 1


@cases(200)
@given(st.sampled_from(["mrclam", "log", "team"]), st.floats(0, 1, exclude_max=True), HARM)
def test_a_harmed_recording_is_read_or_one_line(copied, kind, which, harm):
    folder = copied(kind)
    files = sorted(folder.iterdir())
    file = files[int(which * len(files))]
    harm_file(file, harm)
    attempted(simulated, kind, folder)


@cases(200)
@given(st.sampled_from(["mrclam", "log", "team"]), *[st.floats(0, 1, exclude_max=True)] * 3, WORDS)
def test_a_field_that_says_anything_is_read_or_one_line(copied, kind, which, line, field, word):
    folder = copied(kind)
    files = sorted(folder.iterdir())
    file = files[int(which * len(files))]
    mark = "," if file.suffix == ".csv" else "=" if file.suffix == ".toml" else "\t"
    rows = file.read_text().split("\n")
    fields = rows[int(line * len(rows))].split(mark)
    fields[int(field * len(fields))] = word
    rows[int(line * len(rows))] = mark.join(fields)
    file.write_text("\n".join(rows))
    attempted(simulated, kind, folder)

"""Recordings that came to harm: read, perhaps with a warning, or one line; never a hang, or much memory."""

import resource
import shutil

import pytest
from attempts import attempted, cases
from damage import HARM, harm_file, harmed
from hypothesis import given
from hypothesis import strategies as st
from made_bags import KINDS, made_bag
from made_logs import describe, lines, write
from made_team import describe as describe_team
from made_team import write as write_team

import cooploc as cl
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings import bags, pyfg, schema
from cooploc.scenarios.recordings.team_log import TeamLog

MRCLAM = {
    "Barcodes": "# Subject #    Barcode #\n  1 \t 5 \n  2 \t 14 \n 6 \t 72\n",
    "Landmark_Groundtruth": "# Subject #    x [m]    y [m]\n  6 \t 0.5 \t 0.5 \t 0.0 \t 0.0\n",
    "Groundtruth": "".join(f"{t / 10:.3f}\t{t / 100:.3f}\t0.2\t0.1\n" for t in range(20)),
    "Odometry": "".join(f"{t / 10:.3f}\t0.1\t0.01\n" for t in range(20)),
    "Measurement": "0.5\t72\t0.4\t0.1\n0.9\t14\t0.7\t0.3\n1.3\t5\t0.7\t-0.3\n",
}
COV3, COV6 = "0.1 0 0.1", "0.1 0 0 0.1 0 0.1"
PYFG = "\n".join(
    [f"VERTEX_SE2 {t}.5 {r}{t} {t} {i} 0.1" for i, r in enumerate("AB") for t in range(6)]
    + ["VERTEX_XY L0 3 4", f"VERTEX_SE2:PRIOR 0.5 A0 0 0 0 {COV6}"]
    + [f"EDGE_SE2 {t}.5 {r}{t} {r}{t + 1} 1 0 0 {COV6}" for r in "AB" for t in range(5)]
    + [f"EDGE_RANGE {t}.5 A{t} B{t} 1.2 0.01" for t in range(6)]
    + [f"EDGE_RANGE 2.5 B2 L0 2.2 0.01\nEDGE_SE2_XY 2.5 A2 L0 1 4 {COV3}\n"]
)
BAGS = """
format = "bag"
robots = ["red", "blue"]
odometry = { kind = "velocity", topic = "/{robot}/odom" }
truth.topic = "/mocap/{robot}"
ranges.topic = "/uwb/{robot}/{other}"
sightings.topics = { red = "/red/seen" }
"""
MEMORY = 200  # [MB] that reading a small file may add
TEXTS = ["mrclam", "log", "team", "pyfg"]
NUMBERS = ["nan", "inf", "1e308", "-1e308", "1e-308", "0", "-1", "1e9", "99999999999999999999"]
WORDS = st.sampled_from([*NUMBERS, "", "x", '"', "٣", "B9", "A99999999999", "EDGE_RANGE", "VERTEX_XYZ", "#", "\0"])
PLACE = st.floats(0, 1, exclude_max=True)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A data set of MRCLAM, a robot's log, a team's, and a factor graph, as they should be."""
    folder = tmp_path_factory.mktemp("recordings")
    for name in ("mrclam", "log", "pyfg"):
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
    (folder / "pyfg" / "graph.pyfg").write_text(PYFG)
    return folder


def checked(read, *arguments):
    """A log whose arrays agree, or a BadInput in one line."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    log = attempted(read, *arguments)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MEMORY * 1024
    if isinstance(log, BadInput):
        assert "\n" not in str(log)
    if isinstance(log, TeamLog):
        for series in (*log.odometry, *filter(None, log.truth)):
            assert len(series.time) == len(series.values)
            assert (series.time[1:] > series.time[:-1]).all()
        for readings in log.readings.values():
            assert len(readings.time) == len(readings.robot) == len(readings.other) == len(readings.values)
            assert (readings.time[1:] >= readings.time[:-1]).all()
    return log


def read(kind, folder):
    if kind == "pyfg":
        return checked(pyfg.read_run, folder / "graph.pyfg", "graph", None)
    if kind == "team":
        checked(lambda: cl.inspect(folder, again=True))
    return checked(lambda: cl.simulate("mrclam/all" if kind == "mrclam" else "log/all", data=folder))


@pytest.fixture(scope="module")
def copied(sound, tmp_path_factory):
    def copy(kind, which):
        place = tmp_path_factory.getbasetemp() / "recorded"
        shutil.rmtree(place, ignore_errors=True)
        files = sorted(shutil.copytree(sound / kind, place).iterdir())
        return files[int(which * len(files))]

    return copy


@pytest.mark.slow
@pytest.mark.parametrize("kind", TEXTS)
def test_a_sound_recording_is_read(sound, kind):
    assert not isinstance(read(kind, sound / kind), BadInput)


@cases(80)
@given(st.sampled_from(TEXTS), PLACE, HARM)
def test_a_harmed_recording_is_read_or_one_line(copied, kind, which, harm):
    file = copied(kind, which)
    harm_file(file, harm)
    read(kind, file.parent)


@cases(80)
@given(st.sampled_from(TEXTS), *[PLACE] * 3, WORDS)
def test_a_field_that_says_anything_is_read_or_one_line(copied, kind, which, line, field, word):
    file = copied(kind, which)
    mark = {".csv": ",", ".toml": "=", ".pyfg": " "}.get(file.suffix, "\t")
    rows = file.read_text().split("\n")
    fields = rows[int(line * len(rows))].split(mark)
    fields[int(field * len(fields))] = word
    rows[int(line * len(rows))] = mark.join(fields)
    file.write_text("\n".join(rows), encoding="utf-8")
    read(kind, file.parent)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "part"), [*((kind, "messages") for kind in KINDS), ("sqlite3", "metadata")])
def test_a_harmed_bag_is_read_or_one_line(tmp_path, kind, part):
    path, _ = made_bag(tmp_path, kind, seconds=0.5)
    (tmp_path / "log.toml").write_text(BAGS)
    description = schema.load(tmp_path / "log.toml")
    whole = checked(bags.read_run, path, "sound", description)
    assert whole.warnings == ()
    files = [path] if path.is_file() else sorted(path.iterdir(), key=lambda p: p.suffix == ".yaml")
    file = files[0 if part == "messages" else -1]
    content = file.read_bytes()

    @cases(20)
    @given(HARM)
    def harm_it(harm):
        file.write_bytes(harmed(content, harm))
        found = checked(bags.read_run, path, "team", description)
        cut = part == "messages" and harm[0] in ("cut", "garbage", "empty", "remove", "folder")
        assert not cut or isinstance(found, BadInput) or found.warnings or str(found.odometry) == str(whole.odometry)

    harm_it()

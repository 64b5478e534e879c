"""Study files: what they sweep, include and refuse."""

import hashlib
import os
import platform
from pathlib import Path

import pytest

import cooploc as cl
from cooploc import scenarios
from cooploc.estimators.label_syntax import expand
from cooploc.scenarios.studies import study


def test_a_run_on_recordings_has_a_directory_named_after_them():
    log = study.load("log").replace_options(seed=7)
    assert log.folder_name() == "log-seed7"
    assert log.folder_name(Path("lab/../two robots/")) == "log-two-robots-seed7"


@pytest.mark.parametrize("name", study.names())
def test_shipped_studies_name_only_what_there_is(name):
    shipped = study.load(name)
    assert shipped.about
    cells = shipped.cells()
    for label in {estimator for cell in cells for estimator in cell.estimators}:
        cl.make(label)
    for cell in cells:
        assert cell.baseline in cell.estimators
        if not cell.scenario.startswith(("mrclam", "log", "wifi")):  # recordings, which need their files
            assert scenarios.resolve(cell.scenario).trials(shipped.trials) == shipped.trials


@pytest.mark.parametrize(
    ("label", "stands_for"),
    [
        ("nlos", ["nlos"]),
        ("packet-drop/drop={0,0.98}", ["packet-drop/drop=0", "packet-drop/drop=0.98"]),
        ("scalability/n={1..5..2}", ["scalability/n=1", "scalability/n=3", "scalability/n=5"]),
        ("a/n={2..3}[sd={0..0.2..0.1}]", [f"a/n={n}[sd={sd}]" for n in (2, 3) for sd in ("0", "0.1", "0.2")]),
        ("ekf-{local,joint}[x=1]", ["ekf-local[x=1]", "ekf-joint[x=1]"]),
        ("arl[plain,point=max]", ["arl[M=1,K=1,point=max]"]),
        ("arl [plain]", ["arl[M=1,K=1]"]),  # as tables show it
        ("arl[{plain,anchor_reading=rssi}]", ["arl[M=1,K=1]", "arl[anchor_reading=rssi]"]),
    ],
)
def test_a_label_stands_for_what_it_sweeps(label, stands_for):
    assert expand(label, {"plain": "M=1,K=1"}) == stands_for


@pytest.mark.parametrize(
    ("label", "words"),
    [
        ("a/n={1..", "write a sweep like"),
        ("a/n={1,{2,3}}", "write a sweep like"),
        ("a/n=1}", "write a sweep like"),
        ("a/n={1..x}", "write first..last"),
        ("a/n={1..2..3..4}", "write first..last"),
        ("a/n={5..1}", "it must rise"),
        ("a/n={1..5..0}", "it must rise"),
        ("arl[plan]", "did you mean 'plain'?"),
    ],
)
def test_a_sweep_that_cannot_be_read_says_so(label, words):
    with pytest.raises(cl.BadInput) as refusal:
        expand(label, {"plain": "M=1,K=1"})
    assert words in str(refusal.value)
    assert label in str(refusal.value)


def test_a_file_that_an_editor_began_with_a_byte_order_mark_is_read(tmp_path):
    (tmp_path / "mine.toml").write_text(GOOD, encoding="utf-8-sig")
    assert study.load(str(tmp_path / "mine.toml")).baseline == "arl"


GOOD = 'baseline = "arl"\nscenarios = ["trajectory"]\nestimators = ["arl"]\n'
ALSO = GOOD + '[[also]]\nscenarios = ["nlos"]\nestimators = ["arl", "rssi-pf"]\n'


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (GOOD + "trails = 3\n", "there is no key 'trails' in a study; did you mean 'trials'?"),
        (ALSO + "estimator = 3\n", "there is no key 'estimator' in a block of [[also]]; did you mean 'estimators'?"),
        (GOOD + "trials = 0\n", "trials: it must be at least 1"),
        (GOOD + f'title = "{"x" * 140}"\n', "title: String should have at most 130 characters"),
        (GOOD.replace('["trajectory"]', '"trajectory"'), "scenarios: it must be a list, not 'trajectory'"),
        (GOOD + "trials = [\n", "is not a TOML file"),
        (GOOD.replace('["arl"]', "[]"), "it has scenarios and no estimators"),
        (GOOD.replace('baseline = "arl"', 'baseline = "ctrn"'), "compares with 'ctrn', which is not one of its est"),
        (GOOD.replace("trajectory", "nlos/n={1.."), "write a sweep like"),
        ('include = ["quik"]\n', "there is no study 'quik'; did you mean 'quick'?"),
        ('include = ["mine.toml"]\n', "includes itself"),
        ("", "has no scenarios"),
    ],
)
def test_a_study_file_that_is_wrong_says_where(tmp_path, monkeypatch, content, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(content)
    with pytest.raises(cl.BadInput) as refusal:
        study.load("mine.toml")
    assert words in str(refusal.value)
    assert "mine.toml" in str(refusal.value) or "quik" in str(refusal.value)


def test_a_plug_in_beside_the_study_is_named_as_from_this_directory(tmp_path, monkeypatch):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "mine.py").write_text("class Mine: pass")
    (tmp_path / "sub" / "s.toml").write_text('scenarios = ["trajectory"]\nestimators = ["arl", "mine.py:Mine"]')
    monkeypatch.chdir(tmp_path)
    with pytest.raises(cl.BadInput, match=r"no file mine.py in this directory: write sub/mine.py, or run it in sub\Z"):
        study.load("sub/s.toml")
    monkeypatch.chdir(tmp_path / "sub")
    assert study.load("s.toml").estimators == ("arl", "mine.py:Mine")


def test_blocks_add_up_and_included_studies_keep_their_name_and_baseline(tmp_path):
    (tmp_path / "inner.toml").write_text(ALSO.replace('"nlos"', '"nlos", "trajectory"'))
    (tmp_path / "outer.toml").write_text(f'about = "x"\ninclude = ["{tmp_path}/inner.toml", "anchors"]\n')
    cells = {cell.scenario: cell for cell in study.load(str(tmp_path / "outer.toml")).cells()}
    assert cells["trajectory"] == ("inner", "trajectory", ("arl", "rssi-pf"), "arl")
    assert (cells["anchors/a=3"].experiment, cells["anchors/a=3"].baseline) == ("anchors", "rssi-pf")


def test_options_choose_among_the_estimators_and_add_others_everywhere(tmp_path):
    (tmp_path / "mine.toml").write_text(ALSO)
    chosen = study.load(str(tmp_path / "mine.toml")).replace_options(only=["rssi-pf", "ekf-{local,joint}"]).cells()
    assert [cell.estimators for cell in chosen] == [("ekf-local", "ekf-joint"), ("rssi-pf", "ekf-local", "ekf-joint")]
    assert [cell.baseline for cell in chosen] == ["ekf-local", "rssi-pf"]


def test_a_name_alone_is_the_configuration_that_fits_recordings():
    (cell,) = study.load("log").replace_options(only=["ekf-ci", "ekf-local[reading=rssi]", "ekf-hmd"]).cells()
    fitting = "ekf-ci[anchor_reading=any,reading=any]"
    assert cell.estimators == (fitting, "ekf-local[reading=rssi]", "ekf-hmd")  # of the last the study has none


DATA = Path(os.environ.get("COOPLOC_DATA", Path(__file__).parents[4] / "shared" / "data"))
FOLDERS = {"mrclam6@1": "mrclam6", "wifi@1": "wifi-rssi"}


@pytest.mark.slow
@pytest.mark.skipif(
    platform.machine() not in ("x86_64", "AMD64"), reason="hashes are stated for processors of the kind x86-64"
)
@pytest.mark.parametrize("name", study.problem_tables())
def test_a_problem_keeps_its_streams_for_ever(name):
    folder = DATA / FOLDERS[name] if name in FOLDERS else None
    if folder and not folder.is_dir():
        pytest.skip(f"{folder.name} is not here; set COOPLOC_DATA to where it lies")
    frozen = study.load(name)
    for scenario, stated in frozen.streams.items():
        trials = scenarios.resolve(scenario, folder).trials(frozen.trials)
        each = [cl.simulate(scenario, trials=[k], seed=frozen.seed, data=folder)[1] for k in range(trials)]
        assert hashlib.sha256("".join(one.hashes[0] for one in each).encode()).hexdigest()[:16] in stated
        assert f"{len(each[0].time)} ticks" in frozen.about or name == "wifi@1"  # whose runs are of unequal length


def test_a_run_of_a_problem_names_it_and_says_where_its_streams_are_others(tmp_path):
    frozen = study.load("arena-3@1")
    stream = cl.simulate("robots-1-3/n=3", trials=20, seed=1)[1]
    hashes = {"robots-1-3/n=3": {str(k): one for k, one in enumerate(stream.hashes)}}
    assert study.stream_sentence(frozen, hashes).startswith("problem: arena-3@1")
    hashes["robots-1-3/n=3"]["7"] = hashes["robots-1-3/n=3"]["6"]
    assert study.stream_sentence(frozen, hashes).startswith(
        "not the problem arena-3@1: other streams in robots-1-3/n=3"
    )
    assert study.stream_sentence(study.load("quick"), hashes) == ""
    for given in ({"trials": 19}, {"seed": 2}):
        with pytest.raises(cl.BadInput, match="arena-3@1 fixes"):
            cl.run_study("arena-3@1", out=tmp_path, **given)


@pytest.mark.slow
def test_a_scenarios_label_is_a_study_of_the_estimators_that_are_named(tmp_path):
    label, estimators = "trajectory[ticks=4,eta={2,3}]", ["dead-reckoning", "ekf-{local,ci}"]
    results = cl.run_study(label, estimators=estimators, trials=2, out=tmp_path / "run")
    labels = ["trajectory[ticks=4,eta=2]", "trajectory[ticks=4,eta=3]"]
    assert list(results.table["scenario"].unique()) == labels
    assert set(results.table["estimator"]) == {"dead-reckoning", "ekf-local", "ekf-ci"}
    assert set(results.table["baseline"]) == {"dead-reckoning"}
    assert study.study_of_scenario(label, ("arl",)).folder_name() == "trajectory-ticks=4-eta=2-3-seed1"
    assert [study.is_scenario(one) for one in ("w.py:W/n=2", "camera/n=2", "camera[ticks={1,2}]")] == [True] * 3
    assert [study.is_scenario(one) for one in ("quick", "nlos", "arena-3@1", "my.toml", "my")] == [False] * 5

"""A stranger's estimator: in one file, in a package written by `cooploc new-estimator`, and refused with the reason."""

import re
import shutil
import subprocess
import sys

import pytest
from processes import HANGS, environment, finish

import cooploc as cl
from cooploc.scenarios.conformance import CHECKS

FILE = """
from dataclasses import dataclass
from cooploc.estimators.dead_reckoning import DeadReckoning

@dataclass(frozen=True)
class Mine(DeadReckoning):
    scale: float = 1.0

class Plain(DeadReckoning):
    pass

@dataclass(frozen=True)
class Needs:
    size: int

mine = Mine(scale=3.0)
"""
STUDY = """
trials = 2
scenarios = ["robots-1-3/n=2[ticks=5]"]
estimators = ["dead-reckoning"]
"""


@pytest.fixture
def place(tmp_path):
    (tmp_path / "mine.py").write_text(FILE)
    (tmp_path / "small.toml").write_text(STUDY)
    return tmp_path


def test_an_estimator_in_a_file_is_made_by_its_path(place):
    file = place / "mine.py"
    assert cl.make(f"{file}:Mine[scale=2]").scale == 2.0
    assert cl.make(f"{file}:mine").scale == 3.0
    assert type(cl.make(f"{file}:Mine")) is type(cl.make(f"{file}:mine"))


@pytest.mark.parametrize(
    ("label", "words"),
    [
        ("mine.py:mine[scale=2]", "takes no parameters: name its class"),
        ("mine.py:Mine[scales=2]", "no parameter 'scales'; did you mean 'scale'"),
        ("mine.py:Wrong", "mine.py has no 'Wrong'; known are Mine, Plain, Needs, mine$"),
        ("mine.py:Needs", "cannot be made without arguments .*size.*; give its parameters defaults"),
        ("mine.py", "mine.py is a file: say which of its names"),
        ("nowhere.py:Mine", "no file nowhere.py; write path.py:Name"),
        ("missing.py:Mine", "cannot be imported: ModuleNotFoundError: No module"),
        ("broken.py:Mine", "cannot be imported: SyntaxError"),
        ("leaves.py:Mine", "cannot be imported: SystemExit: 3"),
    ],
)
def test_a_file_that_cannot_be_used_says_why_in_one_line(place, monkeypatch, label, words):
    monkeypatch.chdir(place)
    texts = {"missing": "import nothing_of_that_name", "broken": "def f(:", "leaves": "raise SystemExit(3)"}
    for name, text in texts.items():
        (place / f"{name}.py").write_text(text)
    with pytest.raises(cl.BadInput, match=words) as caught:
        cl.make(label)
    assert "\n" not in str(caught.value)


def test_an_edited_file_is_loaded_anew(place):
    file = place / "mine.py"
    before = cl.make(f"{file}:Mine")
    file.write_text(FILE.replace("1.0", "5.0"))
    assert (before.scale, cl.make(f"{file}:Mine").scale) == (1.0, 5.0)


@pytest.mark.slow
def test_a_file_runs_in_a_study_and_in_its_workers(place, tmp_path_factory):
    arguments = ("run", "small.toml", "--json", "--jobs", 2, "--estimators", "dead-reckoning,mine.py:Mine[scale=2]")
    told = finish(*arguments, plugins=tmp_path_factory.mktemp("none"), cwd=place)
    assert told.returncode == 0, told.stderr
    assert "mine.py:Mine[scale=2]" in told.stdout


@pytest.mark.slow
def test_an_edited_file_is_not_mixed_into_a_run(place, tmp_path_factory):
    arguments = ("run", "small.toml", "--out", "run", "--estimators", "dead-reckoning,mine.py:Mine")
    options = {"plugins": tmp_path_factory.mktemp("none"), "cwd": place}
    assert finish(*arguments, **options).returncode == 0
    assert finish(*arguments, **options).returncode == 0
    (place / "mine.py").write_text(FILE + "\n")
    told = finish(*arguments, **options)
    assert told.returncode == 2
    assert "run holds results of another version of mine.py; name another with --out" in told.stderr


@pytest.mark.slow
def test_a_written_package_is_installed_listed_and_tested(tmp_path):
    """By pip, into a folder of its own: its entry point is found, and its own test passes from there."""
    cl.new_estimator("my-filter", tmp_path / "my-filter")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps"]
    if subprocess.run([*pip[:3], "--version"], capture_output=True).returncode:
        pytest.skip("there is no pip here")
    home = tmp_path / "installed"
    done = subprocess.run(
        [*pip, "--no-build-isolation", "--no-index", "--target", home, tmp_path / "my-filter"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    told = finish("list", "estimators", plugins=home, cwd=tmp_path)
    assert re.search(r"^ *my-filter  +A Kalman ", told.stdout, re.MULTILINE), told.stdout
    assert finish("check", "my-filter", plugins=home, cwd=tmp_path).returncode == 0
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", "/dev/null", "--rootdir", tmp_path]
    test = tmp_path / "test_elsewhere.py"
    shutil.copy(tmp_path / "my-filter" / "test_my_filter_estimator.py", test)
    told = subprocess.run([*command, test], cwd=tmp_path, env=environment(home), capture_output=True, text=True)
    assert f"{len(CHECKS)} passed" in told.stdout, told.stdout


WORLD = """
from cooploc.scenarios import Family
from cooploc.scenarios.worlds.radio import Paper

class Windy(Paper):
    wind: float = 0.0

WINDY = Family("a windy arena", Windy, {"robots": 2, "ticks": 5}, {"wind": "wind"})
"""


def test_a_scenario_in_a_file_is_a_scenario_like_any_other(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "worlds").mkdir()
    (tmp_path / "worlds" / "windy.py").write_text(WORLD)
    truth, stream = cl.simulate("worlds/windy.py:WINDY/wind=2[ticks=4]", trials=2)
    assert truth.x.shape[:3] == (2, 4, 2)
    assert stream.scenario == "worlds/windy.py:WINDY/wind=2[ticks=4]"
    assert cl.simulate(f"{tmp_path}/worlds/windy.py:WINDY")[1].robots == 2
    for label, said in (
        ("worlds/windy.py:Windy", "is not a cooploc Family"),
        ("worlds/windy.py:WINDY/rain=1", "has no 'rain=1'; known are wind="),
    ):
        with pytest.raises(cl.BadInput, match=said):
            cl.simulate(label)


NOTEBOOK = """
from dataclasses import dataclass
import numpy as np
import cooploc as cl
from cooploc.estimators.dead_reckoning import DeadReckoning

@dataclass(frozen=True)
class Mine(DeadReckoning):
    bias: float = 0.5

    def estimate(self, s):
        x, P = super().estimate(s)
        return cl.Belief(x + self.bias, P)

if __name__ == "__main__":
    _, stream = cl.simulate("trajectory", trials=4, ticks=5)
    one, two = (cl.run(Mine(bias=2.0), stream, jobs=jobs).traces["Mine"] for jobs in (1, 2))
    dead = cl.run(cl.make("dead-reckoning"), stream).traces["DeadReckoning"]
    assert np.array_equal(one.x, two.x)
    assert np.allclose(two.x, dead.x + 2.0)
    print("the same")
"""


@pytest.mark.slow
def test_an_instance_of_a_class_of_main_runs_in_two_processes(tmp_path):
    """As in a notebook, whose classes are in `__main__` and in no file: they travel by value."""
    told = subprocess.run([sys.executable, "-c", NOTEBOOK], cwd=tmp_path, capture_output=True, text=True, timeout=HANGS)
    assert told.stdout == "the same\n", told.stderr


@pytest.mark.parametrize(
    ("name", "said"), [("My Filter", "small letters"), ("arl", "built-in"), ("there", "exists: choose another")]
)
def test_names_that_cannot_be_are_refused(tmp_path, name, said):
    (tmp_path / "there").mkdir()
    with pytest.raises(cl.BadInput, match=said):
        cl.new_estimator(name, tmp_path / name)

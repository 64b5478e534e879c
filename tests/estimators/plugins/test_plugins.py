"""A stranger's estimator: in one file, in a package written by `cooploc new-estimator`, and refused with the reason."""

import re
import shutil
import subprocess
import sys

import pytest
from processes import environment, finish
from pydantic import BaseModel

import cooploc as cl
from cooploc.analysis.execution.run import prepare
from cooploc.scenarios import BUILTIN, Family
from cooploc.scenarios.studies.study import Study

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

    def init(self):
        pass

class Half:
    def predict(self, z):
        pass

def make_one(prior, world, robot, key):
    pass

mine = Mine(scale=3.0)
"""


@pytest.fixture
def place(tmp_path):
    (tmp_path / "mine.py").write_text(FILE)
    return tmp_path


def test_an_estimator_in_a_file_is_made_by_its_path_and_again_when_the_file_was_edited(place):
    file = place / "mine.py"
    made = cl.make(f"{file}:Mine[scale=2]")
    assert (made.scale, cl.make(f"{file}:mine").scale) == (2.0, 3.0)
    assert type(made) is type(cl.make(f"{file}:mine"))
    file.write_text(FILE.replace("1.0", "5.0"))
    assert (made.scale, cl.make(f"{file}:Mine").scale) == (2.0, 5.0)


@pytest.mark.parametrize(
    ("label", "words"),
    [
        ("mine.py:Wrong", "mine.py has no 'Wrong'; known are Mine, Plain, Needs, Half, make_one, mine$"),
        ("mine.py:Needs", "cannot be made without arguments .*size.*; give its parameters defaults"),
        (
            "mine.py:make_one",
            r"is a function that makes filters: name what cl.PerRobot\(make_one, uses=\(...\)\) makes$",
        ),
        ("mine.py:Half", r"has no correct: a filter of one robot has predict\(z\) and correct\(z\)"),
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


@pytest.mark.slow
def test_a_written_package_is_installed_listed_and_tested(tmp_path):
    """By pip, into a folder of its own: its entry point is found, and its own test passes from there."""
    cl.new_estimator("my-filter", tmp_path / "my-filter")
    pip = [sys.executable, "-m", "pip"]
    if subprocess.run([*pip, "--version"], capture_output=True).returncode:
        pytest.skip("there is no pip here")
    home, test = tmp_path / "installed", tmp_path / "test_elsewhere.py"
    offline = ("--no-deps", "--no-build-isolation", "--no-index", "--quiet")
    subprocess.run([*pip, "install", *offline, "--target", home, tmp_path / "my-filter"], check=True)
    told = finish("list", "estimators", plugins=home, cwd=tmp_path)
    assert re.search(r"^ *my-filter  +A Kalman ", told.stdout, re.MULTILINE), told.stdout
    shutil.copy(tmp_path / "my-filter" / "test_my_filter_estimator.py", test)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", "/dev/null", "--rootdir", tmp_path]
    told = subprocess.run([*command, test], cwd=tmp_path, env=environment(home), capture_output=True, text=True)
    assert "1 passed" in told.stdout, told.stdout


@pytest.mark.parametrize(
    ("name", "said"), [("My Filter", "small letters"), ("arl", "built-in"), ("there", "exists: choose another")]
)
def test_names_that_cannot_be_are_refused(tmp_path, name, said):
    (tmp_path / "there").mkdir()
    with pytest.raises(cl.BadInput, match=said):
        cl.new_estimator(name, tmp_path / name)


WORLD = """
from cooploc.scenarios import Family
from cooploc.scenarios.worlds.radio import Paper

class Windy(Paper):
    wind: float = 0.0

WINDY = Family("a windy arena", Windy, {"robots": 2, "ticks": 5}, {"wind": "wind"})
"""


def test_a_scenario_in_a_file_is_a_scenario_like_any_other(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "windy.py").write_text(WORLD)
    truth, stream = cl.simulate("windy.py:WINDY/wind=2[ticks=4]", trials=2)
    assert truth.x.shape[:3] == (2, 4, 2)
    assert stream.scenario == "windy.py:WINDY/wind=2[ticks=4]"
    prepared = prepare(Study(name="s", scenarios=("windy.py:WINDY",), estimators=("dead-reckoning",)))
    assert [cell.scenario.label for cell in prepared.cells] == ["windy.py:WINDY"]
    for label, said in (
        ("Windy", "is the class Windy and no Family: name what"),
        ("WINDY/rain=1", "has no 'rain=1'; known are wind="),
    ):
        with pytest.raises(cl.BadInput, match=said):
            cl.simulate(f"windy.py:{label}")


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (
            "return super().simulate(label, trials, seed, world)[::-1]",
            "returned Stream, Truth; it must be truth, stream",
        ),
        ("pass", "returned NoneType; it must be truth, stream"),
        ("return self.gusts", r"cannot be simulated: AttributeError: .* no attribute 'gusts' \(windy.py:7\)$"),
        (
            "return super().simulate(label, trials, next(NUMBERS), world)",
            "gives other readings for the same seed and trial, alone and beside another: draw",
        ),
        (
            "pair = super().simulate(label, trials, seed, world); "
            "noise = __import__('numpy').random.default_rng(seed).normal(size=pair[1].senses.odometry.shape); "
            "return pair[0], pair[1].replace_arrays({'senses.odometry': noise})",
            "alone and beside another: draw every random number from cooploc.scenarios.seeds.generator",
        ),
        (
            "pair = super().simulate(label, trials, seed, world); pair[0].x[:] = float('nan'); return pair",
            "true positions are not finite in ticks that are said to be valid",
        ),
        (
            "truth, stream = super().simulate(label, trials, seed, world); "
            "return truth, stream.replace_arrays({'senses.odometry': stream.senses.odometry[..., :1]})",
            r"stream of 'windy.py:WINDY', .*: senses.odometry has shape \(2, 1, 2, 1\); it must be \(2, 1, 2, 2\), or",
        ),
        (
            "return super().simulate(label, [0], seed, world)",
            r"its truth is of trials \[0\], and simulate\(\) was asked for \[0, 1\]",
        ),
    ],
)
@pytest.mark.parametrize("isolate", [True, False])
def test_a_world_that_does_not_work_is_one_line_before_anything_runs(tmp_path, monkeypatch, body, said, isolate):
    monkeypatch.chdir(tmp_path)
    method = f"    def simulate(self, label, trials, seed, world):\n        {body}\n\nNUMBERS = iter(range(99))\n"
    (tmp_path / "windy.py").write_text(
        WORLD.replace("    wind: float = 0.0\n", method).replace(', {"wind": "wind"}', "")
    )
    study = Study(name="s", scenarios=("windy.py:WINDY",), estimators=("dead-reckoning",))
    with pytest.raises(cl.BadInput, match=said):
        prepare(study, isolate=isolate)


def test_a_model_without_the_methods_of_a_world_says_which(monkeypatch):
    class Empty(BaseModel):
        def world(self):
            return None

    monkeypatch.setitem(BUILTIN, "empty", Family("nothing", Empty))
    with pytest.raises(cl.BadInput, match=r"the model of scenario 'empty' has no method simulate\(\): Empty must have"):
        cl.simulate("empty")

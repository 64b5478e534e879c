"""A stranger's estimator: in one file, in a package written by `cooploc new-estimator`, and refused with the reason."""

import subprocess
import sys

import pytest
from processes import finish

import cooploc as cl
from cooploc import scaffold
from cooploc.scenarios.check import CHECKS

FILE = """
from dataclasses import dataclass
from cooploc.estimators.dead_reckoning import DeadReckoning

@dataclass(frozen=True)
class Mine(DeadReckoning):
    scale: float = 1.0

class Plain(DeadReckoning):
    pass

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
    with pytest.raises(cl.BadInput, match="takes no parameters: name its class"):
        cl.make(f"{file}:mine[scale=2]")
    with pytest.raises(cl.BadInput, match="no parameter 'scales'; did you mean 'scale'"):
        cl.make(f"{file}:Mine[scales=2]")


def test_an_edited_file_is_loaded_anew(place):
    file = place / "mine.py"
    before = cl.make(f"{file}:Mine")
    file.write_text(FILE.replace("1.0", "5.0"))
    assert (before.scale, cl.make(f"{file}:Mine").scale) == (1.0, 5.0)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_file_runs_in_a_study_and_in_its_workers(place, tmp_path_factory, jobs):
    names = "dead-reckoning,mine.py:Mine[scale=2]"
    told = finish(
        "run",
        "small.toml",
        "--json",
        "--jobs",
        jobs,
        "--estimators",
        names,
        plugins=tmp_path_factory.mktemp("none"),
        cwd=place,
    )
    assert told.returncode == 0, told.stderr
    assert "mine.py:Mine[scale=2]" in told.stdout


def test_an_edited_file_is_not_mixed_into_a_run(place, tmp_path_factory):
    arguments = ("run", "small.toml", "--out", "run", "--estimators", "dead-reckoning,mine.py:Mine")
    options = {"plugins": tmp_path_factory.mktemp("none"), "cwd": place}
    assert finish(*arguments, **options).returncode == 0
    assert finish(*arguments, **options).returncode == 0
    (place / "mine.py").write_text(FILE + "\n")
    told = finish(*arguments, **options)
    assert told.returncode == 2
    assert "run holds results of another version of mine.py; name another with --out" in told.stderr


def test_a_written_package_has_what_it_needs_and_passes_its_own_tests(tmp_path):
    folder = tmp_path / "my-filter"
    files = {path.name for path in scaffold.create("my-filter", folder)}
    assert files == {"pyproject.toml", "my_filter_estimator.py", "test_my_filter_estimator.py", "README.md"}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", folder, folder]
    told = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert told.returncode == 0, told.stdout
    assert f"{len(CHECKS)} passed" in told.stdout


@pytest.mark.parametrize(
    ("name", "said"), [("My Filter", "small letters"), ("arl", "built-in"), ("there", "exists: choose another")]
)
def test_names_that_cannot_be_are_refused(tmp_path, name, said):
    (tmp_path / "there").mkdir()
    with pytest.raises(cl.BadInput, match=said):
        scaffold.create(name, tmp_path / name)

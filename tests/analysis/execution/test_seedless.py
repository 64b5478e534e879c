"""A plug-in's process is never told the seed that makes the truth, on whatever way its code begins to run."""

import pytest

import cooploc as cl
from cooploc.analysis.execution.execute import execute
from cooploc.scenarios.studies.study import Study

SEED = 987654321
FILE = """
import gc
from pathlib import Path
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.analysis.execution.task import Task
from cooploc.scenarios.stream import Stream

def note_seeds():
    found = [one.seed for one in gc.get_objects() if type(one) in (Stream, Task)]
    with Path("seeds.txt").open("a") as notes:
        print(*found, file=notes)

class Looks(DeadReckoning):
    def init(self, prior, world, rows):
        note_seeds()
        return super().init(prior, world, rows)
    def fuse(self, s, z, mail):
        note_seeds()
        return super().fuse(s, z, mail)
"""


@pytest.fixture
def looks(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "looks.py").write_text(FILE)
    return "looks.py:Looks"


def seen(folder):
    return {int(word) for word in (folder / "seeds.txt").read_text().split()}


def test_a_study_sends_streams_without_the_seed(looks, tmp_path):
    study = Study(name="seedless", scenarios=("robots-1-3/n=2[ticks=3]",), estimators=(looks,), trials=1, seed=SEED)
    execute(study, tmp_path / "run", check=False)
    assert seen(tmp_path) == {0}


def test_so_does_a_run_in_python_and_without_isolation_the_seed_is_there_to_be_seen(looks, tmp_path):
    _, stream = cl.simulate("robots-1-3/n=2", trials=1, seed=SEED, ticks=3)
    cl.run([looks], stream)
    assert seen(tmp_path) == {0}
    cl.run([looks], stream, isolate=False)
    assert SEED in seen(tmp_path)

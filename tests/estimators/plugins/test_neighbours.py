"""A file's neighbours are imported in their present version, here and in other processes."""

import pytest

import cooploc as cl

WALK = """
from functools import lru_cache
from {neighbour} import gain

@lru_cache
def twice(x):
    return 2 * x

class Walk:
    uses = ("odometry",)
    step = staticmethod(twice)

    def __init__(self, prior, world, robot, key):
        self.x, self.P = prior.x, prior.P

    def predict(self, z):
        import {late}
        self.x = self.x + self.step(gain()) * {late}.ONE

    def correct(self, z): ...
"""


@pytest.fixture
def plug_in(tmp_path):
    """A file with two neighbours of names that no other test uses; the second is imported when it runs."""
    gain, late = (f"{kind}_{abs(hash(tmp_path))}" for kind in ("gain", "late"))
    (tmp_path / "walk.py").write_text(WALK.format(neighbour=gain, late=late))
    (tmp_path / f"{gain}.py").write_text("def gain():\n    return 1.0\n")
    (tmp_path / f"{late}.py").write_text("ONE = 1.0\n")
    return tmp_path / "walk.py", tmp_path / f"{gain}.py"


@pytest.fixture
def stream():
    return cl.simulate("robots-1-3/n=2", trials=2, ticks=4)[1]


def moved(given, stream, **how):
    x = cl.run({"it": given}, stream, **how).traces["it"].x
    return x[0, 1, 0, 0] - x[0, 0, 0, 0]


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_file_with_caches_and_neighbours_travels_by_its_path(plug_in, stream, jobs):
    label = f"{plug_in[0]}:Walk"
    assert moved(label, stream, jobs=jobs) == pytest.approx(2)
    assert moved(cl.make(label), stream, jobs=jobs) == pytest.approx(2)


def test_an_edited_neighbour_is_imported_again(plug_in, stream):
    label = f"{plug_in[0]}:Walk"
    old = cl.make(label)
    assert moved(old, stream, isolate=False) == pytest.approx(2)
    plug_in[1].write_text("def gain():\n    return 5.0\n")
    assert moved(cl.make(label), stream, isolate=False) == pytest.approx(10)
    assert moved(old, stream, isolate=False) == pytest.approx(2)


def test_a_neighbour_with_the_name_of_another_module_is_refused(tmp_path):
    (tmp_path / "mine.py").write_text("import yaml_of_ours, cloudpickle\n")
    (tmp_path / "yaml_of_ours.py").write_text("")
    (tmp_path / "cloudpickle.py").write_text("")
    with pytest.raises(cl.BadInput, match=r"its neighbour cloudpickle.py, but a module cloudpickle is loaded from"):
        cl.make(f"{tmp_path}/mine.py:Mine")

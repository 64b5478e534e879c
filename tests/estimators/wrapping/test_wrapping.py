"""Plain classes with parameters, notes and global random numbers, wrapped by `PerRobot`."""

import random
from pathlib import Path

import numpy as np
import pytest

import cooploc as cl
from cooploc.analysis.tuning.search import space_of
from cooploc.estimators.tunable import declarations
from cooploc.scenarios.check_harness import Harness
from cooploc.scenarios.conformance import run_check
from cooploc.scenarios.runner.trace import trace

FILE = """
import random
import numpy as np
import cooploc as cl


class Walker:
    uses = ("odometry",)
    axes = "it leans to the east"
    notes = ("steps",)

    def __init__(self, prior, world, robot, key, scale: float = cl.tunable(1.0, 0.5, 2), lean=0, name=None):
        self.x, self.P, self.scale, self.lean, self.steps, self.name = prior.x, prior.P, scale, lean, 0, name

    def predict(self, z):
        self.x = self.x + self.scale * z.odometry + np.array([self.lean, 0])
        self.steps += 1

    def correct(self, z):
        pass

    def estimate(self):
        return cl.Belief(self.x, self.P)


wrapped = cl.PerRobot(Walker, lean=1)
instance = 3


def factory(scale: float = 1.0):
    return cl.PerRobot(Walker, scale=scale)


class Short:
    uses = ("odometry",)

    def __init__(self, prior): ...
    def predict(self, z): ...
    def correct(self, z): ...
    def estimate(self): ...


class Silent:
    def __init__(self, prior, world, robot, key): ...
    def predict(self, z): ...
    def correct(self, z): ...
    def estimate(self): ...
"""


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "plain.py"
    path.write_text(FILE)
    return str(path)


@pytest.fixture
def stream():
    return cl.simulate("robots-1-3/n=2", trials=2, ticks=5)[1]


def test_parameters_of_a_label_reach_a_plain_class_and_a_function(file):
    assert cl.make(f"{file}:factory[scale=0.7]").parameters["scale"] == 0.7
    made = cl.make(f"{file}:Walker[scale=1.5,lean=2,name=rssi]")
    assert made.parameters == {"scale": 1.5, "lean": 2, "name": "rssi"}
    assert (made.uses, made.axes) == (("odometry",), "it leans to the east")
    assert made.label == "Walker[lean=2,name=rssi,scale=1.5]"


def test_a_plain_class_given_in_python_is_lifted_and_printed_with_its_parameters(file, stream):
    wrapped = cl.make(f"{file}:wrapped")
    assert set(cl.run([wrapped.make, wrapped], stream, isolate=False).traces) == {"Walker", "Walker[lean=1]"}


def test_what_a_plain_class_declares_can_be_tuned(file):
    space = space_of(f"{file}:Walker[lean=1]", isolate=False)
    assert set(space.parameters) == {"scale"}
    assert declarations(cl.make(space.label({"scale": 1.25})))["scale"].default == 1.25


@pytest.mark.parametrize(
    ("label", "words"),
    [
        ("Walker[scal=2]", "has no parameter 'scal'; did you mean 'scale'?"),
        ("Walker[scale=wide]", r"scale: it must be a number, not 'wide'"),
        ("Silent", r'write uses = \("odometry", ...\) in it, or name what cl.PerRobot\(Silent, uses=\(...\)\) makes'),
        ("Short", r"Short takes \(prior\); it is called with \(prior, world, robot, key\), then its parameters"),
        ("factory[lean=1]", "has no parameter 'lean'; known are scale"),
        ("instance[lean=1]", "is an instance and takes no parameters"),
    ],
)
def test_what_cannot_be_lifted_is_told_how_in_one_line(file, label, words):
    with pytest.raises(cl.BadInput, match=words) as told:
        cl.make(f"{file}:{label}")
    assert "\n" not in str(told.value)


class Drawing:
    """A walk of both global generators."""

    uses = ("odometry",)

    def __init__(self, prior, world, robot, key):
        self.x, self.P = prior.x, prior.P

    def predict(self, z):
        self.x[:2] += [random.gauss(0, 1), np.random.normal()]  # noqa: NPY002

    def correct(self, z):
        pass

    def estimate(self):
        return cl.Belief(self.x.copy(), self.P)


def test_global_draws_are_keyed_by_trial_robot_and_tick_and_restored(stream):
    before = random.getstate(), np.random.get_state()[1].copy()  # noqa: NPY002
    one = trace("it", cl.PerRobot(Drawing, own_random=True), stream).x
    assert random.getstate() == before[0]
    np.testing.assert_array_equal(np.random.get_state()[1], before[1])  # noqa: NPY002
    np.testing.assert_array_equal(trace("it", cl.PerRobot(Drawing, own_random=True), stream.select([1])).x, one[1:])
    noise = np.diff(one, axis=1)
    assert len(np.unique(noise.round(9))) == noise.size  # no two ticks, robots, trials or generators alike


@pytest.mark.slow
def test_a_library_that_draws_globally_is_deterministic_with_its_own_generator():
    own, shared = (
        run_check("determinism", Harness("it", cl.PerRobot(Drawing, own_random=own), 0)) for own in (True, False)
    )
    assert (own.status, shared.status) == ("passed", "failed")
    assert "it ran a second time" in shared.detail
    assert "own_random=True" in shared.remedy

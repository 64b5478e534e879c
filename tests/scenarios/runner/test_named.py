"""What `cl.run` takes as estimators, and what it says of what it cannot take."""

from dataclasses import dataclass

import pytest

import cooploc as cl
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.estimators.ekf_local import EkfLocal
from cooploc.scenarios.runner.run import estimators_by_name


@dataclass(frozen=True)
class Tuned(EkfLocal):
    """One parameter has no default."""

    gain: float = None

    def __post_init__(self):
        if self.gain is None:
            raise TypeError("gain is missing")


@dataclass(frozen=True)
class Forgetful(DeadReckoning):
    """One of its methods returns nothing."""

    forgets: str = "fuse"

    def __getattribute__(self, name):
        if name == object.__getattribute__(self, "forgets"):
            return lambda *arguments: None
        return object.__getattribute__(self, name)


class Loop:
    """A filter on one robot."""

    def __init__(self, prior, world, robot, key): ...


class Half:
    """An estimator that lacks methods."""

    api = 1

    def init(self, prior, world, rows): ...


@pytest.fixture(scope="module")
def stream():
    return cl.simulate("trajectory", ticks=3)[1]


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ("arl", ["arl"]),
        ("arl[M=1,K=1], ekf-local", ["arl[M=1,K=1]", "ekf-local"]),
        (["arl", "mrsl-rssi[particles=50]", EkfLocal], ["arl", "mrsl-rssi[particles=50]", "EkfLocal"]),
        ((name for name in ("arl", "ctrn")), ["arl", "ctrn"]),
        (cl.estimators()["name"][:2], ["dead-reckoning", "arl"]),
        (EkfLocal, ["EkfLocal"]),
        (EkfLocal(gate=9.0), ["EkfLocal"]),
        ({"mine": EkfLocal, "b": EkfLocal(gate=9.0), "c": "ekf-local[gate=9]"}, ["mine", "b", "c"]),
    ],
)
def test_names_classes_instances_lists_and_mappings_become_instances(given, names):
    found = estimators_by_name(given)
    assert list(found) == names
    assert all(made.api == 1 and not isinstance(made, type) for made in found.values())


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("arll", "there is no estimator 'arll'; did you mean 'arl'?"),
        (["arl", "arl"], "two estimators are called 'arl': give them names, {'arl': ..., 'other': ...}"),
        (Tuned, "Tuned cannot be made without arguments (gain is missing): pass an instance, Tuned(...)"),
        ({"mine": Loop}, "a filter written for one robot is lifted by cl.PerRobot"),
        ({"mine": 3}, "'mine' is of type int, not an estimator: give a name, a class or an instance"),
        (Half, "estimator Half lacks predict(), correct(), send(), fuse()"),
    ],
)
def test_what_is_not_an_estimator_is_refused_with_the_remedy(stream, given, said):
    with pytest.raises(cl.BadInput) as refusal:
        cl.run(given, stream)
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_swapped_arguments_are_put_right(stream):
    truth, _ = cl.simulate("trajectory", ticks=3)
    with pytest.raises(cl.BadInput, match=r"first argument is a Stream, not estimators: write cl.run\(estimators, st"):
        cl.run(stream, "arl")
    with pytest.raises(cl.BadInput, match=r"second argument is a tuple, not a Stream: write truth, stream = "):
        cl.run("arl", (truth, stream))


@pytest.mark.parametrize("method", ["init", "predict", "correct", "send", "fuse", "estimate"])
def test_a_forgotten_return_is_named_with_its_method_and_tick(stream, method):
    when = "before tick 0" if method == "init" else "at tick 0"
    with pytest.raises(
        cl.EstimatorError, match=rf"^mine: {method}\(\) returned None {when}: did you forget its return"
    ):
        cl.run({"mine": Forgetful(forgets=method)}, stream)

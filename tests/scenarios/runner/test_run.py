"""What `cl.run` takes as estimators, and how it refuses them, a forgotten return and an unsound covariance."""

from dataclasses import dataclass

import numpy as np
import pytest

import cooploc as cl
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.estimators.ekf_local import EkfLocal
from cooploc.scenarios.runner.run import estimators_by_name
from cooploc.scenarios.runner.trace import require_covariances


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


TRUTH, STREAM = cl.simulate("trajectory", ticks=3)


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ("arl[M=1,K=1], ekf-local", ["arl[M=1,K=1]", "ekf-local"]),
        (["arl", "mrsl-rssi[particles=50]", EkfLocal], ["arl", "mrsl-rssi[particles=50]", "EkfLocal"]),
        ((name for name in ("arl", "ctrn")), ["arl", "ctrn"]),
        (cl.list_estimators()["name"][:2], ["dead-reckoning", "arl"]),
        (EkfLocal(gate=9.0), ["EkfLocal"]),
        ({"mine": EkfLocal, "b": EkfLocal(gate=9.0), "c": "ekf-local[gate=9]"}, ["mine", "b", "c"]),
    ],
)
def test_names_classes_instances_lists_and_mappings_become_instances(given, names):
    found = estimators_by_name(given)
    assert list(found) == names
    assert all(made.api == 1 and not isinstance(made, type) for made in found.values())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("given", "stream", "words"),
    [
        (["arl", "arl"], STREAM, "two estimators are called 'arl': give them names, {'arl': ..., 'other': ...}"),
        (Tuned, STREAM, "Tuned cannot be made without arguments (TypeError: gain is missing); give its parameters"),
        (
            {"mine": Loop},
            STREAM,
            "Loop has no predict and no correct: a filter of one robot has predict(z) and correct(z)",
        ),
        (cl.PerRobot(Loop, uses="odometry"), STREAM, "uses is 'odometry': make it a tuple of channel names"),
        ({"mine": 3}, STREAM, "'mine' is of type int, not an estimator: give a name, a class or an instance"),
        (type("Empty", (), {})(), STREAM, "Empty has no method of an estimator: a filter of one robot has predict(z)"),
        (Half, STREAM, "estimator Half lacks predict(), correct(), send(), fuse()"),
        (STREAM, "arl", "second argument is a str, not a Stream: write truth, stream = cl.simulate"),
        ("arl", (TRUTH, STREAM), "second argument is a tuple, not a Stream: write truth, stream = "),
    ],
)
def test_what_cannot_run_is_refused_with_the_remedy(given, stream, words):
    with pytest.raises(cl.BadInput) as refusal:
        cl.run(given, stream)
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["init", "predict", "correct", "send", "fuse", "estimate"])
def test_a_forgotten_return_is_named_with_its_method_and_tick(method):
    when = "before tick 0" if method == "init" else "at tick 0"
    with pytest.raises(cl.EstimatorError, match=rf"^mine: {method}\(\) returned None {when}: did you forget"):
        cl.run({"mine": Forgetful(forgets=method)}, STREAM)


def test_a_covariance_of_subnormal_numbers_is_zero_and_a_small_unsound_one_is_refused():
    """A cloud of particles may collapse: what is left of its covariance is no fault."""
    unsound = np.broadcast_to([[1.0, 2.0], [2.0, 1.0]], (1, 3, 3, 2, 2))  # its variances are 3 and -1
    for size in (0.0, 5e-324, 1e-310, 1e-250):
        require_covariances("mine", STREAM, size * unsound)
    with pytest.raises(cl.EstimatorError, match="negative variance"):
        require_covariances("mine", STREAM, 1e-150 * unsound)


def test_what_a_user_sets_in_numpy_changes_nothing():
    """Tables of directions of arrival have squares below the smallest number; they are kept, by what the world is."""
    _, stream = cl.simulate("robots-1-3/n=1[shadowing=2.0625]", trials=1, ticks=5, seed=1)
    with np.errstate(all="raise"):
        found = cl.run("arl", stream).traces["arl"]
    np.testing.assert_array_equal(found.x, cl.run("arl", stream).traces["arl"].x)

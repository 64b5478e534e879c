"""What an estimator may say of itself, and that none of it is needed."""

from dataclasses import dataclass

import cooploc as cl
from cooploc.estimators import make
from cooploc.estimators.registry import refusal, traits


@dataclass(frozen=True)
class Plain:
    """An estimator with the members of the protocol and no others, as a stranger would write it."""

    api = 1
    uses: tuple[str, ...] = ("odometry",)

    def init(self, prior, world, rows):
        return prior

    def predict(self, s, z):
        return s

    def correct(self, s, z):
        return s

    def send(self, s, z):
        return s.x[:, :0]

    def fuse(self, s, z, mail):
        return s

    def estimate(self, s):
        return s


def test_an_estimator_without_optional_members_runs_and_has_the_defaults():
    _, stream = cl.simulate("trajectory", trials=2, ticks=3)
    trace = cl.run(Plain(), stream).traces["Plain"]
    assert (trace.bound, trace.notes) == (False, {})
    assert traits(Plain())[:5] == (False, False, False, False, "")
    assert refusal(Plain()) == ""


def test_the_optional_members_of_built_in_estimators_are_found():
    assert traits(make("ekf-joint"))[:3] == (True, True, False)
    assert traits(make("map-joint"))[:3] == (True, True, True)
    assert traits(make("ekf-luft"))[:3] == (True, False, False)
    assert traits(make("ukf-joint")).axes.startswith("its sigma points")
    assert traits(cl.PerRobot(lambda prior, world, robot, key: None)).mutable

"""What an estimator may say of itself, and that none of it is needed."""

from dataclasses import dataclass

import pytest

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

    correct = predict

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
    assert traits(Plain())[:6] == (False, False, False, False, "", "")
    assert refusal(None).endswith("set api = 1")


@pytest.mark.parametrize(
    ("name", "flags"),
    [("ekf-joint", (True, True, False)), ("map-joint", (True, True, True)), ("ekf-luft", (True, False, False))],
)
def test_the_optional_members_of_built_in_estimators_are_found(name, flags):
    assert traits(make(name))[:3] == flags

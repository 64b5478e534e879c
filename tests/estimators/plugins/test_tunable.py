"""What estimators declare tunable, and that each of it does something."""

from dataclasses import dataclass, field

import numpy as np
import pytest

import cooploc as cl
from cooploc.estimators import BUILTIN
from cooploc.estimators.tunable import declarations, tunable


def other_values(one):
    """Values of a parameter that are not its default, the far ones first."""
    values = [value for value in one.choices or (one.low, one.high) if value != one.default]
    return [int(value) if one.whole else value for value in values]


def beliefs(name, stream, **parameters):
    """The covariances of one estimator; None where it cannot run in that world."""
    made = cl.make(name, **parameters)
    try:
        return cl.run({"a": made}, stream).traces["a"].P
    except cl.IncompatibleEstimator:
        return None


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILTIN)
def test_every_parameter_that_an_estimator_declares_changes_its_estimates_somewhere(name):
    unused = declarations(cl.make(name))
    for label in ("nlos/n=3[ticks=100]", "no-compass/n=3[ticks=40]"):  # walls: readings are gated
        stream = cl.simulate(label, trials=2, seed=3)[1]
        before = beliefs(name, stream)
        for parameter, one in list(unused.items()):
            others = (beliefs(name, stream, **{parameter: value}) for value in other_values(one))
            if any(not np.array_equal(before, other) for other in others):
                del unused[parameter]
    assert not unused, f"{name} declares {', '.join(unused)} and does not use it"


def test_a_filter_that_inflates_its_readings_is_less_certain():
    stream = cl.simulate("robots-1-3/n=1[ticks=20]", trials=2, seed=4)[1]
    run = cl.run(["ekf-local[anchor_reading=rssi]", "ekf-local[anchor_reading=rssi,inflation=3]"], stream)
    plain, inflated = (np.trace(trace.P, axis1=-2, axis2=-1).mean() for trace in run.traces.values())
    assert inflated > 1.5 * plain


def test_a_class_of_a_user_declares_numbers_whole_numbers_and_choices():
    @dataclass(frozen=True)
    class Mine:
        gate: float = cl.tunable(9.0, 1, 100, log=True)
        window: int = tunable(5, 1, 20)
        form: str = tunable("a", choices=("a", "b"))
        told: float = field(default=1.0)

    found = declarations(Mine(gate=7.0))
    assert list(found) == ["gate", "window", "form"]
    assert found["gate"].default == 7.0
    assert found["gate"].log
    assert [one.whole for one in found.values()] == [False, True, False]


@pytest.mark.parametrize(
    "wrong",
    [{}, {"low": 1}, {"low": 2, "high": 1}, {"low": 0, "high": 1, "log": True}, {"low": 0, "high": float("inf")},
     {"low": 0, "high": 1, "choices": (1, 2)}],
)  # fmt: skip
def test_a_declaration_that_holds_nothing_is_refused(wrong):
    with pytest.raises(ValueError, match="tunable"):
        tunable(1.0, **wrong)

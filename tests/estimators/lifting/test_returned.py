"""What a plain object believes, in the forms in which libraries keep it."""

from types import SimpleNamespace

import numpy as np
import pytest

from cooploc.estimators.adapters import parse_belief


def of(x, P):
    return SimpleNamespace(estimate=lambda: (x, P))


def test_an_object_without_estimate_is_read_by_its_x_and_p():
    x, P = np.array([1.0, 2.0]), np.eye(2)
    found = parse_belief(SimpleNamespace(x=x, P=P))
    np.testing.assert_array_equal(found.x, x)
    np.testing.assert_array_equal(found.P, P)


def test_a_column_is_a_state_and_a_heading_is_wrapped():
    found = parse_belief(of(np.array([[1.0], [2.0], [3 * np.pi / 2]]), np.eye(3)))
    np.testing.assert_allclose(found.x, [1, 2, -np.pi / 2], atol=1e-15)


def test_asymmetry_of_rounding_is_taken_out_and_any_other_is_left_to_be_refused():
    P = np.eye(2)
    P[0, 1] = 1e-12
    np.testing.assert_array_equal(parse_belief(of(np.zeros(2), P)).P, parse_belief(of(np.zeros(2), P)).P.T)
    P[0, 1] = 1e-3
    np.testing.assert_array_equal(parse_belief(of(np.zeros(2), P)).P, P)


@pytest.mark.parametrize(
    ("one", "words"),
    [
        (SimpleNamespace(x=np.zeros(2)), r"neither estimate\(\) nor x and P: return cl.Belief"),
        (SimpleNamespace(estimate=lambda: np.zeros(2)), r"returned ndarray; it must be cl.Belief\(x, P\)"),
    ],
)
def test_an_object_that_says_nothing_of_this_is_told_what_to_return(one, words):
    with pytest.raises((AttributeError, ValueError), match=words):
        parse_belief(one)

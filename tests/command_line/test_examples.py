"""The worked examples pass every check, and the plain filterpy loop is the oracle of the other two."""

from pathlib import Path

import numpy as np
import pytest

from cooploc.estimators import make
from cooploc.scenarios import simulate
from cooploc.scenarios.conformance.check import CHECKS, check_estimator
from cooploc.scenarios.conformance.perturb import drop_readings
from cooploc.scenarios.runner.trace import trace

FOLDER = Path(__file__).resolve().parents[2] / "examples"
COMPILED = pytest.param("numba_kernel.py:Compiled", marks=pytest.mark.slow)
NAMES = ("filterpy_loop.py:loop", "batched_numpy.py:Batched", COMPILED)


def example(name):
    return make(f"{FOLDER}/{name}")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.slow
def test_an_example_passes_every_check(name):
    report = check_estimator(example(name), name)
    assert report.passed, report.table()
    assert report.ran == len(CHECKS)


@pytest.mark.parametrize("label", ["robots-1-3/n=3", "packet-drop/drop=0.5", "asynchrony"])
@pytest.mark.parametrize("name", NAMES[1:])
def test_the_others_compute_what_the_loop_computes(name, label):
    _, stream = simulate(label, trials=2, seed=4, ticks=40)
    for one in (stream, drop_readings(stream, np.random.default_rng(2))):
        loop, other = trace("loop", example(NAMES[0]), one), trace("other", example(name), one)
        np.testing.assert_allclose(other.x, loop.x, atol=1e-9)
        np.testing.assert_allclose(other.P, loop.P, atol=1e-9)
        np.testing.assert_array_equal(other.bytes, loop.bytes)


def test_what_teammates_say_is_used():
    _, stream = simulate("robots-1-3/n=3", trials=4, seed=4, ticks=40)
    alone = stream.with_arrays({"air.link": np.zeros_like(stream.air.link)})
    together, apart = (trace("batched", example(NAMES[1]), one).x for one in (stream, alone))
    assert (np.abs(together - apart).max((0, 1, 3)) > 1e-3).all()

"""What counts as an estimator's own time: neither sleep nor compilation."""

import time

import numba
import numpy as np
import pytest

from cooploc.scenarios.runner.trace import Stopwatch


def work(seconds):
    """Keep the processor busy for so long."""
    began = time.process_time()
    while time.process_time() - began < seconds:
        pass


def test_work_counts_and_sleep_does_not():
    worked = time.process_time()
    with Stopwatch() as clock:
        work(0.05)
        time.sleep(0.3)
        work(0.05)
    assert 0.1 <= clock.seconds <= time.process_time() - worked


@pytest.mark.slow
def test_compiling_a_kernel_and_the_kernels_that_it_calls_does_not_count():
    @numba.njit
    def inner(x):
        return x + x[::-1]

    @numba.njit
    def slow_to_compile(x):
        return inner(x).sum() + (x * x).cumsum()[-1]

    began = time.process_time()
    with Stopwatch() as clock:
        slow_to_compile(np.ones(4))
        slow_to_compile(np.ones((2, 4)).T[0])  # a strided array is compiled for again
    assert 0 < clock.seconds < 0.2 * (time.process_time() - began)

"""What counts as an estimator's own time: neither sleep, nor pauses, nor compilation."""

import time

import numba

import cooploc as cl
from cooploc.scenarios.runner.trace import Stopwatch


def work(seconds):
    """Keep the processor busy for so long."""
    began = time.process_time()
    while time.process_time() - began < seconds:
        pass


def test_work_counts_and_sleep_and_pauses_do_not():
    worked = time.process_time()
    with Stopwatch() as clock:
        work(0.05)
        time.sleep(0.3)
        with clock.pause():
            work(0.3)
        work(0.05)
    assert 0.1 <= clock.seconds <= time.process_time() - worked - 0.3


def test_compilation_does_not_count_also_that_of_kernels_which_kernels_call():
    @numba.njit
    def inner(x):
        return x + 1

    @numba.njit
    def outer(x):
        return inner(x) * 2

    began = time.process_time()
    with Stopwatch() as clock:
        assert outer(2.0) == 6.0
    assert clock.seconds < 0.5 * (time.process_time() - began)


def test_a_run_does_not_pay_for_a_kernel_that_is_new():
    @numba.njit
    def slow_to_compile(x):
        return (x + x[::-1]).sum() + (x * x).cumsum()[-1]

    class New:
        api, uses = 1, ("odometry",)

        def __getattr__(self, name):
            return getattr(cl.make("dead-reckoning"), name)

        def predict(self, s, z):
            slow_to_compile(z.dt)
            return cl.make("dead-reckoning").predict(s, z)

    _, stream = cl.simulate("robots-1-3/n=1", trials=2, seed=1, ticks=30)
    began = time.process_time()
    first = cl.run({"new": New()}, stream, isolate=False).traces["new"].seconds
    assert 0 < first < 0.5 * (time.process_time() - began)

"""What counts as an estimator's own time: neither sleep nor compilation."""

import time

import numba

import cooploc as cl
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


def test_a_run_does_not_pay_for_compiling_a_kernel_and_the_kernels_that_it_calls():
    @numba.njit
    def inner(x):
        return x + x[::-1]

    @numba.njit
    def slow_to_compile(x):
        return inner(x).sum() + (x * x).cumsum()[-1]

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

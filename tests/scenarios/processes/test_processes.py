"""Processes of their own, and limits of time: what happens there stays there, and a trial is late after one limit."""

import contextlib
import math
import os
import signal
import time

import numpy as np
import pytest

import cooploc as cl
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.scenarios import process
from cooploc.scenarios.process import (
    Outcome,
    ProcessDied,
    ProcessHung,
    TimeLimit,
    WorkerError,
    call,
    end,
    limit_time,
)


class Unspeakable(Exception):
    def __str__(self):
        raise SystemExit

    def __repr__(self):
        return "unspeakable"


class Clock:
    """Time that passes only while somebody sleeps, and rings the alarm that was set: the same on every machine."""

    now, due = 0.0, math.inf

    def monotonic(self):
        return self.now

    def setitimer(self, _, seconds):
        self.due = self.now + (seconds or math.inf)

    def sleep(self, seconds):
        end = self.now + seconds
        while self.due <= end:
            self.now, self.due = self.due, math.inf
            signal.getsignal(signal.SIGALRM)(signal.SIGALRM, None)
        self.now = end


@pytest.fixture
def slept(monkeypatch):
    """How long it takes to be late, where each of so many calls sleeps [s]; None where it is not late."""

    def until_late(seconds, calls, trials=1):
        clock = Clock()
        monkeypatch.setattr(process, "time", clock)
        monkeypatch.setattr(signal, "setitimer", clock.setitimer)
        try:
            with limit_time(0.2, trials, calls) as watch:
                for tick in range(calls):
                    watch("predict", tick, (seconds,), clock.sleep)
        except TimeLimit:
            return clock.now
        return None

    return until_late


def test_one_that_hangs_among_fifty_is_late_after_one_limit(slept):
    assert 0.2 <= slept(5.0, 1, trials=50) < 0.3


def test_fifty_trials_may_take_as_long_as_fifty_in_calls_that_end(slept):
    assert slept(0.1, 5, trials=50) is None
    assert slept(0.1, 5) < 0.3


def test_one_that_is_slow_in_every_call_is_late_long_before_the_fiftieth_limit(slept):
    """50 trials have 10 s for 100 ticks; 0.15 s a tick are 15 s, and too many from the sixth tick on."""
    assert slept(0.15, 100, trials=50) < 1.0


def test_what_catches_every_exception_does_not_catch_that_it_is_late():
    with pytest.raises(TimeLimit), limit_time(0.1), contextlib.suppress(Exception):
        time.sleep(60)


@pytest.mark.parametrize("error", [ValueError("no"), cl.BadInput("no"), Unspeakable(), KeyboardInterrupt()], ids=repr)
def test_an_exception_travels_as_itself_only_where_its_class_is_known(error):
    known = type(error) in (ValueError, cl.BadInput)
    with pytest.raises(type(error) if known else WorkerError, match="no" if known else type(error).__name__):
        Outcome.of_exception(error).unpack()


@pytest.mark.slow
def test_a_process_that_ends_or_hangs_is_an_error_and_the_next_call_has_another():
    with pytest.raises(ProcessDied, match=r"died \(exit code 3\)"):
        call("test", os._exit, 3)
    first = call("test", os.getpid)
    assert first == call("test", os.getpid) != os.getpid()
    with pytest.raises(ProcessHung, match=r"longer than 0.5 s"):
        call("test", time.sleep, 60, seconds=0.5)
    assert call("test", os.getpid) != first
    call("test", os.chdir, "/")
    assert call("test", os.getcwd) == os.getcwd()
    end("test")


class Careless(DeadReckoning):
    """What somebody writes in a notebook; `does` it in one method."""

    does = staticmethod(lambda: None)

    def fuse(self, s, z, mail):
        self.does()
        return super().fuse(s, z, mail)


def leave():
    os._exit(0)


def interrupt():
    raise KeyboardInterrupt


def sleep():
    time.sleep(60)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("does", "said"),
    [
        (leave, r"mine: its process died \(exit code 0\)"),
        (sleep, "mine: TimeLimit: longer than the time limit of 1 s a trial"),
        (interrupt, "mine: KeyboardInterrupt"),
    ],
)
def test_an_estimator_of_a_notebook_that_ends_its_process_is_an_error_of_the_run(does, said):
    _, stream = cl.simulate("trajectory", trials=2, ticks=4, seed=1)
    cls = type("Mine", (Careless,), {"does": staticmethod(does)})
    limits = [1.0, 2.0] if does is sleep else [600.0, 600.0]  # [s] what ends by itself is waited for
    with pytest.raises(cl.EstimatorError, match=said):
        cl.run({"mine": cls}, stream, time_limit=limits[0])
    report = cl.check_estimator(cls(), time_limit=limits[1])
    assert not report.passed
    assert report["runs"].status == "failed"


@pytest.mark.slow
def test_a_process_of_its_own_gives_the_bits_of_this_one_and_prints_here(capsys):
    _, stream = cl.simulate("trajectory", trials=3, ticks=5, seed=1)
    cls = type("Mine", (Careless,), {"does": staticmethod(lambda: print("seen", os.getpid()))})
    apart = cl.run({"mine": cls(), "dead": "dead-reckoning"}, stream)
    pids = set(capsys.readouterr().out.split()) - {"seen"}
    assert len(pids) == 1
    assert str(os.getpid()) not in pids
    here = cl.run({"mine": cls()}, stream, isolate=False)
    assert str(os.getpid()) in capsys.readouterr().out.split()
    for field in ("x", "P", "messages", "bytes"):
        one, two = (getattr(run.traces["mine"], field) for run in (apart, here))
        np.testing.assert_array_equal(one, two)


def test_what_contradicts_itself_is_refused():
    _, stream = cl.simulate("trajectory", trials=2, ticks=3, seed=1)
    with pytest.raises(cl.BadInput, match="isolate=False keeps everything in one process, and jobs is 2"):
        cl.run("dead-reckoning", stream, jobs=2, isolate=False)
    with pytest.raises(cl.BadInput, match="time_limit is nan"):
        cl.run("dead-reckoning", stream, time_limit=math.nan)


def test_ctrl_c_reaches_no_process_while_it_starts():
    """Else one that imports prints a traceback before it can be told to leave Ctrl-C alone."""
    held_back = call("mine", signal.pthread_sigmask, signal.SIG_BLOCK, [])
    end("mine")
    assert signal.SIGINT in held_back
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])

"""Processes of their own, and limits of time: what happens there stays there, and a trial is late after one limit."""

import contextlib
import importlib
import multiprocessing
import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import cooploc as cl
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.scenarios.process import (
    BUILTIN,
    SESSION,
    Outcome,
    ProcessDied,
    ProcessHung,
    WorkerError,
    call,
    end,
    end_if_edited,
    limit_time,
    submit,
)


def run_late(limit, seconds, calls, trials):
    """Make so many calls of so many seconds in a process for plug-ins."""
    with limit_time(limit, trials, calls) as watch:
        for tick in range(calls):
            watch("predict", tick, (seconds,), time.sleep)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seconds", "calls", "trials", "late"),
    [
        (30.0, 1, 50, True),  # one that hangs among fifty
        (0.3, 5, 50, False),  # fifty trials may take as long as fifty, in calls that end
        (0.3, 50, 1, True),
        (0.9, 100, 50, True),  # too slow in every call: noticed long before the fiftieth limit
    ],
)
def test_a_trial_is_late_after_one_limit(seconds, calls, trials, late):
    began = time.monotonic()
    with pytest.raises(ProcessHung, match="time limit of 1 s a") if late else contextlib.nullcontext():
        call("test", run_late, 1.0, seconds, calls, trials, limit=1.0)
    assert time.monotonic() - began < 20


class Unspeakable(Exception):
    def __str__(self):
        raise SystemExit


@pytest.mark.parametrize("error", [ValueError("no"), cl.BadInput("no"), Unspeakable(), KeyboardInterrupt()], ids=type)
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
    assert signal.SIGINT in call("test", signal.pthread_sigmask, signal.SIG_BLOCK, [])  # no Ctrl-C while it starts
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    end("test")


@pytest.mark.slow
def test_a_file_named_like_a_module_of_python_harms_no_process_that_starts_beside_it(tmp_path, monkeypatch):
    (tmp_path / "random.py").write_text("raise RuntimeError('not that of Python')")
    monkeypatch.chdir(tmp_path)
    assert call("test", os.environ.get, "PYTHONSAFEPATH") is None  # what a plug-in starts finds its files
    assert "PYTHONSAFEPATH" not in os.environ
    end("test")


@pytest.mark.slow
def test_a_file_edited_while_a_run_goes_on_leaves_its_processes_alone_until_it_is_over(tmp_path, monkeypatch):
    (tmp_path / "of_mine.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module("of_mine")
    end(BUILTIN)  # processes that an earlier test left began before the file was imported
    working = submit(BUILTIN, 1, time.sleep, 1.0)
    os.utime(tmp_path / "of_mine.py", (0, 0))
    pid = submit(BUILTIN, 1, os.getpid).result().unpack()
    assert working.result().unpack() is None
    end_if_edited(BUILTIN)
    assert submit(BUILTIN, 1, os.getpid).result().unpack() != pid
    end(BUILTIN)


def careless(does):
    """A class as one writes it in a notebook, of no file, which `does` it in one method."""

    def fuse(self, s, z, mail):
        does()
        return s

    return type("Mine", (DeadReckoning,), {"fuse": fuse})


CALLS = []


def hang_later():
    """Hang when two ticks are over, in which the estimator is warmed up."""
    CALLS.append(0)
    if len(CALLS) > 2:
        time.sleep(60)


def interrupt():
    raise KeyboardInterrupt


@pytest.mark.slow
@pytest.mark.parametrize(
    ("does", "said"),
    [
        (lambda: os._exit(0), r"mine: its process died \(exit code 0\)"),
        (hang_later, "mine: longer than the time limit of 1 s a trial: its process was ended"),
        (interrupt, "mine: KeyboardInterrupt"),
    ],
)
def test_an_estimator_of_a_notebook_that_ends_its_process_is_an_error_of_the_run(does, said):
    _, stream = cl.simulate("trajectory", trials=2, ticks=4, seed=1)
    limits = [1.0, 2.0] if "time limit" in said else [600.0, 600.0]  # [s] what ends by itself is waited for
    with pytest.raises(cl.EstimatorError, match=said):
        cl.run({"mine": careless(does)}, stream, time_limit=limits[0])
    assert cl.check_estimator(careless(does)(), time_limit=limits[1])["runs"].status == "failed"


@pytest.mark.slow
def test_a_process_of_its_own_gives_the_bits_of_this_one_and_prints_on_stderr(capsys):
    _, stream = cl.simulate("trajectory", trials=3, ticks=5, seed=1)
    cls = careless(lambda: print("seen", os.getpid()))
    apart = cl.run({"mine": cls(), "dead": "dead-reckoning"}, stream)
    printed = capsys.readouterr()
    pids = set(printed.err.split()) - {"seen"}
    assert printed.out == ""  # where a table is, or JSON
    assert len(pids) == 1
    assert str(os.getpid()) not in pids
    here = cl.run({"mine": cls()}, stream, isolate=False)
    for field in ("x", "P", "messages", "bytes"):
        one, two = (getattr(run.traces["mine"], field) for run in (apart, here))
        np.testing.assert_array_equal(one, two)
    capsys.readouterr()
    assert cl.check_estimator(cls()).ran
    assert "seen" not in "".join(capsys.readouterr())  # of 150 runs
    cl.check_estimator(cls(), isolate=False)  # as for a debugger
    assert "seen" in capsys.readouterr().out


def test_what_contradicts_itself_is_refused():
    _, stream = cl.simulate("trajectory", trials=2, ticks=3, seed=1)
    with pytest.raises(cl.BadInput, match="isolate=False keeps everything in one process, and jobs is 2"):
        cl.run("dead-reckoning", stream, jobs=2, isolate=False)


def error_of_own(seed):
    """The RMSE of a plug-in, which runs in a process of its own."""
    truth, stream = cl.simulate("trajectory", trials=1, ticks=3, seed=seed)
    return float(cl.errors(truth, cl.run({"mine": careless(int)()}, stream))["rmse"].mean())


@pytest.mark.slow
def test_threads_may_run_plug_ins_at_once_and_a_pool_s_process_is_told_what_may():
    end(SESSION)  # so that all three want to start it
    with ThreadPoolExecutor(3) as threads:
        at_once = list(threads.map(error_of_own, (1, 2, 1)))
    assert at_once == [error_of_own(1), error_of_own(2), at_once[0]]
    said = r"multiprocessing\.Pool may start no other: use concurrent\.futures"
    with multiprocessing.get_context("fork").Pool(1) as pool, pytest.raises(cl.BadInput, match=said):
        pool.map(error_of_own, [1])

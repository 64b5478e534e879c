"""Attempts with input that may be anything: what must hold of each, whatever the input was."""

import contextlib
import re
import signal

import pytest
from hypothesis import HealthCheck, settings
from processes import HANGS, inside

from cooploc.estimators.errors import BadInput

CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u202a-\u202e\u2066-\u2069]")


def cases(count):
    """A slow test of so many examples, the same ones every time."""
    same = {"derandomize": True, "database": None, "deadline": None}
    chosen = settings(max_examples=count, suppress_health_check=list(HealthCheck), **same)
    return lambda test: pytest.mark.slow(chosen(test))


@contextlib.contextmanager
def in_time():
    """Fail where a block hangs."""

    def late(*_):
        raise AssertionError(f"still running after {HANGS} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(HANGS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def attempted(function, *arguments, **named):
    """What a function returns, or its BadInput; any other exception is a failure."""
    with in_time():
        try:
            return function(*arguments, **named)
        except BadInput as e:
            return e


def commanded(*arguments, cwd="."):
    """A command whose exit code is one of those promised, and which says what is wrong in one plain line."""
    with in_time():
        done = inside(*arguments, cwd=cwd)
    assert done.returncode in (0, 1, 2), done
    assert "Traceback (most recent call last)" not in done.stderr, done.stderr
    assert not CONTROL.search(done.stdout + done.stderr), repr(done.stdout + done.stderr)
    if done.returncode == 2:
        assert done.stderr.count("\n") == 1, done.stderr
        assert done.stderr.startswith("cooploc: "), done.stderr
        assert done.stdout == "", done.stdout
    return done

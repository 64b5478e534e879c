"""What every room's tests share: random numbers and examples that are the same every time.

A test, and a file of tests, that leaves something global changed fails: none can depend on another.
"""

import os
import sys
import zlib

import numpy as np
import pytest
from hypothesis import settings
from oracles import repeatable
from processes import stop_server
from unchanged import changes, look, own_draws

from cooploc.scenarios import check_harness

os.environ["MPLBACKEND"] = "agg"  # as the command line does, whichever test comes first
for of_a_terminal in ("TERM", "COLUMNS", "LINES", "FORCE_COLOR", "NO_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
    os.environ.pop(of_a_terminal, None)  # what commands print is the same wherever the tests run
settings.register_profile("repeatable", repeatable)
settings.load_profile("repeatable")


@pytest.fixture
def rng(request):
    """A generator of this test's own, so that its draws do not depend on which tests ran before it."""
    return np.random.default_rng(zlib.crc32(request.node.nodeid.encode()))


@pytest.fixture
def short_streams(monkeypatch):
    """Let checks in this process run on streams of a third of the ticks, for estimators that take long."""
    short = {label: {**options, "ticks": 4} for label, options in check_harness.SCENARIOS.items()}
    monkeypatch.setattr(check_harness, "SCENARIOS", short)


@pytest.fixture(scope="module", autouse=True)
def this_file_leaves_all_as_it_was():
    yield from _watched()


@pytest.fixture(autouse=True)
def this_test_leaves_all_as_it_was(this_file_leaves_all_as_it_was):
    yield from _watched()
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")  # a figure that one test left open must not be counted by the next


def _watched():
    before, path = look(), sys.path.copy()
    yield
    sys.path[:] = path  # the folder of a plug-in's file is added when it is loaded
    if lines := changes(before, look()):
        pytest.fail("; ".join(lines), pytrace=False)


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call():
    with own_draws():
        return (yield)


pytest_fixture_setup = pytest_pyfunc_call


def pytest_unconfigure():
    stop_server()

"""What every room's tests share: random numbers and examples that are the same every time, kernels compiled once."""

import os
import sys
import zlib

import numpy as np
import pytest
from compiling import take_turns
from hypothesis import settings
from oracles import repeatable
from processes import stop_server

settings.register_profile("repeatable", repeatable)
settings.load_profile("repeatable")
take_turns()
os.environ["COOPLOC_CACHE"] = ""  # no certificate of another run, nor of another test


@pytest.fixture
def rng(request):
    """A generator of this test's own, so that its draws do not depend on which tests ran before it."""
    return np.random.default_rng(zlib.crc32(request.node.nodeid.encode()))


@pytest.fixture(autouse=True)
def no_figure_is_left():
    """A figure that one test left open must not be counted by the next."""
    yield
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")


def pytest_unconfigure():
    stop_server()

"""What every room's tests share: random numbers and examples that are the same every time, kernels compiled once."""

import zlib

import numpy as np
import pytest
from filelock import FileLock
from hypothesis import settings
from numba.core.dispatcher import Dispatcher
from oracles import repeatable
from processes import stop_server

settings.register_profile("repeatable", repeatable)
settings.load_profile("repeatable")


@pytest.fixture
def rng(request):
    """A generator of this test's own, so that its draws do not depend on which tests ran before it."""
    return np.random.default_rng(zlib.crc32(request.node.nodeid.encode()))


def one_after_another(compile):
    """Of two workers that need a kernel, the second waits for the first and finds it on disk."""

    def compiled(self, signature):
        place = getattr(self._cache, "cache_path", None)  # a kernel that is not kept has none
        if place is None:
            return compile(self, signature)
        with FileLock(f"{place}/{self.py_func.__name__}.lock", is_singleton=True):
            return compile(self, signature)

    return compiled


Dispatcher.compile = one_after_another(Dispatcher.compile)


def pytest_unconfigure():
    stop_server()

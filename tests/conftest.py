"""What every room's tests share: random numbers and examples that are the same every time."""

import zlib

import numpy as np
import pytest
from hypothesis import settings
from oracles import repeatable

settings.register_profile("repeatable", repeatable)
settings.load_profile("repeatable")


@pytest.fixture
def rng(request):
    """A generator of this test's own, so that its draws do not depend on which tests ran before it."""
    return np.random.default_rng(zlib.crc32(request.node.nodeid.encode()))

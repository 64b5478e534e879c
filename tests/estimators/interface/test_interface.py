"""The readings of a tick come in a fixed order, in a world that cannot be written to."""

import numpy as np
import pytest

from cooploc.estimators.interface import Mail, Senses, World
from cooploc.estimators.models import Displacement, LogDistance, Range


@pytest.fixture
def world():
    """Two robots and two anchors."""
    sensors = {f"{who}_range": Range() for who in ("radio", "anchor")}
    sensors |= {f"{who}_rssi": LogDistance() for who in ("radio", "anchor")}
    return World(2, 1.0, np.array([[0, 0], [6, 4]]), Displacement(), sensors, np.array([[0, 0], [6, 4]]))


@pytest.fixture
def tick():
    """One row: it has an RSSI of the second anchor, ranges of both, and hears the second robot."""
    nan = np.nan
    extra = {"anchor_range": np.array([[3.0, 5.0]])}
    rssi, nothing = np.array([[nan, -60.0]]), np.zeros((1, 0, 2))
    senses = Senses(np.zeros((1, 2)), np.ones(1), rssi, nothing, nothing, extra)
    return senses, Mail(np.array([[False, True]]), np.zeros((1, 2, 0)), rssi - 1, np.array([[nan, 2.0]]))


def test_readings_come_in_a_fixed_order_and_absent_ones_not_at_all(world, tick):
    fixed = [(type(sensor).__name__, place.tolist(), z.item()) for sensor, place, z in world.fixed(tick[0])]
    assert fixed == [("LogDistance", [6, 4], -60.0), ("Range", [0, 0], 3.0), ("Range", [6, 4], 5.0)]
    relative = [(type(sensor).__name__, sender, z.item()) for sensor, sender, z in world.relative(*tick)]
    assert relative == [("LogDistance", 1, -61.0), ("Range", 1, 2.0)]
    for array in (world.arena, world.anchors, world.landmarks):
        assert not array.flags.writeable

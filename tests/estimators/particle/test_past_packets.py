"""The last M packets of each sender: what is remembered, and the product of their likelihoods written out."""

from dataclasses import dataclass

import numpy as np
import pytest

from cooploc.estimators import particles
from cooploc.estimators.interface import Senses
from cooploc.estimators.models import Displacement, LogDistance, Range, Unicycle
from cooploc.estimators.particle_likelihood import ReceivedPackets, teammates

ROWS, SENDERS, SAMPLES = 3, 4, 3


def packets(rng, sensor, absent=0.4):
    """What the robots hear in one tick."""
    heard = rng.uniform(size=(ROWS, SENDERS)) > absent
    sent = np.concatenate([rng.uniform(0, 6, (ROWS, SENDERS, 2)), np.tile([0.3, 0.1, 0.2], (ROWS, SENDERS, 1))], -1)
    z = rng.uniform(1, 4, (ROWS, SENDERS)) if isinstance(sensor, Range) else rng.normal(-50, 5, (ROWS, SENDERS))
    return ReceivedPackets(sensor, np.where(heard[..., None], sent, np.nan), np.where(heard, z, np.nan), True)


def senses(u):
    none = np.empty((ROWS, 0))
    return Senses(u, np.ones(ROWS), none, none, none, {})


def driven(sensor, motion, ticks=7, seed=0):
    """A memory after some ticks, and by (row, sender) what it should hold: newest first, with the moves since."""
    rng = np.random.default_rng(seed)
    past, told = particles.no_past_packets(ROWS, SENDERS, SAMPLES), {}
    for _ in range(ticks):
        z = senses(rng.normal(0, 0.3, (ROWS, 2)))
        past = particles.shift_past_packets(past, motion, z)
        heard = packets(rng, sensor)
        past = particles.keep_received(past, heard)
        for r in range(ROWS):
            for j in range(SENDERS):
                before = [(since + z.odometry[r], *rest) for since, *rest in told.get((r, j), [])]
                new = [(np.zeros(2), heard.readings[r, j], heard.packets[r, j])]
                told[r, j] = ([*new, *before] if np.isfinite(heard.readings[r, j]) else before)[:SAMPLES]
    return past, told, heard


@pytest.mark.parametrize("sensor", [LogDistance(), Range()], ids=["rssi", "range"])
def test_the_weight_is_the_product_over_the_packets_of_the_senders_heard(sensor):
    past, told, heard = driven(sensor, Displacement())
    rng = np.random.default_rng(1)
    x, logw = rng.uniform(0, 6, (ROWS, 40, 2)), rng.normal(size=(ROWS, 40))
    want = logw.copy()
    for (r, j), received in told.items():
        for since, reading, packet in received if np.isfinite(heard.readings[r, j]) else []:
            one = ReceivedPackets(sensor, packet[None, None], np.array([[reading]]), True)
            want[r] += 0.25 * teammates(one, x[r : r + 1] - since, np.zeros((1, 40)))[0]
    got = particles.weigh_past_packets(past, heard, Displacement(), x, logw, 0.25)
    np.testing.assert_allclose(got, want, rtol=1e-10, atol=1e-10)
    assert 0 < np.isfinite(heard.readings).sum() < ROWS * SENDERS


@dataclass(frozen=True)
class Plugin(LogDistance):
    """The same sensor under another type, for which there is no loop."""


@pytest.mark.parametrize("motion", [Displacement(), Unicycle()], ids=["compass", "heading"])
def test_without_a_loop_the_weights_are_the_same(motion):
    past, _, heard = driven(LogDistance(), motion)
    d = 2 if isinstance(motion, Displacement) else 3
    rng = np.random.default_rng(2)
    x, logw = rng.uniform(0, 3, (ROWS, 40, d)), rng.normal(size=(ROWS, 40))
    one, other = (
        particles.weigh_past_packets(past, heard._replace(sensor=sensor), motion, x, logw, 1.0)
        for sensor in (LogDistance(), Plugin())
    )
    np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)
    assert np.ptp(one - logw) > 0.1

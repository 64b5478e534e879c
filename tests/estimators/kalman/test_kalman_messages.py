"""A packet gives back the belief and the sightings that went into it; what is sent is counted by trial and robot."""

import numpy as np
import pytest
from oracles import covariances

from cooploc.estimators.kalman import Message, count, no_traffic


@pytest.mark.parametrize("teammates", [0, 4])
@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("d", [2, 3])
def test_a_message_comes_out_as_it_went_in(d, parts, teammates):
    rng = np.random.default_rng(1)
    sent = Message(
        rng.normal(size=(5, d)),
        tuple(covariances(rng, 5, d=d) for _ in range(parts)),
        rng.normal(size=(5, teammates, 2)),
    )
    packets = sent.pack()
    assert packets.shape == (5, d + parts * d * (d + 1) // 2 + 2 * teammates)
    got = Message.unpack(packets, d, parts)
    for a, b in zip((got.x, *got.P, got.sightings), (sent.x, *sent.P, sent.sightings), strict=True):
        np.testing.assert_array_equal(a, b)


def test_messages_are_counted_with_a_header_where_they_were_sent():
    sent = no_traffic(np.zeros((2, 3, 2)))
    count(sent, 1, np.array([True, False]), 5)
    count(sent, 1, np.array([True, True]), 0)
    np.testing.assert_array_equal(sent.messages, [[0, 2, 0], [0, 1, 0]])
    np.testing.assert_array_equal(sent.bytes, [[0, 8 + 40 + 8, 0], [0, 8, 0]])

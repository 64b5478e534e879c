"""Mail is delivered and counted as plain numpy over whole arrays says."""

import numpy as np
import pytest

from cooploc.scenarios.runner.tick import HEADER, deliver


def reference(sent, n, link, rssi, distance, awake):
    """Heard, packets, rssi, range, messages, bytes by masks of the whole array (trial, sender, addressee, m)."""
    t, m, addressed = len(link), sent.shape[-1], sent.ndim == 3
    wire = np.broadcast_to(sent.reshape(t, n, n if addressed else 1, m), (t, n, n, m))
    said = ~np.isnan(wire)
    heard = link & said.any(-1).swapaxes(1, 2)
    packets = np.where(heard[..., None], wire.swapaxes(1, 2), np.nan)
    counted = said & awake[:, :, None, None]
    counted = counted & ~np.eye(n, dtype=bool)[..., None] if addressed else counted[:, :, :1]
    spoke = counted.any(-1)
    size = (counted.sum(-1) * sent.itemsize + HEADER * spoke).sum(-1)
    return heard, packets, np.where(heard, rssi, np.nan), np.where(heard, distance, np.nan), spoke.sum(-1), size


@pytest.mark.parametrize("addressed", [False, True])
@pytest.mark.parametrize("n", [1, 2, 5])
@pytest.mark.parametrize("m", [0, 1, 4])
def test_mail_is_what_masks_of_the_whole_array_say(n, m, addressed):
    rng, t = np.random.default_rng(n + 10 * m), 7
    sent = rng.normal(size=(t * n, *[n] * addressed, m))
    sent[rng.random(sent.shape) < 0.4] = np.nan
    sent[rng.random(sent.shape[:-1]) < 0.2] = np.nan  # whole packets
    link = (rng.random((t, n, n)) < 0.7) & ~np.eye(n, dtype=bool)
    rssi, distance, awake = rng.normal(size=(t, n, n)), rng.normal(size=(t, n, n)), rng.random((t, n)) < 0.8
    rssi[0] = np.nan
    mail, traffic = deliver(sent, awake, link, rssi, distance)
    want = reference(sent, n, link, rssi, distance, awake)
    for found, array in zip((*mail, *traffic), want, strict=True):
        np.testing.assert_array_equal(found, array.reshape(found.shape))


def test_single_precision_is_carried_and_counted_as_it_is():
    sent, link = np.ones((2, 3), np.float32), ~np.eye(2, dtype=bool)[None]
    pairs = np.zeros((1, 2, 2))
    mail, traffic = deliver(sent, np.ones((1, 2), bool), link, pairs, pairs)
    assert mail.packets.dtype == np.float32
    np.testing.assert_array_equal(traffic.bytes, [[3 * 4 + HEADER] * 2])

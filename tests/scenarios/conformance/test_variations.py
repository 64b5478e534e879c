"""What the checks do to a stream."""

import numpy as np
import pytest
from oracles import linear_team

from cooploc.estimators import make
from cooploc.scenarios import check_harness, simulate, variations


@pytest.fixture(params=["robots-1-3/n=3", "camera", "linear"])
def stream(request):
    if request.param == "linear":
        return linear_team(seed=0, trials=2, robots=3, ticks=8)[1]
    return simulate(request.param, trials=2, ticks=8, drop=0.3)[1]


@pytest.mark.parametrize("mode", variations.MODES)
@pytest.mark.parametrize("since", [0, 3])
def test_only_the_readings_of_that_robot_and_time_are_perturbed(stream, mode, since):
    after = variations.perturb_readings(stream, mode, np.random.default_rng(0), 1, since)
    for name, a in stream.arrays().items():
        b = after.arrays()[name]
        differs = ~((a == b) | ((a != a) & (b != b)))
        where = differs.reshape(*a.shape[: 2 if name.startswith("prior") else 3], -1).any(-1)
        if name.startswith("prior."):
            assert not where[:, [0, 2]].any()
            assert where[:, 1].all() == (since == 0)
        elif name == "air.link":
            assert not where.any()
        else:
            assert not where[:, :, [0, 2]].any()
            assert not where[:, :since].any()
            there = np.isfinite(a).reshape(*where.shape, -1).any(-1)
            np.testing.assert_array_equal(where[:, since:, 1], there[:, since:, 1])


def test_the_small_streams_hold_every_case():
    """Present and absent readings, ticks with all and with none, packets that came and that did not."""
    for stream in check_harness.Harness("any", make("dead-reckoning"), seed=0).streams:
        if stream.robots > 1:
            off = stream.air.link[..., ~np.eye(stream.robots, dtype=bool)]
            assert 0.5 < off.mean() < 0.9
        for channel in ("anchor_rssi", "landmark"):
            there = np.isfinite(getattr(stream.senses, channel))
            if there.size:
                assert 0.2 < there.mean() < 0.95
                assert there[:, 0].any()
                assert not there[:, 4].any()

"""The parts of the conformance suite: what is done to a stream, and that no changed bit is overlooked."""

import dataclasses

import numpy as np
import pytest
from oracles import linear_team

from cooploc.estimators import make
from cooploc.scenarios import simulate
from cooploc.scenarios.conformance import variations
from cooploc.scenarios.conformance.harness import CheckFailed, Harness, require_equal, snapshot


@pytest.fixture(params=["robots-1-3/n=3", "camera", "linear"])
def stream(request):
    if request.param == "linear":
        return linear_team(seed=0, trials=2, robots=3, ticks=8)[1]
    return simulate(request.param, trials=2, ticks=8, drop=0.3)[1]


def changed(before, after):
    """By array, where something differs: (trial, tick, robot), or (trial, robot) for priors."""
    found = {}
    for name, a in before.arrays().items():
        b = after.arrays()[name]
        assert a.shape == b.shape
        lead = 2 if name.startswith("prior") else 3
        differs = ~((a == b) | ((a != a) & (b != b)))
        found[name] = differs.reshape(*differs.shape[:lead], -1).any(-1)
    return found


@pytest.mark.parametrize("mode", variations.MODES)
def test_only_the_readings_of_that_robot_and_time_are_perturbed(stream, mode):
    rng = np.random.default_rng(0)
    for since in (0, 3):
        for name, where in changed(stream, variations.perturb_readings(stream, mode, rng, 1, since)).items():
            if name.startswith("prior."):
                assert not where[:, [0, 2]].any()
                assert where[:, 1].all() == (since == 0)
            elif name == "air.link":
                assert not where.any()
            else:
                assert not where[:, :, [0, 2]].any()
                assert not where[:, :since].any()
                there = np.isfinite(stream.arrays()[name]).reshape(*where.shape, -1).any(-1)
                np.testing.assert_array_equal(where[:, since:, 1], there[:, since:, 1])


def test_hidden_readings_are_gone_and_what_is_needed_to_move_stays(stream):
    hidden = variations.perturb_readings(stream, "hidden", np.random.default_rng(0))
    for name, array in hidden.arrays().items():
        if name != "air.link":
            assert np.isfinite(array).all() if name in variations.NEVER_HIDDEN else np.isnan(array).all()
    assert np.linalg.eigvalsh(hidden.prior.P).min() > 0
    assert hidden.senses.dt.min() > 0


def test_links_are_cut_of_one_sender_or_all(stream):
    link = stream.air.link
    cut = variations.drop_packets(stream, sender=2, since=3).air.link
    assert not cut[:, 3:, :, 2].any()
    np.testing.assert_array_equal(cut[..., :2], link[..., :2])
    np.testing.assert_array_equal(cut[:, :3], link[:, :3])
    assert not variations.drop_packets(stream).air.link.any()
    other = variations.perturb_links(stream, "perturbed", np.random.default_rng(0), 3).air.link
    assert (other != link)[:, 3:].any()
    assert not other[..., range(3), range(3)].any()
    np.testing.assert_array_equal(other[:, :3], link[:, :3])


@pytest.mark.parametrize("mode", variations.MODES)
def test_radio_readings_are_perturbed_only_where_no_packet_came(mode):
    _, stream = simulate("packet-drop", ticks=8)
    other = variations.perturb_dropped_radio(stream, mode, np.random.default_rng(0))
    for name in ("rssi", "range"):
        a, b = getattr(stream.air, name), getattr(other.air, name)
        np.testing.assert_array_equal((a != b) & ~np.isnan(a), ~stream.air.link & ~np.isnan(a))


def test_a_streams_own_copy_shares_no_memory(stream):
    copy = variations.deep_copy(stream)
    assert copy.hashes == stream.hashes
    for name, array in copy.arrays().items():
        assert not array.flags.writeable
        assert not np.shares_memory(array, stream.arrays()[name])
    for name in ("arena", "anchors", "landmarks"):
        assert not np.shares_memory(getattr(copy.world, name), getattr(stream.world, name))
    assert snapshot(copy.world, "world") == snapshot(stream.world, "world")


def test_the_small_streams_hold_every_case():
    """Present and absent readings, ticks with all and with none, packets that came and that did not."""
    for stream in Harness("any", make("dead-reckoning"), seed=0).streams:
        assert not stream.air.link[:, :, range(stream.robots), range(stream.robots)].any()
        if stream.robots > 1:
            off = stream.air.link[..., ~np.eye(stream.robots, dtype=bool)]
            assert 0.5 < off.mean() < 0.9
        for channel in ("anchor_rssi", "landmark"):
            there = np.isfinite(getattr(stream.senses, channel))
            if there.size:
                assert 0.2 < there.mean() < 0.95
                assert there[:, 0].any()
                assert not there[:, 4].any()


# ---------------------------------------------------------------- bits


def test_the_sign_of_a_zero_is_a_difference():
    _, stream = simulate("robots-1-3/n=1", ticks=2)
    harness = Harness("any", make("dead-reckoning"), seed=0)
    a = harness.run(stream, "")
    b = a._replace(trace=dataclasses.replace(a.trace, P=a.trace.P.copy()))
    require_equal(a, b, "nothing happened")
    b.trace.P[0, 1, 0, 0, 1] *= -1
    with pytest.raises(
        CheckFailed, match=r"robot 0's estimate changed by 0.0e.00, which is rounding, when this.*trial 0, tick 1"
    ):
        require_equal(a, b, "this")


def test_a_snapshot_shows_every_kind_of_change():
    def thing():
        return {
            "array": np.zeros(3),
            "objects": np.array([[1], "a"], dtype=object),
            "rng": np.random.default_rng(0),
            "nested": [(1, {2.0}), {"k": None}],
            "nan": float("nan"),
            "object": type("Box", (), {})(),
        }

    def seen(change):
        it = thing()
        it["object"].inside = 1
        before = snapshot(it, "it")
        change(it)
        after = snapshot(it, "it")
        return {path for path in {*before, *after} if before.get(path) != after.get(path)}

    assert seen(lambda t: None) == set()
    assert seen(lambda t: t["array"].__setitem__(1, -0.0)) == {"it['array']"}
    assert seen(lambda t: t["objects"][0].append(2)) == {"it['objects'][0][1]"}
    assert any("state" in path for path in seen(lambda t: t["rng"].normal()))
    assert seen(lambda t: t["nested"][0][1].add(3.0)) == {"it['nested'][0][1][1]"}
    assert seen(lambda t: setattr(t["object"], "inside", 2)) == {"it['object'].inside"}
    endless = []
    endless.append(endless)
    assert snapshot(endless, "it") == {"it": list}

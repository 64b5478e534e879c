"""Streams: immutable, hashed by what was sensed, and kept in a file that says what it is."""

import json
import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles import repeatable

from cooploc.estimators.errors import BadInput
from cooploc.estimators.models import Bearing, Displacement, GradientDoa, LogDistance, Range, Sighting, Unicycle
from cooploc.scenarios import simulate
from cooploc.scenarios.stream import FORMAT, Stream, find_fault

LABELS = ["trajectory", "packet-drop/drop=0.7", "camera", "robots-1-3/n=1"]


def short(label="trajectory", trials=3, **given):
    return simulate(label, trials=trials, seed=5, ticks=8, **given)[1]


def add_extra(stream):
    """A stream that also carries a plug-in's channels."""
    sonar = np.random.default_rng(0).normal(size=(*stream.senses.dt.shape, 2)).astype(np.float32)
    count = np.arange(stream.senses.dt.size).reshape(stream.senses.dt.shape)
    return replace(stream, senses=stream.senses._replace(extra={"sonar": sonar, "count": count}))


def same_bits(one, other):
    assert one.arrays().keys() == other.arrays().keys()
    for name, array in one.arrays().items():
        assert array.dtype == other.arrays()[name].dtype
        np.testing.assert_array_equal(array, other.arrays()[name], err_msg=name, strict=True)


def rewrite(path, change):
    """Change a file's header and arrays."""
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    header = json.loads(arrays.pop("header").tobytes())
    change(header, arrays)
    with path.open("wb") as file:
        np.savez_compressed(file, header=np.frombuffer(json.dumps(header).encode(), np.uint8), **arrays)
    return path


@pytest.mark.parametrize("label", LABELS)
def test_a_file_gives_back_every_bit_and_every_model_without_pickle(label, tmp_path):
    stream = add_extra(short(label, eta=1 / 3) if label != "camera" else short(label, sigma_v=1 / 3))
    stream.save(tmp_path / "stream.npz")
    loaded = Stream.load(tmp_path / "stream.npz")
    same_bits(loaded, stream)
    assert loaded.hashes == stream.hashes
    assert (loaded.scenario, loaded.seed, loaded.notes) == (stream.scenario, stream.seed, stream.notes)
    for name in ("trial", "time"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(stream, name))
    one, other = loaded.world, stream.world
    assert (one.robots, one.tick, one.t0, one.motion) == (other.robots, other.tick, other.t0, other.motion)
    assert list(one.sensors.items()) == list(other.sensors.items())
    for name in ("arena", "anchors", "landmarks"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    with np.load(tmp_path / "stream.npz", allow_pickle=False) as file:
        assert all(file[name].dtype.kind in "fbiu" for name in file.files)


@pytest.mark.parametrize("motion", [Displacement(0.1, 0.5), Unicycle(0.1, 0.2, 0.05)])
def test_every_model_survives_a_file(motion, tmp_path):
    rssi = LogDistance(-31.5, 1.4, 4.4)
    models = [rssi, Range(0.3), Bearing(0.1), Sighting(0.2, 0.01), GradientDoa(rssi, (1.0, 2.0), (3.0, 4.0))]
    sensors = {type(model).__name__: model for model in models}
    stream = short()
    replace(stream, world=replace(stream.world, motion=motion, sensors=sensors, t0=12.5)).save(tmp_path / "s.npz")
    world = Stream.load(tmp_path / "s.npz").world
    assert (world.motion, world.sensors, world.t0) == (motion, sensors, 12.5)


@pytest.mark.parametrize("name", ["prior.x", "senses.odometry", "senses.anchor_rssi", "air.link"])
def test_a_file_with_one_entry_changed_is_refused(name, tmp_path):
    short().save(tmp_path / "s.npz")

    def change(header, arrays):
        flat = arrays[name].reshape(-1)
        at = np.flatnonzero(np.isfinite(flat))[-1]
        flat[at] = not flat[at] if flat.dtype == bool else np.nextafter(flat[at], 9)

    with pytest.raises(ValueError, match=r"trial 2 .*hash differs"):
        Stream.load(rewrite(tmp_path / "s.npz", change))


def test_what_is_no_stream_is_refused_by_name(tmp_path):
    text, table, gone = tmp_path / "notes.txt", tmp_path / "table.npz", tmp_path / "gone.npz"
    text.write_text("not a stream")
    np.savez(table, x=np.zeros(3))
    for path in (text, table, gone):
        with pytest.raises(BadInput, match=path.name):
            Stream.load(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda header, arrays: header.update(format=FORMAT + 1), f"format {FORMAT + 1}.*update"),
        (lambda header, arrays: header["motion"].update(model="Hovercraft"), "Hovercraft"),
        (lambda header, arrays: header["hashes"].pop(), r"s\.npz"),
        (lambda header, arrays: header.pop("motion"), r"s\.npz"),
        (lambda header, arrays: arrays.pop("air.link"), r"s\.npz"),
    ],
)
def test_a_file_that_is_incomplete_or_newer_is_refused_with_a_remedy(change, words, tmp_path):
    short().save(tmp_path / "s.npz")
    with pytest.raises(BadInput, match=words):
        Stream.load(rewrite(tmp_path / "s.npz", change))


def test_a_model_that_cannot_be_described_is_refused_when_saving(tmp_path):
    @dataclass(frozen=True)
    class Range:  # the name of a known one, but not it
        sigma: float = 0.1

    stream = short()
    stream = replace(stream, world=replace(stream.world, sensors={"radio_range": Range()}))
    with pytest.raises(BadInput, match="Range"):
        stream.save(tmp_path / "s.npz")
    assert not list(tmp_path.iterdir())


def test_arrays_are_read_only(tmp_path):
    stream = add_extra(short())
    stream.save(tmp_path / "s.npz")
    for s in (stream, Stream.load(tmp_path / "s.npz"), stream.select(slice(1, 2))):
        of_world = {name: getattr(s.world, name) for name in ("arena", "anchors", "landmarks")}
        for name, array in (s.arrays() | of_world).items():
            assert not array.flags.writeable, name


@pytest.mark.parametrize("label", LABELS)
def test_parts_keep_their_bits_and_hashes(label):
    truth, stream = simulate(label, trials=5, seed=5, ticks=8)
    stream = add_extra(stream)
    for which in (slice(0, 2), slice(4, 5), [3, 1]):
        part = stream.select(which)
        assert part.hashes == tuple(np.array(stream.hashes)[which])
        assert all(np.array_equal(a, stream.arrays()[name][which], equal_nan=True) for name, a in part.arrays().items())
        for one, whole in ((part.trial, stream.trial), (truth.select(which).x, truth.x)):
            np.testing.assert_array_equal(one, whole[which])
        assert truth.select(which).origin == tuple(np.array(truth.origin)[which])


@pytest.mark.parametrize("label", ["trajectory", "camera"])
def test_one_changed_entry_changes_the_hash_of_its_trial_alone(label):
    stream = short(label)
    for name, array in stream.arrays().items():
        if array[1].size:
            flat = (array := array.copy())[1].reshape(-1)
            flat[1] = not flat[1] if flat.dtype == bool else np.nextafter(np.nan_to_num(flat[1]), 9)
            changed = stream.replace_arrays({name: array})
            assert [a == b for a, b in zip(stream.hashes, changed.hashes, strict=True)] == [True, False, True], name
            assert changed.hash != stream.hash


def test_a_hash_is_of_readings_and_names_and_shapes_and_not_of_the_world_or_memory_layout():
    stream = add_extra(short())
    world = replace(stream.world, motion=Displacement(9.0), anchors=stream.world.anchors + 1, sensors={})
    assert replace(stream, world=world, notes={"other": 1}, scenario="other").hashes == stream.hashes
    for change in (np.asfortranarray, lambda a: a.astype(a.dtype.newbyteorder(">"))):
        assert stream.replace_arrays({k: change(a) for k, a in stream.arrays().items()}).hashes == stream.hashes
    sonar = stream.senses.extra["sonar"]
    for extra in ({"radar": sonar}, {"sonar": sonar[..., None]}, {"sonar": sonar.astype(float)}):
        assert replace(stream, senses=stream.senses._replace(extra=extra)).hashes[0] != stream.hashes[0]


@given(st.integers(1, 2**51 - 1), st.booleans())
@repeatable
def test_one_nan_is_as_absent_as_another(payload, negative):
    bits = np.uint64(0x7FF8000000000000 + payload + (negative << 63))
    array = ABSENT.air.range.copy()
    array[np.isnan(array)] = bits.view(np.float64)
    assert array.tobytes() != ABSENT.air.range.tobytes()
    assert ABSENT.replace_arrays({"air.range": array}).hashes == ABSENT.hashes


ABSENT = short(trials=1)


def test_an_array_that_a_stream_does_not_have_is_refused_and_not_left_out():
    with pytest.raises(BadInput, match=r"a stream has no array 'odometry'; did you mean 'senses\.odometry'"):
        ABSENT.replace_arrays({"odometry": 0.0})


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("senses.odometry", lambda a: a[..., :1], "has shape"),
        ("senses.odometry", lambda a: a[0], "has shape"),
        ("senses.anchor_rssi", lambda a: a[..., :3], "width 0 in axis 3 where the channel does not exist"),
        ("senses.dt", lambda a: a[:, :-1], "has shape"),
        ("air.rssi", lambda a: a[:, :, :1], "has shape"),
        ("air.link", lambda a: a.astype(float), r"holds float64; write \.astype\(bool\)"),
        ("prior.P", lambda a: a[..., 0], "has shape"),
        ("prior.x", lambda a: a.astype(np.float32), r"holds float32; write \.astype\(float\)"),
        ("senses.landmark", lambda a: a.tolist(), "is of type list: give a numpy array"),
        ("extra.gps", lambda _: np.zeros(3), "has shape"),
    ],
)
def test_arrays_of_another_shape_or_type_are_refused(name, change, said):
    with pytest.raises(BadInput, match=f"^stream of .*: {name.replace('.', '[.]')} .*{said}"):
        ABSENT.replace_arrays({name: change(ABSENT.arrays().get(name))})


def test_a_sighting_has_as_many_numbers_as_its_sensor():
    camera = short("camera")
    bearings = {f"senses.{name}": getattr(camera.senses, name)[..., 1:] for name in ("landmark", "sighting")}
    with pytest.raises(BadInput, match=r"senses\.landmark has shape"):
        camera.replace_arrays(bearings)
    own = replace(camera.world, sensors=dict.fromkeys(("landmark", "sighting"), Bearing()))
    senses = camera.senses._replace(**{name.removeprefix("senses."): a for name, a in bearings.items()})
    assert replace(camera, world=own, senses=senses).channels() == camera.channels()


def test_a_channel_of_width_0_does_not_exist():
    nothing = {name: ABSENT.arrays()[name][:, :, :, :0] for name in ("senses.anchor_rssi", "air.rssi", "air.range")}
    assert ABSENT.replace_arrays(nothing).channels() == ABSENT.channels() - {"anchor_rssi", "radio_rssi", "radio_range"}
    with pytest.raises(BadInput, match=r"air\.link has shape"):
        ABSENT.replace_arrays({"air.link": ABSENT.air.link[..., :0]})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda truth, s: (replace(truth, x=truth.x[:, 1:], valid=truth.valid[:, 1:]), s),
            "its truth is 3 trials of 3 ticks, 3 robots, and its stream 3 trials of 4 ticks, 3 robots",
        ),
        (lambda truth, s: (truth, replace(s, time=s.time[::-1])), "its times do not increase"),
        (lambda truth, s: (truth, s.replace_arrays({"senses.dt": s.senses.dt * np.nan})), "senses.dt is negative or"),
        (lambda truth, s: (truth, s.replace_arrays({"prior.P": -s.prior.P})), "a covariance that is not positive"),
        (lambda truth, s: (truth, s.replace_arrays({"air.range": s.air.range / 0})), "air.range is infinite somewhere"),
        (lambda truth, s: (truth, replace(s, trial=s.trial + 1)), r"its stream is of trials \[1, 2, 3\], and simulate"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_what_a_scenario_cannot_have_simulated_is_said(change, said):
    truth, stream = simulate("trajectory", trials=3, ticks=4)
    assert find_fault(truth, stream, range(3)) == ""
    with pytest.raises(
        BadInput, match=r"has x \(3, 4, 3, 2\), valid \(3, 3, 3\) and 3 numbers of trials; they must be"
    ):
        replace(truth, valid=truth.valid[:, 1:])
    with pytest.raises(BadInput, match=r"holds float64; write \.astype\(bool\)"):
        replace(truth, valid=truth.valid.astype(float))
    assert re.search(said, find_fault(*change(truth, stream), range(3)))

"""Streams: immutable, hashed by what was sensed, and kept in a file that says what it is."""

import json
import zipfile
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles import repeatable

from cooploc.estimators.errors import BadInput
from cooploc.estimators.models import Bearing, Displacement, GradientDoa, LogDistance, Range, Sighting, Unicycle
from cooploc.scenarios import simulate
from cooploc.scenarios.stream import FORMAT, Stream

LABELS = ["trajectory", "packet-drop/drop=0.7", "camera", "robots-1-3/n=1"]


def short(label="trajectory", trials=3, **given):
    return simulate(label, trials=trials, seed=5, ticks=8, **given)[1]


def with_extra(stream):
    """A stream that also carries a plug-in's channels."""
    sonar = np.random.default_rng(0).normal(size=(*stream.senses.dt.shape, 2)).astype(np.float32)
    count = np.arange(stream.senses.dt.size).reshape(stream.senses.dt.shape)
    return replace(stream, senses=stream.senses._replace(extra={"sonar": sonar, "count": count}))


def same_bits(one, other):
    assert one.arrays().keys() == other.arrays().keys()
    for name, array in one.arrays().items():
        twin = other.arrays()[name]
        assert (array.dtype, array.shape) == (twin.dtype, twin.shape)
        np.testing.assert_array_equal(array, twin, err_msg=name)


def rewritten(path, change):
    """The same file with its header and arrays changed."""
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    header = json.loads(arrays.pop("header").tobytes())
    change(header, arrays)
    header = np.frombuffer(json.dumps(header).encode(), np.uint8)
    with path.open("wb") as file:
        np.savez_compressed(file, header=header, **arrays)
    return path


# ---------------------------------------------------------------- files


@pytest.mark.parametrize("label", LABELS)
def test_a_file_gives_back_every_bit_and_every_model(label, tmp_path):
    stream = with_extra(short(label, eta=1 / 3) if label != "camera" else short(label, sigma_v=1 / 3))
    stream.save(tmp_path / "stream.npz")
    loaded = Stream.load(tmp_path / "stream.npz")
    same_bits(loaded, stream)
    assert loaded.hash == stream.hash
    assert loaded.hashes == stream.hashes
    assert (loaded.scenario, loaded.seed, loaded.notes) == (stream.scenario, stream.seed, stream.notes)
    for name in ("trial", "time"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(stream, name))
    one, other = loaded.world, stream.world
    assert (one.robots, one.tick, one.t0, one.motion) == (other.robots, other.tick, other.t0, other.motion)
    assert list(one.sensors.items()) == list(other.sensors.items())
    for name in ("arena", "anchors", "landmarks"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize(
    "model",
    [
        LogDistance(-31.5, 1.4, 4.4),
        Range(0.3),
        Bearing(0.1),
        Sighting(0.2, 0.01),
        GradientDoa(LogDistance(-31.5, 1.4, 4.4), (1.0, 2.0), (3.0, 4.0)),
    ],
)
@pytest.mark.parametrize("motion", [Displacement(0.1, 0.5), Unicycle(0.1, 0.2, 0.05)])
def test_every_model_survives_a_file(model, motion, tmp_path):
    stream = short()
    stream = replace(stream, world=replace(stream.world, motion=motion, sensors={"some": model}, t0=12.5))
    stream.save(tmp_path / "s.npz")
    world = Stream.load(tmp_path / "s.npz").world
    assert world.motion == motion
    assert world.sensors["some"] == model
    assert world.t0 == 12.5


def test_a_file_needs_no_pickle_and_describes_itself(tmp_path):
    short().save(tmp_path / "s.npz")
    with np.load(tmp_path / "s.npz", allow_pickle=False) as file:
        assert all(file[name].dtype.kind in "fbiu" for name in file.files)
        header = json.loads(file["header"].tobytes())
    assert header["format"] == FORMAT
    assert header["sensors"]["anchor_rssi"]["model"] == "LogDistance"
    assert "nan is absent" in header["what"]
    assert zipfile.ZipFile(tmp_path / "s.npz").testzip() is None


@pytest.mark.parametrize(
    "name", ["prior.x", "prior.P", "senses.odometry", "senses.dt", "senses.anchor_rssi", "air.link", "air.range"]
)
def test_a_file_with_one_entry_changed_is_refused(name, tmp_path):
    short().save(tmp_path / "s.npz")

    def change(header, arrays):
        flat = arrays[name].reshape(-1)
        at = np.flatnonzero(np.isfinite(flat))[-1]
        flat[at] = not flat[at] if flat.dtype == bool else np.nextafter(flat[at], 9)

    path = rewritten(tmp_path / "s.npz", change)
    with pytest.raises(ValueError, match=r"trial 2 .*hash differs"):
        Stream.load(path)


def test_a_file_with_one_byte_flipped_is_refused(tmp_path):
    path = tmp_path / "s.npz"
    short().save(path)
    whole = bytearray(path.read_bytes())
    for at in range(200, len(whole) - 2000, len(whole) // 7):
        broken = whole.copy()
        broken[at] ^= 0x40
        path.write_bytes(broken)
        try:
            loaded = Stream.load(path)
        except ValueError:
            continue
        assert loaded.hash == short().hash  # a byte of the zip's own bookkeeping


def test_what_is_no_stream_is_refused_by_name(tmp_path):
    text, table, gone = tmp_path / "notes.txt", tmp_path / "table.npz", tmp_path / "gone.npz"
    text.write_text("not a stream")
    np.savez(table, x=np.zeros(3))
    for path in (text, table, gone):
        with pytest.raises(ValueError, match=path.name):
            Stream.load(path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda header, arrays: header.update(format=FORMAT + 1), f"format {FORMAT + 1}.*update"),
        (lambda header, arrays: header["motion"].update(model="Hovercraft"), "Hovercraft"),
        (lambda header, arrays: header["hashes"].pop(), r"s\.npz"),
        *((lambda header, arrays, name=name: arrays.pop(name), r"s\.npz") for name in ("air.link", "trial", "anchors")),
        *((lambda header, arrays, name=name: header.pop(name), r"s\.npz") for name in ("motion", "hashes", "robots")),
    ],
)
def test_a_file_that_is_incomplete_or_newer_is_refused_with_a_remedy(change, said, tmp_path):
    short().save(tmp_path / "s.npz")
    with pytest.raises(BadInput, match=said):
        Stream.load(rewritten(tmp_path / "s.npz", change))


def test_a_model_that_cannot_be_described_is_refused_when_saving(tmp_path):
    @dataclass(frozen=True)
    class Range:  # the name of a known one, but not it
        sigma: float = 0.1

    stream = short()
    stream = replace(stream, world=replace(stream.world, sensors={"radio_range": Range()}))
    with pytest.raises(ValueError, match="Range"):
        stream.save(tmp_path / "s.npz")
    assert not list(tmp_path.iterdir())


# ---------------------------------------------------------------- immutability


@pytest.mark.parametrize("label", LABELS)
def test_arrays_are_read_only(label, tmp_path):
    stream = with_extra(short(label))
    stream.save(tmp_path / "s.npz")
    for s in (stream, Stream.load(tmp_path / "s.npz"), stream.select(slice(1, 2))):
        told = {name: getattr(s.world, name) for name in ("arena", "anchors", "landmarks")}
        for name, array in (s.arrays() | told).items():
            assert not array.flags.writeable, name


# ---------------------------------------------------------------- selecting


@pytest.mark.parametrize("label", LABELS)
def test_parts_keep_their_bits_and_hashes(label):
    stream = with_extra(short(label, trials=5))
    for which in (slice(0, 2), slice(4, 5), [3, 1]):
        part = stream.select(which)
        assert part.hashes == tuple(np.array(stream.hashes)[which])
        same_bits(part, stream.map(lambda a, which=which: a[which]))
        np.testing.assert_array_equal(part.trial, stream.trial[which])


def test_truth_is_selected_like_its_stream():
    truth, stream = simulate("trajectory", trials=5, ticks=4)
    part = truth.select(slice(1, 3))
    assert part.origin == stream.select(slice(1, 3)).hashes
    np.testing.assert_array_equal(part.x, truth.x[1:3])
    np.testing.assert_array_equal(part.trial, [1, 2])


# ---------------------------------------------------------------- hashes


@pytest.mark.parametrize(
    ("label", "name"),
    [
        *(("trajectory", n) for n in ("prior.x", "prior.P", "senses.odometry", "senses.dt", "senses.anchor_rssi")),
        *(("trajectory", n) for n in ("air.link", "air.rssi", "air.range")),
        *(("camera", n) for n in ("senses.landmark", "senses.sighting")),
    ],
)
def test_one_changed_entry_changes_the_hash_of_its_trial_alone(label, name):
    stream = short(label)
    array = stream.arrays()[name].copy()
    flat = array[1].reshape(-1)
    flat[1] = not flat[1] if flat.dtype == bool else np.nextafter(np.nan_to_num(flat[1]), 9)
    changed = stream.replace_arrays({name: array})
    assert [a == b for a, b in zip(stream.hashes, changed.hashes, strict=True)] == [True, False, True]
    assert changed.hash != stream.hash


def test_what_the_team_is_told_does_not_enter_the_hash():
    stream = short()
    told = replace(stream.world, motion=Displacement(9.0), anchors=stream.world.anchors + 1, sensors={})
    assert replace(stream, world=told, notes={"other": 1}, scenario="other").hashes == stream.hashes


def test_the_hash_does_not_depend_on_memory_layout_or_byte_order():
    stream = with_extra(short())
    turned = stream.map(lambda a: np.asfortranarray(a))
    swapped = stream.map(lambda a: a.astype(a.dtype.newbyteorder(">")))
    assert swapped.senses.extra["count"].tobytes() != stream.senses.extra["count"].tobytes()
    assert turned.hashes == swapped.hashes == stream.hashes


def test_the_hash_tells_a_shape_and_a_name_apart():
    stream = with_extra(short())
    sonar = stream.senses.extra["sonar"]
    for extra in ({"radar": sonar}, {"sonar": sonar.reshape(*sonar.shape[:2], 2, 3)}, {"sonar": sonar.astype(float)}):
        assert replace(stream, senses=stream.senses._replace(extra=extra)).hashes[0] != stream.hashes[0]


@given(st.integers(1, 2**51 - 1), st.booleans())
@repeatable
def test_one_nan_is_as_absent_as_another(payload, negative):
    stream = ABSENT
    bits = np.uint64(0x7FF8000000000000 + payload + (negative << 63))
    array = stream.air.range.copy()
    array[np.isnan(array)] = bits.view(np.float64)
    assert array.tobytes() != stream.air.range.tobytes()
    assert stream.replace_arrays({"air.range": array}).hashes == stream.hashes


ABSENT = short(trials=1)

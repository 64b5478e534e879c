"""Stream files that came to harm, or that somebody made: the stream that was written, or one line."""

import io
import json
import zipfile

import numpy as np
import pytest
from attempts import attempted, cases, in_time
from damage import HARM, JSON, PLACES, changed, harmed
from hypothesis import given
from hypothesis import strategies as st

import cooploc as cl
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.sealed import seal
from cooploc.scenarios.stream import Stream

ODD = [
    np.zeros(0),
    np.zeros((2, 3, 3, 2)),
    np.ones((1,) * 20),
    np.array(1.0),
    np.array(["a"]),
    np.arange(3),
    np.full(9, 1e308),
]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A stream, its file, and what is in the file."""
    _, stream = cl.simulate("trajectory", trials=2, seed=1, ticks=3)
    file = tmp_path_factory.mktemp("streams") / "s.npz"
    stream.save(file)
    with np.load(file, allow_pickle=False) as arrays:
        return stream, file.read_bytes(), dict(arrays)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return tmp_path_factory.mktemp("harmed") / "s.npz"


@cases(350)
@given(HARM)
def test_a_harmed_stream_is_one_line_or_what_was_written(written, file, harm):
    stream, content, _ = written
    file.write_bytes(harmed(content, harm))
    loaded = attempted(Stream.load, file)
    if not isinstance(loaded, BadInput):
        assert loaded.hash == stream.hash
        assert repr(loaded.world) == repr(stream.world)
        assert (loaded.scenario, loaded.seed, loaded.notes) == (stream.scenario, stream.seed, json_of(stream.notes))


@cases(150)
@given(PLACES, JSON)
def test_a_header_that_says_anything_is_one_line(written, file, where, value):
    arrays = dict(written[2])
    header = changed(json.loads(arrays.pop("header").tobytes()), where, value)
    header = {key: v for key, v in header.items() if key != "checksum"} if isinstance(header, dict) else {}
    save(file, seal(header), arrays)
    loaded = attempted(Stream.load, file)
    if not isinstance(loaded, BadInput):
        attempted(cl.run, {"a": cl.make("dead-reckoning")}, loaded)


@cases(100)
@given(st.integers(0, 15), st.sampled_from(ODD))
def test_arrays_of_any_shape_are_one_line(written, file, which, odd):
    arrays = dict(written[2])
    header = json.loads(arrays.pop("header").tobytes())
    header = {key: v for key, v in header.items() if key not in ("checksum", "digests")}
    arrays[sorted(arrays)[which % len(arrays)]] = odd
    save(file, seal(header), arrays)
    assert isinstance(attempted(Stream.load, file), BadInput)


def json_of(notes):
    return json.loads(json.dumps(dict(notes)))


def save(file, header, arrays):
    encoded = np.frombuffer(json.dumps(header).encode(), np.uint8)
    with file.open("wb") as out:
        np.savez(out, header=encoded, **arrays)


def test_a_small_file_that_would_unpack_to_very_much_is_refused_at_once(written, file):
    head = io.BytesIO()
    np.lib.format.write_array_header_2_0(head, {"descr": "<f8", "fortran_order": False, "shape": (2**25 + 2**22,)})
    with (
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as out,
        out.open("time.npy", "w", force_zip64=True) as member,
    ):
        member.write(head.getvalue())
        for _ in range(8 * (2**25 + 2**22) >> 22):
            member.write(bytes(2**22))
    assert file.stat().st_size < 1.4e6
    with in_time(), pytest.raises(BadInput, match="would unpack to 3019"):
        Stream.load(file)


def test_an_array_larger_than_its_file_is_refused_at_once(written, file):
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(file, "w") as out:
        out.writestr("time.npy", head.getvalue())
    with in_time(), pytest.raises(BadInput, match="does not have the size that its shape"):
        Stream.load(file)

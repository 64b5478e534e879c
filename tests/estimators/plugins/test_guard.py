"""While an estimator is imported, made or runs, nothing leads to the truth; its own files may be read."""

import contextlib
import threading
from dataclasses import dataclass

import numpy as np
import pytest

import cooploc as cl
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.estimators.plugins.guard import Forbidden, forbid, shut
from cooploc.scenarios.seeds import Purpose, generator

WORLD = "robots-1-3/n=1[ticks=3]"


@pytest.fixture(scope="module")
def stream():
    return cl.simulate(WORLD, trials=2)[1]


@pytest.fixture
def recording(tmp_path):
    folder = tmp_path / "recording"
    folder.mkdir()
    (folder / "truth.dat").write_text("1 2 3")
    (folder / "helper.py").write_text("one = 1\n")
    (tmp_path / "weights.txt").write_text("0.5")
    forbid(folder)
    return folder


@dataclass(frozen=True)
class Does(DeadReckoning):
    """Calls something at every tick, and hides what it raises."""

    what: object = print

    def predict(self, s, z):
        with contextlib.suppress(Exception):
            self.what()
        return super().predict(s, z)


def run(what, stream):
    return cl.run({"mine": Does(what=what)}, stream, isolate=False)


def saved(stream, tmp_path):
    stream.save(tmp_path / "stream.npz")
    return lambda: cl.Stream.load(tmp_path / "stream.npz")


@pytest.mark.parametrize(
    ("what", "said"),
    [
        (lambda: cl.simulate(WORLD), r"simulated robots-1-3/n=1\[ticks=3\]"),
        (lambda: generator(0, 0, Purpose.TRUTH), "simulated the truth of trial 0"),
    ],
)
def test_simulating_is_refused_though_the_error_is_hidden(stream, what, said):
    with pytest.raises(cl.EstimatorError, match=rf"mine: predict\(\) {said}, which is refused .* cl\.training") as e:
        run(what, stream)
    assert "\n" not in str(e.value)


def test_reading_a_stream_is_refused(stream, tmp_path):
    with pytest.raises(cl.EstimatorError, match="read the stream"):
        run(saved(stream, tmp_path), stream)


@pytest.mark.parametrize("path", ["recording/truth.dat", "recording/../recording/truth.dat", "link.dat"])
@pytest.mark.parametrize("read", [open, np.loadtxt])
def test_the_files_of_a_recording_are_refused(stream, recording, tmp_path, path, read):
    (tmp_path / "link.dat").symlink_to(recording / "truth.dat")
    with pytest.raises(cl.EstimatorError, match="keep files of an estimator outside the folders of recordings"):
        run(lambda: read(tmp_path / path), stream)


def test_its_own_files_code_and_libraries_may_be_read(stream, recording, tmp_path):
    read = []

    def what():
        read.append(float((tmp_path / "weights.txt").read_text()))
        (recording / "helper.py").read_text()
        np.random.default_rng(1).normal()

    run(what, stream)
    assert read == [0.5] * 3


def test_outside_of_estimators_nothing_is_refused(recording):
    with shut:
        pass
    assert (recording / "truth.dat").read_text()
    cl.simulate(WORLD)


def test_another_thread_may_simulate_while_an_estimator_runs_here():
    done = []
    with shut:
        thread = threading.Thread(target=lambda: done.append(cl.simulate(WORLD)))
        thread.start()
        thread.join()
    assert len(done) == 1


def test_an_attempt_of_one_estimator_is_not_held_against_the_next(stream):
    with pytest.raises(cl.EstimatorError):
        run(lambda: cl.simulate(WORLD), stream)
    assert run(lambda: None, stream).traces


def test_an_attempt_inside_is_told_outside_too():
    with pytest.raises(Forbidden, match="simulated"), shut, contextlib.suppress(Forbidden), shut:
        cl.simulate(WORLD)


@pytest.mark.parametrize("hidden", [False, True])
def test_a_file_that_simulates_where_it_is_imported_is_refused(tmp_path, hidden):
    wish = "cl.simulate('nlos[ticks=2]')"
    lines = ["try:", f"    {wish}", "except Exception:", "    pass"] if hidden else [wish]
    (tmp_path / "mine.py").write_text(
        "import cooploc as cl\nfrom cooploc.estimators.dead_reckoning import DeadReckoning as Mine\n" + "\n".join(lines)
    )
    with pytest.raises(cl.BadInput, match=r"simulated nlos.* while an estimator is imported") as e:
        cl.make(f"{tmp_path}/mine.py:Mine")
    assert "\n" not in str(e.value)


@pytest.mark.slow
def test_in_its_own_process_a_plug_in_is_told_of_the_recordings_too(stream, recording, tmp_path):
    (tmp_path / "mine.py").write_text(
        "from pathlib import Path\n"
        "from cooploc.estimators.dead_reckoning import DeadReckoning\n"
        "class Reads(DeadReckoning):\n"
        "    name = 'weights.txt'\n"
        "    def predict(self, s, z):\n"
        f"        (Path({str(tmp_path)!r}) / self.name).read_text()\n"
        "        return super().predict(s, z)\n"
        "class Cheats(Reads):\n"
        "    name = 'recording/truth.dat'\n"
    )
    assert cl.run(f"{tmp_path}/mine.py:Reads", stream).traces
    with pytest.raises(cl.EstimatorError, match="outside the folders of recordings"):
        cl.run(f"{tmp_path}/mine.py:Cheats", stream)

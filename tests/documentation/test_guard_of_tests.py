"""The guard over tests: what one leaves changed is named, what a library fills in when first imported is not."""

import os
import random
import signal

import matplotlib
import numpy as np
import pytest
from unchanged import changes, look, own_draws

LEFT = {
    "os.environ changed: LEFT=1": lambda: os.environ.update(LEFT="1"),
    "the working directory changed: =/": lambda: os.chdir("/"),
    "numpy's error state changed: divide=raise": lambda: np.seterr(divide="raise"),
    "matplotlib's rcParams changed: lines.linewidth=7.0": lambda: matplotlib.rcParams.update({"lines.linewidth": 7.0}),
    "the signal handlers changed: SIGALRM=": lambda: signal.signal(signal.SIGALRM, signal.SIG_IGN),
}


@pytest.fixture
def put_back(monkeypatch):
    monkeypatch.setenv("LEFT", "0")
    monkeypatch.chdir(".")
    handler = signal.getsignal(signal.SIGALRM)
    with matplotlib.rc_context(), np.errstate():
        yield
    signal.signal(signal.SIGALRM, handler)


@pytest.mark.parametrize(("said", "leave"), LEFT.items(), ids=[said.split(" changed")[0] for said in LEFT])
def test_what_a_test_leaves_changed_is_named(put_back, said, leave):
    before = look()
    leave()
    lines = changes(before, look())
    assert len(lines) == 1
    assert lines[0].startswith(said)


def test_a_first_import_and_no_change_are_none():
    before = look()
    assert changes({**before, "matplotlib's rcParams": None}, look()) == []


@pytest.mark.parametrize("draw", [np.random.rand, random.random])
def test_draws_from_a_global_generator_are_the_same_for_everyone_and_leave_no_trace(draw):
    before = random.getstate(), np.random.get_state()[1].tolist()  # noqa: NPY002
    drawn = []
    for _ in range(2):
        with own_draws():
            drawn.append([draw(), draw()])
    assert drawn[0] == drawn[1]
    assert len(set(drawn[0])) == 2
    assert before == (random.getstate(), np.random.get_state()[1].tolist())  # noqa: NPY002

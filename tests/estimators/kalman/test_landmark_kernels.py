"""All of a tick's sightings of landmarks in one compiled loop, beside the same one landmark after the other."""

import numpy as np
import pytest

import cooploc as cl
from cooploc.estimators import ekf_interim, ekf_joint, ekf_split_ci
from cooploc.estimators.compiled import spread_out
from cooploc.scenarios.runner.trace import trace


@pytest.mark.parametrize("name", ["ekf-split-ci[form=conservative]", "ekf-joint[gate=3.0]", "ekf-interim"])
def test_landmarks_in_one_loop_change_no_bit(name, monkeypatch):
    _, stream = cl.simulate("camera/n=3", trials=2, seed=1, ticks=15)
    together = trace(name, cl.make(name), stream)
    for module in (ekf_interim, ekf_joint, ekf_split_ci):
        monkeypatch.setattr(module, "camera_alone", lambda *_: None)
    in_turn = trace(name, cl.make(name), stream)
    for what in ("x", "P", "messages", "bytes"):
        assert (getattr(together, what) == getattr(in_turn, what)).all()


def test_an_array_spread_out_is_broadcast_and_cannot_be_written():
    spread = spread_out(np.arange(3.0), (2, 4, 3))
    assert (spread == np.broadcast_to(np.arange(3.0), (2, 4, 3))).all()
    assert spread.flags.c_contiguous
    assert not spread.flags.writeable

"""What goes wrong when a team is recorded by hand: it is read all the same, for `cooploc inspect` to name."""

import numpy as np
import pytest
from made_team import describe, write

import cooploc as cl


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("glitches") / "lab"
    write(folder, seconds=20.0, hertz=20.0)
    return folder


def truths(change):
    """A change of both robots' (sec, nsec, x, y, yaw)."""

    def done(folder):
        for file in folder.glob("mocap_*.csv"):
            table = change(np.loadtxt(file, delimiter=",", skiprows=1))
            np.savetxt(file, table, fmt="%.9f", delimiter=",", header="sec,nsec,x,y,yaw", comments="")

    return done


def jumped(table):
    table[200:220, 2] += 3.0
    return table


def cut_off(folder):
    for file in folder.glob("*.csv"):
        file.write_bytes(file.read_bytes()[:-4])


GLITCHES = {
    "millimetres": truths(lambda t: t * [1, 1, 1000, 1000, 1]),
    "degrees": truths(lambda t: t * [1, 1, 1, 1, 180 / np.pi]),
    "swapped axes": truths(lambda t: t[:, [0, 1, 3, 2, 4]]),
    "shifted clock": truths(lambda t: t + np.eye(1, 5) * 2),
    "mirrored frame": truths(lambda t: t * [1, 1, 1, -1, -1]),
    "gap": truths(lambda t: np.delete(t, np.s_[250:300], axis=0)),
    "jump": truths(jumped),
    "truncated last line": cut_off,
}


@pytest.mark.parametrize("name", GLITCHES)
def test_it_is_read(sound, tmp_path, name):
    folder = tmp_path / "lab"
    describe(folder, ("seconds = 60.0", "seconds = 8.0"))
    for file in sound.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    GLITCHES[name](folder)
    truth, stream = cl.simulate("log/all", data=folder)
    assert np.isfinite(stream.senses.odometry).all()
    assert truth.valid.any()
    assert truth.valid.all() == (name != "gap")
    errors = cl.errors(truth, cl.run({"joint": cl.make("ekf-joint", anchor_reading="any")}, stream))
    assert np.isfinite(errors["mse"]).all()

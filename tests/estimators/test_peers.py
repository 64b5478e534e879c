"""Other people's filters in `benchmarks/peers/`, in `PerRobot`: the same numbers where they compute the same."""

from pathlib import Path

import numpy as np
import pytest

import cooploc as cl
from cooploc.scenarios.conformance import check_estimator
from cooploc.scenarios.runner.trace import trace
from cooploc.scenarios.variations import drop_readings

pytestmark = pytest.mark.filterwarnings("ignore")  # of the libraries, when they are imported
FOLDER = Path(__file__).resolve().parents[2] / "benchmarks" / "peers"
FILTERPY = "filterpy_filters.py"
SAME = (f"{FILTERPY}:Kalman", "jax_ekf.py:JaxEkf", "navlie_ekf.py:NavlieEkf", "stone_soup.py:StoneSoupEkf")
CLOSE = (
    *(f"{FILTERPY}:{name}" for name in ("Imm", "Ukf", "Ckf", "Enkf")),
    "gtsam_map.py:GtsamMap",
    "stone_soup.py:StoneSoupParticles",
)
WORLDS = ("robots-1-3/n=3", "camera/n=3")


def peer(name):
    """The plug-in; where its library is not installed, the test is skipped with that reason."""
    try:
        return cl.make(f"{FOLDER}/{name}")
    except cl.BadInput as e:
        if "ModuleNotFoundError" not in str(e):
            raise
        pytest.skip(str(e))


def both(name, label):
    """Its positions and ours on the same readings, some of which are absent."""
    _, stream = cl.simulate(label, trials=2, ticks=25, seed=3)
    stream = drop_readings(stream, np.random.default_rng(1))
    ours = trace("ours", cl.make("ekf-local", anchor_reading="rssi", gate=np.inf), stream)
    return trace("theirs", peer(name), stream), ours


@pytest.mark.parametrize("label", WORLDS)
@pytest.mark.parametrize("name", SAME)
def test_what_computes_the_same_agrees_to_rounding(name, label):
    theirs, ours = both(name, label)
    np.testing.assert_allclose(theirs.x[..., :2], ours.x[..., :2], atol=1e-10)
    np.testing.assert_allclose(theirs.P, ours.P, atol=1e-10)


@pytest.mark.parametrize("label", ["robots-1-3/n=1", "camera/n=1"])
def test_the_joint_unscented_filter_of_one_robot_is_filterpys(label):
    _, stream = cl.simulate(label, trials=2, ticks=25, seed=3)
    ours = cl.make("ukf-joint", anchor_reading="rssi", gate=np.inf, alpha=0.5)
    theirs, ours = trace("theirs", peer(f"{FILTERPY}:Ukf"), stream), trace("ours", ours, stream)
    np.testing.assert_allclose(theirs.x, ours.x, atol=1e-9)
    np.testing.assert_allclose(theirs.P, ours.P, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("label", WORLDS)
@pytest.mark.parametrize("name", CLOSE)
def test_other_approximations_stay_within_what_ours_says_of_itself(name, label):
    theirs, ours = both(name, label)
    sd = np.sqrt(np.trace(ours.P[..., :2, :2], axis1=-2, axis2=-1))
    away = np.sqrt(((theirs.x - ours.x)[..., :2] ** 2).sum(-1))
    assert 0 < (away / sd).mean() < 1


@pytest.mark.slow
def test_a_filter_of_filterpy_passes_every_check(short_streams):
    report = check_estimator(peer(SAME[0]), isolate=False)
    assert report.passed, report.table()
    assert all(result.status == "passed" for result in report.results)

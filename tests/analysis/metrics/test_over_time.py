"""Errors over time and against a swept parameter, and the band of a consistent filter."""

import numpy as np
import pandas as pd
import pytest

import cooploc as cl
from cooploc.analysis.metrics.consistency import band
from cooploc.analysis.metrics.curves import over_time, sweep, swept

LABEL = "robots-1-3/n=3[ticks=6]"


@pytest.fixture(scope="module")
def ran():
    truth, stream = cl.simulate(LABEL, trials=6, seed=1)
    return truth, cl.run({"ekf": cl.make("ekf-local")}, stream)


def test_the_curve_pools_to_the_table(ran):
    curve, table = over_time(*ran), cl.summarize(cl.errors(*ran))
    assert curve["tick"].tolist() == list(range(6))
    assert np.sqrt((curve["rmse"] ** 2).mean()) == pytest.approx(table["rmse"].item())
    assert curve["anees"].mean() == pytest.approx(table["anees"].item())
    assert (curve["rmse_low"] < curve["rmse"]).all()


def test_a_curve_of_another_stream_is_refused(ran):
    other, _ = cl.simulate(LABEL, trials=6, seed=2)
    with pytest.raises(cl.BadInput, match="different streams"):
        over_time(other, ran[1])


def test_the_band_holds_95_percent_of_consistent_filters():
    rng = np.random.default_rng(0)
    anees = (rng.normal(size=(4000, 20, 2)) ** 2).sum(-1).mean(-1) / 2
    low, high = band(20, 2)
    assert np.mean((low < anees) & (anees < high)) == pytest.approx(0.95, abs=0.012)
    assert np.isnan(band(0, 2)).all()


def test_a_label_says_what_is_swept():
    assert sweep("packet-drop/drop=0.7") == ("packet-drop", "drop", 0.7)
    assert sweep("scalability/n=3[drop=0.7]") == ("scalability[drop=0.7]", "n", 3.0)
    assert sweep("mrclam/all")[:2] == ("mrclam/all", "")
    table = swept(pd.DataFrame({"scenario": ["nlos", "nlos/n=3"]}))
    assert table["parameter"].tolist() == ["", "n"]
    assert np.isnan(table["value"][0])

"""What readings are worth, and what results depend on: cells and sweeps from labels, comparisons, floors."""

import numpy as np
import pandas as pd
import pytest
from made_errors import rows

from cooploc.analysis.metrics import run_tables as module
from cooploc.analysis.metrics.run_tables import MatrixCell, information, matrix_cell, sensitivity
from cooploc.analysis.metrics.sweeps import sweeps
from cooploc.scenarios.studies import study

MSE = np.random.default_rng(3).lognormal(-3, 0.3, (12, 3))


@pytest.mark.parametrize(
    ("estimator", "robots", "where"),
    [
        ("arl", 3, MatrixCell("doa", "none", "alone", "particles")),
        ("rssi-pf", 1, MatrixCell("rssi", "none", "alone", "particles")),
        ("mrsl-distance[anchor_reading=none]", 3, MatrixCell("none", "range", "product", "particles")),
        ("ctrn[reading=rssi]", 10, MatrixCell("doa", "rssi", "intersection", "particles")),
        ("ekf-ci[anchor_reading=gradient]", 3, MatrixCell("gradient", "range", "intersection", "Kalman")),
        ("ekf-joint[reading=rssi]", 3, MatrixCell("doa", "rssi", "centralised", "Kalman")),
        ("map-joint[reading=none]", 1, MatrixCell("rssi", "none", "bound", "MAP")),
        ("mrsl-rssi", 1, None),
        ("map-joint", 3, None),
        ("ekf-joint[anchor_reading=doa-constant]", 3, None),
        ("ekf-luft", 3, None),
    ],
)
def test_an_estimator_stands_where_its_readings_put_it(estimator, robots, where):
    assert matrix_cell(estimator, robots) == where


def test_the_shipped_study_fills_every_cell_and_no_cell_twice():
    cells = [
        (one.scenario, matrix_cell(label, 1 if one.scenario.endswith("=1") else 3))
        for one in study.load("information").cells()
        for label in one.estimators
    ]
    assert len(set(cells)) == len(cells) == 10 + 2 * 46
    assert all(where is not None for _, where in cells)


@pytest.fixture
def errors_of_cells():
    made = {"arl": 1.0, "ekf-local": 4.0, "mrsl-rssi": 0.25, "ekf-joint": 1.0, "ekf-joint[anchor_reading=rssi]": 1.0}
    return pd.concat([rows(name, factor * MSE, scenario="nlos") for name, factor in (made | {"ekf-luft": 1.0}).items()])


@pytest.mark.slow
def test_every_row_is_compared_with_its_own_filter_and_reading_alone(errors_of_cells):
    table = information(errors_of_cells, seed=1).set_index("estimator")
    assert list(table.index) == ["arl", "ekf-local", "mrsl-rssi", "ekf-joint", "ekf-joint[anchor_reading=rssi]"]
    assert table["change"].to_numpy() == pytest.approx([np.nan, np.nan, -0.5, -0.5, np.nan], nan_ok=True)
    assert table.loc["ekf-joint", ["change_low", "change_high"]].tolist() == pytest.approx([-0.5, -0.5])
    assert table["floor"].isna().all()  # things stand in the way there


def test_each_cell_has_the_floor_of_its_own_readings(errors_of_cells, monkeypatch):
    monkeypatch.setattr(module, "pooled_floor", lambda label, seed, channels: 2.0 ** len(channels))
    assert information(errors_of_cells, seed=1)["floor"].tolist() == [2.0, 2.0, 4.0, 4.0, 4.0]


def test_every_cell_of_the_shipped_study_sweeps_something_and_has_a_preset():
    cells = study.load("sensitivity").cells()
    points = sweeps(cell.scenario for cell in cells)
    for cell in cells:
        at = points[cell.scenario]
        for estimator, one in sweeps(cell.estimators).items():
            family = estimator if at.parameter else one.family
            assert np.isfinite(module.preset_value(at.parameter or one.parameter, at.family, family))


@pytest.mark.slow
def test_estimators_are_compared_at_the_same_value():
    made = [
        rows(name, factor * value * MSE, scenario=f"nlos[prior_sigma={value}]", stream=f"h{value}-")
        for value in (1, 4)
        for name, factor in (("arl", 1.0), ("mrsl-rssi", 0.25))
    ]
    made += [rows(f"{name}[particles={n}]", MSE, scenario="nlos") for n in (50, 90) for name in ("arl", "mrsl-rssi")]
    table = sensitivity(pd.concat([*made, rows("arl", MSE, scenario="nlos")]), seed=1)
    swept = [("prior_sigma", 1.0)] * 2 + [("prior_sigma", 4.0)] * 2
    swept += [("particles", 50.0)] * 2 + [("particles", 90.0)] * 2
    assert list(zip(table["parameter"], table["value"], strict=True)) == swept
    assert table["change"].to_numpy() == pytest.approx([0, -0.5, 0, -0.5, 0, 0, 0, 0])
    assert table["rmse"][2] == pytest.approx(2 * table["rmse"][0])
    assert table["preset"].tolist() == [0.5] * 4 + [200.0] * 4
    assert set(table["scenario"]) == {"nlos"}

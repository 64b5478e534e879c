"""The matrix of information: where an estimator stands, and that a row is compared with its own filter alone."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from made_errors import rows

import cooploc as cl
from cooploc.analysis.metrics import run_tables as module
from cooploc.analysis.metrics.run_tables import MatrixCell, information, matrix_cell
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
def errors():
    made = {"arl": 1.0, "ekf-local": 4.0, "mrsl-rssi": 0.25, "ekf-joint": 1.0, "ekf-joint[anchor_reading=rssi]": 1.0}
    yield pd.concat([rows(name, factor * MSE, scenario="nlos") for name, factor in (made | {"ekf-luft": 1.0}).items()])
    plt.close("all")


def test_every_row_is_compared_with_its_own_filter_and_reading_alone(errors):
    table = information(errors, seed=1).set_index("estimator")
    assert list(table.index) == ["arl", "ekf-local", "mrsl-rssi", "ekf-joint", "ekf-joint[anchor_reading=rssi]"]
    assert table["change"].to_numpy() == pytest.approx([np.nan, np.nan, -0.5, -0.5, np.nan], nan_ok=True)
    assert table.loc["ekf-joint", ["change_low", "change_high"]].tolist() == pytest.approx([-0.5, -0.5])
    assert table["floor"].isna().all()  # things stand in the way there


def test_each_cell_has_the_floor_of_its_own_readings(errors, monkeypatch):
    asked = []
    monkeypatch.setattr(module, "pooled_floor", lambda label, seed, channels: asked.append(channels) or 0.1)
    information(errors, seed=1)
    assert set(asked) == {
        ("anchor_doa",),
        ("anchor_doa", "radio_rssi"),
        ("anchor_doa", "radio_range"),
        ("anchor_rssi", "radio_range"),
    }


def test_the_figure_has_a_row_for_each_own_reading_and_every_error(errors):
    table = information(errors, seed=1).assign(floor=0.07)
    axes = cl.plot.information(table).figure.axes
    assert [ax.get_title(loc="left") for ax in axes] == ["own reading: direction of arrival", "own reading: raw RSSI"]
    drawn = [y for ax in axes for line in ax.lines if line.get_marker() != "None" for y in line.get_ydata()]
    assert sorted(y for y in drawn if np.isfinite(y)) == pytest.approx(sorted(table["rmse"]))
    floors = [line for ax in axes for line in ax.lines if list(line.get_ydata()) == [0.07, 0.07]]
    assert len(floors) == 4  # three cells in one row, one in the other


def test_a_run_without_cells_says_what_to_run():
    with pytest.raises(cl.BadInput, match="no estimator of this run has a cell"):
        information(rows("ekf-luft", MSE), seed=1)

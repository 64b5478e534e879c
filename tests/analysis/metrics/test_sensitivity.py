"""The table of sensitivity: what is swept is read from labels, and compared at the same value."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from made_errors import rows

import cooploc as cl
from cooploc.analysis.metrics.run_tables import Sweep, parse_sweep, preset_value, sensitivity
from cooploc.scenarios.studies import study

MSE = np.random.default_rng(4).lognormal(-3, 0.3, (8, 2))


@pytest.mark.parametrize(
    ("scenario", "estimator", "found"),
    [
        ("nlos[prior_sigma=2]", "arl", Sweep("nlos", "prior_sigma", 2.0, "arl")),
        ("nlos/n=3[assumed.eta=2.5]", "arl[K=1]", Sweep("nlos/n=3", "assumed.eta", 2.5, "arl[K=1]")),
        ("nlos", "arl[particles=50]", Sweep("nlos", "particles", 50.0, "arl")),
        ("nlos", "ctrn[weights=exact,particles=50]", Sweep("nlos", "particles", 50.0, "ctrn[weights=exact]")),
        ("nlos", "arl", None),
        ("nlos[ticks=9,eta=2]", "arl", None),
        ("nlos[body_blocking=true]", "arl", None),
    ],
)
def test_what_is_swept_is_read_from_the_labels(scenario, estimator, found):
    assert parse_sweep(scenario, estimator) == found


def test_every_cell_of_the_shipped_study_sweeps_something_and_has_a_preset():
    for cell in study.load("sensitivity").cells():
        for estimator in cell.estimators:
            assert np.isfinite(preset_value(parse_sweep(cell.scenario, estimator)))


@pytest.fixture
def errors():
    made = [
        rows(name, factor * value * MSE, scenario=f"nlos[prior_sigma={value}]", stream=f"h{value}-")
        for value in (1, 4)
        for name, factor in (("arl", 1.0), ("mrsl-rssi", 0.25))
    ]
    made += [rows(f"{name}[particles=50]", MSE, scenario="nlos") for name in ("arl", "mrsl-rssi")]
    yield pd.concat([*made, rows("arl", MSE, scenario="nlos")])
    plt.close("all")


def test_estimators_are_compared_at_the_same_value(errors):
    table = sensitivity(errors, seed=1)
    assert table[["parameter", "value"]].drop_duplicates().to_numpy().tolist() == [
        ["prior_sigma", 1.0],
        ["prior_sigma", 4.0],
        ["particles", 50.0],
    ]
    assert table["change"].to_numpy() == pytest.approx([0, -0.5, 0, -0.5, 0, 0])
    assert table["rmse"].to_numpy()[2] == pytest.approx(2 * table["rmse"].to_numpy()[0])
    assert table["preset"].tolist() == [0.5] * 4 + [200.0] * 2
    assert set(table["scenario"]) == {"nlos"}


def test_the_figure_has_a_panel_for_each_parameter_on_one_scale(errors):
    axes = cl.plot.sensitivity(sensitivity(errors, seed=1)).figure.axes
    assert [ax.get_xlabel() for ax in axes] == ["sd of the prior position [m]", "particles"]
    assert axes[0].get_ylim() == axes[1].get_ylim()
    assert [label.get_text() for label in axes[0].get_xticklabels()] == ["1", "4"]


def test_a_run_that_sweeps_nothing_says_what_to_run():
    with pytest.raises(cl.BadInput, match="nothing is swept here"):
        sensitivity(rows("arl", MSE, scenario="nlos"), seed=1)

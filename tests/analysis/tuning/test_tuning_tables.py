"""Figures of a tuning show what its numbers say."""

import numpy as np
import pandas as pd
import pytest

from cooploc.analysis.plot import tuned_parameters, tuning
from cooploc.estimators.errors import BadInput

HISTORY = pd.DataFrame(
    {
        "estimator": "a",
        "state": ["finished", "finished", "stopped", "stopped"],
        "spent": [10, 20, 24, 28],
        "gain": [0.0, 1.0, -1.0, -2.0],
        "best": [True, True, False, False],
        "value: gate": [9.0, 3.0, 30.0, 2000.0],
        "value: mode": ["x", "y", "x", "x"],
        "value: absent": np.nan,
    }
)


def test_the_figure_of_the_budget_ends_where_the_budget_does():
    step = tuning(HISTORY).lines[0]
    assert (list(step.get_xdata()), list(step.get_ydata())) == ([10, 20, 28], [0.0, 1.0, 1.0])


def test_the_figure_of_parameters_has_a_panel_for_each_and_refuses_what_has_none():
    shown = [ax.get_xlabel() for ax in tuned_parameters(HISTORY, "a").figure.axes if ax.get_visible()]
    assert shown == ["gate", "mode"]
    with pytest.raises(BadInput, match="there is no estimator"):
        tuned_parameters(HISTORY, "z")
    with pytest.raises(BadInput, match="no parameter that may be tuned"):
        tuned_parameters(HISTORY.drop(columns=["value: gate", "value: mode"]), "a")

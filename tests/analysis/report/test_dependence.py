"""What results depend on is said as the numbers have it: who varies most and least, who wins, loses, or neither."""

import numpy as np
import pandas as pd
import pytest

from cooploc.analysis.report.sentences import dependence_sentences

ERRORS = {"arl": (0.2, 0.4), "better": (0.1, 0.15), "mixed": (0.1, 0.9), "worse": (0.5, 0.6), "same": (0.2, 0.41)}
CHANGES = {"arl": (0, 0), "better": (-0.5, -0.6), "mixed": (-0.5, 1.2), "worse": (1.5, 0.5), "same": (0, 0.02)}


def rows(*names):
    """Made rows of two values; intervals of changes are 0.1 wide to either side."""
    made = [(name, v, ERRORS[name][k], CHANGES[name][k]) for name in names for k, v in enumerate((10.0, 20.0))]
    table = pd.DataFrame(made, columns=["estimator", "value", "rmse", "change"]).assign(parameter="ticks")
    ends = {"rmse_low": table["rmse"] - 0.01, "rmse_high": table["rmse"] + 0.01}
    return table.assign(**ends, change_low=table["change"] - 0.1, change_high=table["change"] + 0.1)


def test_every_outcome_is_said():
    ((parameter, said),) = dependence_sentences(rows(*ERRORS))
    assert parameter == "ticks"
    assert said == (
        "mixed depends on it most, with 0.100 m (0.090 to 0.110) at 10 and 0.900 m (0.890 to 0.910) at 20; "
        "worse least, with 0.500 m (0.490 to 0.510) at 10 and 0.600 m (0.590 to 0.610) at 20. "
        "By paired intervals, better beats arl at all 2 values; "
        "mixed beats arl at 1 of 2 values and loses to it at 1 of 2 values; "
        "worse loses to arl at all 2 values; same neither beats arl nor loses to it at any of 2 values."
    )


@pytest.mark.parametrize(
    ("names", "said"), [(["arl"], "Only arl was run."), (["worse"], "worse loses to arl at all 2")]
)
def test_one_estimator_alone_has_nobody_to_be_most_or_least(names, said):
    ((_, text),) = dependence_sentences(rows(*names))
    assert text.startswith("Fewer than two estimators were run.")
    assert said in text


def test_without_intervals_nobody_wins():
    table = rows("arl", "better").assign(change_low=np.nan, change_high=np.nan, rmse_low=np.nan, rmse_high=np.nan)
    ((_, said),) = dependence_sentences(table)
    assert "better neither beats arl nor loses to it" in said
    assert "0.100 m at 10" in said

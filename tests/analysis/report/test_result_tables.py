"""The tables of a run's results: their order."""

import pandas as pd
import pytest

from cooploc.analysis.report.result_tables import in_order
from cooploc.estimators.errors import BadInput

TABLE = pd.DataFrame(
    {"scenario": list("bbaa"), "estimator": list("wxyz"), "rmse": [0.3, 0.2, float("nan"), 0.1], "bytes": [0, 8, 1, 2]}
)


@pytest.mark.parametrize(("by", "order"), [("rmse", "xwzy"), ("bytes", "wxyz"), ("study", "wxyz")])
def test_rows_of_a_scenario_are_in_order_and_scenarios_stay(by, order):
    assert "".join(in_order(TABLE, by)["estimator"]) == order


def test_an_unknown_column_is_refused():
    with pytest.raises(BadInput, match=r"--sort is 'rms'; did you mean 'rmse'\?"):
        in_order(TABLE, "rms")

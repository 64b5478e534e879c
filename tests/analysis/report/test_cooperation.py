"""What cooperation buys is said as the numbers have it: a gain, a loss, neither, nothing at all, false certainty."""

import pandas as pd
import pytest

from cooploc.analysis.metrics.run_tables import INFORMATION_COLUMNS
from cooploc.analysis.report.sentences import cooperation_sentences, effect, heading

ROWS = (
    # own, between, robots, fusion, filter, rmse, floor, anees, consistency, change, change_low, change_high
    ("doa", "none", 1, "alone", "particles", 0.25, 0.2, 1.0, "consistent", None, None, None),
    ("doa", "none", 3, "alone", "particles", 0.25, 0.2, 1.0, "consistent", None, None, None),
    ("doa", "none", 3, "alone", "Kalman", 0.30, 0.2, 1.0, "consistent", None, None, None),
    ("doa", "rssi", 3, "product", "particles", 0.20, 0.15, 4.0, "over-confident", -0.2, -0.25, -0.15),
    ("doa", "range", 3, "product", "particles", 0.27, 0.1, 9.5, "over-confident", 0.08, 0.02, 0.15),
    ("doa", "rssi", 3, "intersection", "Kalman", 0.29, 0.15, 1.0, "consistent", -0.03, -0.1, 0.04),
    ("none", "range", 3, "intersection", "Kalman", 0.29, float("nan"), 1.0, "consistent", 0.0, 0.0, 0.0),
)


@pytest.fixture
def table():
    names = [*("own", "between", "robots", "fusion", "filter", "rmse", "floor", "anees", "consistency")]
    frame = pd.DataFrame(ROWS, columns=[*names, "change", "change_low", "change_high"])
    return frame.assign(trials=40).reindex(columns=list(INFORMATION_COLUMNS)).infer_objects()


def test_every_row_of_a_team_is_said_with_its_numbers(table):
    (own, robots, said), (other, _, nothing) = cooperation_sentences(table)
    assert (own, robots, other) == ("doa", 3, "none")
    assert said == [
        "Alone they err by 0.250 m with particles and 0.300 m with a Kalman filter. "
        "The floor, 0.200 m alone, changes by -25 % by RSSI and -50 % by ranges.",
        "The product of beliefs takes 20 % off the error by RSSI (-25 % to -15 %) and adds 8.0 % to the error by "
        "ranges (+2.0 % to +15 %), but is over-confident (RSSI: ANEES 4.00 and ranges: ANEES 9.50).",
        "Covariance intersection of Kalman filters makes no difference that 40 trials show by RSSI (-10 % to +4.0 %).",
    ]
    assert nothing == [
        "None of them was run alone.",
        "Covariance intersection of Kalman filters leaves the error as it is by ranges.",
    ]
    assert heading(own, robots) == "3 robots with the direction of arrival"


def test_a_few_trials_have_no_interval_and_claim_nothing():
    row = {"change": -0.5, "change_low": float("nan"), "change_high": float("nan"), "between": "rssi", "trials": 3}
    assert effect(row) == "changes the error by -50 % by RSSI (no interval)"

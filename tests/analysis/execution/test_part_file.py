"""Parts as they are read: in order, checked, and put together as pandas would."""

import numpy as np
import pandas as pd
import pytest

from cooploc.analysis.execution.run_directory import AT_ONCE, read_part, together
from cooploc.analysis.metrics.errors import COLUMNS
from cooploc.estimators.errors import BadInput

TEXT = {"scenario": "here", "estimator": "mine", "stream": "a1", "senses": "odometry"}
TRIALS, ROBOTS = range(3, 5), 2


def rows(**changes):
    """Four rows of two trials and two robots."""
    frame = pd.DataFrame({name: [TEXT.get(name, 0.5)] * 4 for name in COLUMNS if name != "seconds"})
    kept = {"trial": [3, 3, 4, 4], "robot": [0, 1, 0, 1], "robots": 2, "centralised": False, "bound": False}
    return frame.assign(**kept, failure=pd.Series([None] * 4, dtype="str"), traceback=None).assign(**changes)


def stored(tmp_path, frame):
    frame.to_parquet(tmp_path / "part.parquet", index=False)
    return tmp_path / "part.parquet"


def part(tmp_path, frame):
    return read_part(stored(tmp_path, frame), "here", "mine", TRIALS)


def test_a_part_is_what_was_written(tmp_path):
    pd.testing.assert_frame_equal(together([part(tmp_path, rows())]), rows(), check_exact=True)


def test_rows_come_by_trial_and_robot(tmp_path):
    mixed = rows(mse=[1.0, 2.0, 3.0, 4.0]).iloc[[3, 0, 2, 1]]
    assert together([part(tmp_path, mixed)])["mse"].tolist() == [1.0, 2.0, 3.0, 4.0]


def test_many_parts_are_put_together_as_pandas_would(tmp_path):
    frames = [rows(mse=float(i)) for i in range(AT_ONCE + 3)]
    frames[1] = rows().assign(**{"note: fusions": [1.0, 2.0, np.nan, 4.0]})
    frames[AT_ONCE] = rows(mse=None, stream=None, failure="it fails", traceback="where")
    found = together(part(tmp_path, frame) for frame in frames)
    kinds = {"mse": float, "stream": "str", "traceback": "str"}
    wanted = pd.concat([frame.astype(kinds) for frame in frames], ignore_index=True)
    pd.testing.assert_frame_equal(found, wanted, check_exact=True)


def test_seconds_that_stand_in_the_file_do_not_count(tmp_path):
    assert "seconds" not in part(tmp_path, rows(seconds=1.0)).column_names


def test_a_note_may_be_yes_or_no_in_one_part_and_a_number_in_another(tmp_path):
    some = part(tmp_path, rows(**{"note: late": [True, False, True, False]}))
    more = part(tmp_path, rows(**{"note: late": [0.5, 2.0, 0.0, 1.0]}))
    assert together([some, more])["note: late"].tolist() == [1.0, 0.0, 1.0, 0.0, 0.5, 2.0, 0.0, 1.0]


def test_parts_that_do_not_fit_together_are_one_line(tmp_path):
    numbers, flags = rows(extra=1.0), rows(extra=[True, False, True, False])
    with pytest.raises(BadInput, match=r"do not fit together .*bool.*: remove"):
        together([part(tmp_path, numbers), part(tmp_path, flags)])


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"robot": 0}, "a robot is in a trial twice"),
        ({"trial": [3, 3, 5, 5]}, "its trials are not 3 to 4"),
        ({"trial": [3.0, 3.0, 4.0, 4.0]}, "its column 'trial' is double"),
        ({"robot": [0, 1, 0, None]}, "its column 'robot' is double"),
        ({"scenario": "there"}, "its scenario is not 'here'"),
        ({"estimator": ["mine", "mine", "mine", "yours"]}, "its estimator is not 'mine'"),
        ({"estimator": ["mine", "mine", "mine", None]}, "its estimator is not 'mine'"),
        ({"stream": ["a1", None, "a1", "a1"]}, "a stream has no hash"),
        ({"stream": 1}, "its column 'stream' is int64"),
        ({"mse": "low"}, "its column 'mse' is"),
        ({"bound": [True, False, None, None]}, "its column 'bound' is bool"),
        ({"mse": [b"1", b"2", b"3", b"4"]}, "its column 'mse' is binary"),
    ],
)
def test_what_is_not_a_part_is_refused(tmp_path, changes, why):
    with pytest.raises(BadInput, match="is not a part of this run") as refused:
        part(tmp_path, rows(**changes))
    assert why in str(refused.value)


def test_a_part_without_a_column_is_refused(tmp_path):
    with pytest.raises(BadInput, match="it has no column 'mse'"):
        part(tmp_path, rows().drop(columns="mse"))

"""The rows of a part, checked as they are read: types, labels, trials, size."""

from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.parquet as pq

from cooploc.analysis.metrics.errors import COLUMNS
from cooploc.estimators.plugins.errors import BadInput

FAILURE = ("failure", "traceback")
TEXT = ("scenario", "estimator", "stream", "senses", *FAILURE)
WHOLE = ("trial", "robot", "robots")
FLAGS = ("centralised", "bound")
MOST_ROWS, MOST_BYTES = 10_000_000, 2**30  # of one part; a chunk is some hundred rows


def read_rows(file: Path, scenario: str, estimator: str, trials: range) -> pd.DataFrame:
    """The rows of these trials of a scenario and an estimator, without `seconds`.

    Raises:
        BadInput: the file does not hold them.

    """
    try:
        with pq.ParquetFile(file) as part:
            described = part.metadata
            size = sum(described.row_group(i).total_byte_size for i in range(described.num_row_groups))
            if described.num_rows > MOST_ROWS or size > MOST_BYTES:
                raise ValueError(f"{described.num_rows} rows and {size} bytes, more than any part has")
            frame: pd.DataFrame = part.read(use_threads=False).to_pandas()  # small: threads take longer to start
        if "centralised" not in frame and "bound" in frame:  # of an earlier version
            frame = frame.assign(centralised=frame["bound"])
        _demand_columns(frame)
        _demand_rows(frame, scenario, estimator, trials)
    except OSError as e:
        if e.filename is None:  # pyarrow's word for a file that is not parquet
            raise _not_a_part(file, e) from None
        raise
    except (ValueError, TypeError, KeyError, IndexError, OverflowError, NotImplementedError) as e:
        raise _not_a_part(file, e) from None
    return frame


def failures(file: Path) -> pd.DataFrame:
    """`trial` and `failure` of the trials of a part that failed."""
    frame = pd.read_parquet(file, columns=["trial", "failure"])
    return frame[frame["failure"].notna()].drop_duplicates("trial")


def _demand_columns(frame: pd.DataFrame) -> None:
    missing = [name for name in (*COLUMNS, *FAILURE) if name not in frame and name != "seconds"]
    if missing:
        raise ValueError(f"it has no column {missing[0]!r}")
    for name in map(str, frame):
        if not _fits(frame[name], name):
            raise ValueError(f"its column {name!r} is {frame[name].dtype}")


def _fits(column: "pd.Series[Any]", name: str) -> bool:
    if name in TEXT:
        return column.dtype == "str" or all(isinstance(value, str) for value in column.dropna().unique())
    kinds = {**dict.fromkeys(WHOLE, "iu"), **dict.fromkeys(FLAGS, "b")}.get(name, "fiub")
    absent = column.dtype == object and bool(column.isna().all())  # of a part where every trial failed
    return absent or column.dtype.kind in kinds


def _demand_rows(frame: pd.DataFrame, scenario: str, estimator: str, trials: range) -> None:
    for name, label in (("scenario", scenario), ("estimator", estimator)):
        if not (frame[name] == label).all():
            raise ValueError(f"its {name} is not {label!r}")
    if set(frame["trial"]) != set(trials):
        raise ValueError(f"its trials are not {trials.start} to {trials.stop - 1}")
    if frame.duplicated(["trial", "robot"]).any():
        raise ValueError("a robot is in a trial twice")
    if frame.loc[frame["failure"].isna(), "stream"].isna().any():
        raise ValueError("a stream has no hash")


def _not_a_part(file: Path, why: Exception) -> BadInput:
    reason = " ".join(str(why).split())[:200]
    return BadInput(f"{file} is not a part of this run ({reason}): remove it, and cooploc run computes it again")

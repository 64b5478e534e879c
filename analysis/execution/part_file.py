"""The rows of a part, checked as they are read: types, labels, trials, size."""

from collections.abc import Iterable
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from cooploc.analysis.metrics.errors import COLUMNS, NOTE
from cooploc.estimators.errors import BadInput

FAILURE = ("failure", "traceback")
TEXT = ("scenario", "estimator", "stream", "senses", *FAILURE)
WHOLE = ("trial", "robot", "robots")
FLAGS = ("centralised", "bound")
MOST_ROWS, MOST_BYTES = 10_000_000, 2**30  # of one part; a chunk is some hundred rows
AT_ONCE = 200  # parts


def read_part(file: Path, scenario: str, estimator: str, trials: range) -> pa.Table:
    """The rows of these trials of a scenario and an estimator, by trial and robot, without `seconds`.

    Raises:
        BadInput: the file does not hold them.

    """
    try:
        with pq.ParquetFile(file) as part:
            described = part.metadata
            size = sum(described.row_group(i).total_byte_size for i in range(described.num_row_groups))
            if described.num_rows > MOST_ROWS or size > MOST_BYTES:
                raise ValueError(f"{described.num_rows} rows and {size} bytes, more than any part has")
            table = part.read(use_threads=False)  # small: threads take longer to start
        if "centralised" not in table.column_names and "bound" in table.column_names:  # of an earlier version
            table = table.append_column("centralised", table["bound"])
        _demand_columns(table)
        return _plain(_demand_rows(table, scenario, estimator, trials))
    except OSError as e:
        if e.filename is None:  # pyarrow's word for a file that is not parquet
            raise _not_a_part(file, e) from None
        raise
    except (ValueError, TypeError, KeyError, IndexError, OverflowError, NotImplementedError) as e:
        raise _not_a_part(file, e) from None


def together(parts: Iterable[pa.Table]) -> pd.DataFrame:
    """The rows of parts, one after the other; nan where one has not the columns of another.

    They stay pyarrow's until they are all there: frames of twelve thousand parts take minutes, and twice the memory.

    Raises:
        BadInput: a column is of another kind in another part.

    """
    joined, remaining = [], iter(parts)
    try:
        while some := list(islice(remaining, AT_ONCE)):  # a part's description takes more memory than its rows
            joined.append(_joined(some).combine_chunks())
        table = _joined(joined).unify_dictionaries()
    except pa.ArrowException as e:
        reason = " ".join(str(e).split())[:200]
        raise BadInput(
            f"parts do not fit together ({reason}): remove those of one estimator, and run it again"
        ) from None
    del joined, some
    frame: pd.DataFrame = table.to_pandas(self_destruct=True, split_blocks=True)
    return frame.astype({name: "str" for name, kind in frame.dtypes.items() if kind == "category"})


def _joined(parts: list[pa.Table]) -> pa.Table:
    return pa.concat_tables(parts, promote_options="permissive").replace_schema_metadata()


def failures(file: Path) -> pd.DataFrame:
    """`trial` and `failure` of the trials of a part that failed."""
    frame = pd.read_parquet(file, columns=["trial", "failure"])
    return frame[frame["failure"].notna()].drop_duplicates("trial")


def _demand_columns(table: pa.Table) -> None:
    columns = dict(zip(table.column_names, table.columns, strict=True))
    missing = [name for name in (*COLUMNS, *FAILURE) if name not in columns and name != "seconds"]
    if missing:
        raise ValueError(f"it has no column {missing[0]!r}")
    if len(columns) < table.num_columns:
        raise ValueError("it has a column twice")
    for name, column in columns.items():
        if not _fits(column, name):
            raise ValueError(f"its column {name!r} is {column.type}")


def _fits(column: pa.ChunkedArray, name: str) -> bool:
    kind, whole = column.type, not column.null_count
    if pa.types.is_null(kind):  # of a part where every trial failed
        return name not in WHOLE
    if name in TEXT:
        return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))
    if name in WHOLE:
        return bool(pa.types.is_integer(kind) and whole)
    if name in FLAGS or pa.types.is_boolean(kind):
        return bool(pa.types.is_boolean(kind) and whole)
    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind))


def _demand_rows(table: pa.Table, scenario: str, estimator: str, trials: range) -> pa.Table:
    """The table by trial and robot, where it holds what it should."""
    for name, label in (("scenario", scenario), ("estimator", estimator)):
        if pc.unique(table[name]).to_pylist() != [label]:
            raise ValueError(f"its {name} is not {label!r}")
    trial, robot = (table[name].to_numpy() for name in ("trial", "robot"))
    order = np.lexsort((robot, trial))
    trial, robot = trial[order], robot[order]
    if not np.array_equal(np.unique(trial), trials):
        raise ValueError(f"its trials are not {trials.start} to {trials.stop - 1}")
    if ((np.diff(trial) == 0) & (np.diff(robot) == 0)).any():
        raise ValueError("a robot is in a trial twice")
    if pc.any(pc.and_(table["failure"].is_null(), table["stream"].is_null())).as_py():
        raise ValueError("a stream has no hash")
    return table if (np.diff(order) > 0).all() else table.take(order)


def _plain(table: pa.Table) -> pa.Table:
    """With every text once, for one stands in a thousand rows; a note that says yes or no as 1 or 0, as others do."""
    for i, name in enumerate(table.column_names):
        kind = table[name].type
        if name in TEXT and not pa.types.is_null(kind):
            table = table.set_column(i, name, table[name].dictionary_encode())
        elif name.startswith(NOTE) and pa.types.is_boolean(kind):
            table = table.set_column(i, name, table[name].cast(pa.float64()))
    return table.drop_columns(["seconds"]) if "seconds" in table.column_names else table


def _not_a_part(file: Path, why: Exception) -> BadInput:
    reason = " ".join(str(why).split())[:200]
    return BadInput(f"{file} is not a part of this run ({reason}): remove it, and cooploc run computes it again")

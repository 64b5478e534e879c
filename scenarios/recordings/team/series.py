"""A series of one robot, put into order."""

from collections.abc import Callable

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.team.team_log import Series
from cooploc.scenarios.recordings.text_tables import MAX_STEP_BACK


def in_order(time: Array, values: Array, source: str, where: Callable[[int], str]) -> tuple[Series, list[str]]:
    """A series whose stamps rise, and what was left out: lines without a number, and repeated stamps.

    Args:
        time: (m,) [s] as recorded; steps back of up to `MAX_STEP_BACK` are sorted.
        values: (m, k); of the first two columns both must be there, a nan elsewhere is kept.
        source: file or topic.
        where: the place of a row, for an error.

    Raises:
        BadInput: a stamp is missing, or steps back by more.

    """
    if np.isnan(time).any():
        raise BadInput(f"{where(int(np.argmax(np.isnan(time))))}: the stamp is missing; correct or remove the line")
    late = np.maximum.accumulate(time) - time if len(time) else time
    if (late > MAX_STEP_BACK).any():
        row = int(np.argmax(late > MAX_STEP_BACK))
        raise BadInput(f"{where(row)}: its time is {late[row]:.3f} s before an earlier line's; sort the file by time")
    order = np.argsort(time, kind="stable")
    time, values = time[order], values[order]
    there = np.isfinite(values[:, :2]).all(-1)
    time, values = time[there], values[there]
    first = np.append(True, np.diff(time) > 0)[: len(time)]
    reasons = {"lines without a number": int((~there).sum()), "lines that repeat a stamp": int((~first).sum())}
    warnings = [f"{source}: {count} {what} were left out" for what, count in reasons.items() if count]
    return Series(time[first], values[first], source), warnings

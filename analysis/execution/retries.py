"""Which failures may be gone when the same trial runs again.

One of the estimator itself happens again, as every trial is bit-identical. A lost process, a full memory or disk does
not have to; nor does a time limit that has grown since.
"""

import re
from typing import Literal

Retry = Literal["all", "lost"]  # every failure, or those of which nothing says that they happen again

LIMIT = re.compile(r"\btime limit of ([0-9.]+(?:e[+-]?[0-9]+)?) s\b")
FULL = r"\w*MemoryError\b|OSError: \[Errno (?:5|12|27|28|122)\]"  # I/O, memory, file size, disk, quota
LOST = re.compile(rf"the process that ran it|{FULL}")


def worth_it(failure: str, time_limit: float, retry: Retry = "lost") -> bool:
    """Whether a trial that failed for this reason is to run again under this time limit [s]."""
    if retry == "all" or LOST.match(failure):
        return True
    limit = LIMIT.search(failure)
    return limit is not None and float(f"{time_limit:g}") > float(limit[1])

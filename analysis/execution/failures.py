"""What a trial's code may raise without ending more than its trial, and how a failure is told."""

import traceback
from pathlib import Path

from cooploc.estimators.errors import one_line
from cooploc.scenarios.processes.time_limit import TimeLimit

# In a worker, which Ctrl-C does not reach, anything.
Caught = tuple[type[BaseException], ...]
HERE: Caught = Exception, SystemExit, GeneratorExit, TimeLimit
THERE: Caught = (*HERE, KeyboardInterrupt)


def line_of(e: BaseException) -> str:
    """What a trial's code raised, and where, in one line."""
    places = [one for one in traceback.extract_tb(e.__traceback__) if Path(one.filename).name != "time_limit.py"]
    place = places[-1]  # for one that hung, where it did
    return f"{one_line(e)} ({Path(place.filename).name}:{place.lineno})"


def full_text(e: BaseException) -> str:
    """The whole traceback of what a trial's code raised."""
    return "".join(traceback.format_exception(e))

"""What a call in another process came to: its value, or what it raised, as plain data that always travels.

An exception of a plug-in's own class is sent as text: to rebuild it here would run the plug-in's code here.
"""

import pickle
import traceback
from typing import NamedTuple

from cooploc.estimators.errors import one_line


class WorkerError(RuntimeError):
    """Code in a process of its own failed: it raised, or its process did not outlive it."""


class ProcessDied(WorkerError):
    """The process crashed, was killed, or left."""


class ProcessHung(WorkerError):
    """The process took longer than it may, and was ended."""


class Raised(NamedTuple):
    """An exception in words, and itself where its class is Python's or ours."""

    line: str
    traceback: str
    pickled: bytes  # empty for others

    @classmethod
    def of(cls, e: BaseException) -> "Raised":
        """What was raised, for the journey."""
        return cls(one_line(e), "".join(traceback.format_exception(e)), _pickled(e))

    def error(self) -> Exception:
        """What is raised here in its place, with the other process's traceback as its cause."""
        error: Exception = pickle.loads(self.pickled) if self.pickled else WorkerError(self.line)
        error.__cause__ = _OtherTraceback(self.traceback)
        return error


class Outcome(NamedTuple):
    """What a call came to."""

    value: bytes  # pickled where it was made; empty where there is none
    raised: Raised | None
    printed: str  # on its stdout


class _OtherTraceback(Exception):
    """Shows the traceback of another process."""

    def __str__(self) -> str:
        return f"\n{self.args[0]}"


def _pickled(e: BaseException) -> bytes:
    """Empty where it must stay where it is: a foreign class, or one that would end this process too."""
    module = type(e).__module__
    if not isinstance(e, Exception) or not (module == "builtins" or module.startswith("cooploc.")):
        return b""
    try:
        found = pickle.dumps(e)
        pickle.loads(found)
    except Exception:
        return b""
    return found

"""While an estimator's code runs, nothing leads to the truth: no simulating, no stream's file, no file of a recording.

Python calls an audit hook (PEP 578) at every `open`, and where this program simulates or reads a stream. Between
`with shut:` and its end the hook refuses these, and remembers that it did: an estimator that suppresses the error is
found out at the end. Code and libraries may always be read. Files that native code opens are not seen.
"""

import os
import sys
import threading
from functools import cache
from pathlib import Path
from typing import Any

SIMULATED, LOADED = "cooploc.simulate", "cooploc.load"  # audit events of ours, each with what it is about
CODE = (".py", ".pyc", ".so", ".nbi", ".nbc", ".pth")
SYSTEM = (sys.prefix, sys.base_prefix, "/proc/", "/sys/", "/dev/", "/etc/")
WHY = "which is refused while an estimator is imported, made or runs"
TRAIN = "train before, in a script of its own, on what cl.training gives"
APART = (
    "keep files of an estimator outside the folders of recordings (--data), which hold the truth, and of certificates"
)


class Forbidden(RuntimeError):
    """An estimator asked for what leads to the truth; the message says for what, and what to do instead."""


_folders: set[str] = set()  # of recordings


class Shut(threading.local):
    """`with shut:` around an estimator's code, for this thread; it may be entered again inside."""

    def __init__(self) -> None:
        self._tried: list[str] = []
        self._marks: list[int] = []  # how many attempts there were at each entry

    def __enter__(self) -> None:
        _listen()
        self._marks.append(len(self._tried))

    def __exit__(self, *_: object) -> None:
        mark = self._marks.pop()
        if len(self._tried) > mark:
            said = self._tried[mark]
            if not self._marks:
                self._tried.clear()
            raise Forbidden(said) from None

    def heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Refuse an audit event that leads to the truth.

        Raises:
            Forbidden: it does.

        """
        if not self._marks:
            return
        if event == "open":
            said = self._opened(arguments[0])
        elif event == SIMULATED:
            said = f"simulated {arguments[0]}, {WHY}: {TRAIN}"
        elif event == LOADED:
            said = f"read the stream {arguments[0]}, {WHY}: {TRAIN}"
        else:
            return
        if said:
            self._tried.append(said)
            raise Forbidden(said)

    def _opened(self, path: object) -> str:
        if not (_folders and isinstance(path, str | bytes)) or of_program(path):
            return ""
        found = os.path.realpath(os.fsdecode(path))
        inside = found.startswith(tuple(_folders))
        return f"opened {os.fsdecode(path)}, {WHY}: {APART}" if inside else ""


shut = Shut()


def forbid(*folders: str | Path) -> None:
    """Let no estimator of this process open what is in these folders."""
    _folders.update(os.path.join(os.path.realpath(folder), "") for folder in folders)


def forbidden() -> tuple[str, ...]:
    """The folders that no estimator may open files of, to be told to another process."""
    return tuple(sorted(_folders))


def of_program(path: str | bytes) -> bool:
    """Whether a file is code, a library's, or a device, which any code may open."""
    found = os.path.abspath(os.fsdecode(path))
    return found.startswith(SYSTEM) or found.endswith(CODE)


@cache
def _listen() -> None:
    """An audit hook cannot be removed; it does nothing while nothing is shut."""
    sys.addaudithook(shut.heard)

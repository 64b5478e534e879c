"""Processor time of an estimator's own work: what else the machine does, and compilation, do not count."""

from collections.abc import Iterator
from contextlib import contextmanager
from time import process_time
from types import TracebackType
from typing import Any, Self

from numba.core import event

COMPILING = "numba:compiler_lock"  # numba's event around compiling a kernel, or reading it from disk


class Stopwatch(event.Listener):
    """Seconds of this process's processor time between `with` and its end, without pauses and compilation."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._began = 0.0
        self._stopped = 0  # how often: one kernel compiles the kernels that it calls

    def __enter__(self) -> Self:
        event.register(COMPILING, self)
        self._began = process_time()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        event.unregister(COMPILING, self)
        self.seconds += process_time() - self._began

    @contextmanager
    def paused(self) -> Iterator[None]:
        """What happens meanwhile does not count."""
        self.on_start(None)
        try:
            yield
        finally:
            self.on_end(None)

    def on_start(self, event: Any) -> None:
        if self._stopped == 0:
            self.seconds += process_time() - self._began
        self._stopped += 1

    def on_end(self, event: Any) -> None:
        self._stopped -= 1
        if self._stopped == 0:
            self._began = process_time()

"""Of two processes of the tests that need a kernel, the second waits for the first, and finds it on disk."""

from filelock import FileLock
from numba.core.dispatcher import Dispatcher

compile_at_once = Dispatcher.compile


def compile_in_turn(self, signature):
    place = self._cache.cache_path  # None: this function is not kept
    if place is None:
        return compile_at_once(self, signature)
    with FileLock(f"{place}/{self.py_func.__name__}.lock", is_singleton=True):
        return compile_at_once(self, signature)


def take_turns():
    Dispatcher.compile = compile_in_turn

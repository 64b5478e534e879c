"""What a test, and a file of tests, must leave as it was found: so no test can depend on those before it.

A look takes less than a tenth of a millisecond. Modules may be imported, and caches filled: these change no result.
Filters of warnings need no look, as pytest puts them back; nor sys.path and the generators, as conftest.py does.
"""

import logging
import os
import random
import signal
import sys
from contextlib import contextmanager

import numpy as np

from cooploc import estimators, scenarios

SIGNALS = signal.SIGINT, signal.SIGTERM, signal.SIGALRM
PASSING = "PYTEST_CURRENT_TEST", "KMP_DUPLICATE_LIB_OK", "KMP_INIT_AT_FORK"  # of pytest; of imported libraries
CHOSEN = {"backend", "backend_fallback"}  # of rcParams: pyplot fills them in when it is first imported


def look():
    """What is global, by name; each entry by its own name, or its number in a list."""
    return {
        "os.environ": {name: value for name, value in os.environ.items() if name not in PASSING},
        "the working directory": {"": os.getcwd()},
        "sys.argv": dict(enumerate(sys.argv)),
        "numpy's error state": np.geterr(),
        "matplotlib's rcParams": _rc_params(),
        "the loggers": _loggers(),
        "the signal handlers": {one.name: signal.getsignal(one) for one in SIGNALS},
        "the built-in estimators": dict(estimators.BUILTIN),
        "the built-in scenarios": dict(scenarios.BUILTIN),
    }


def changes(before, after):
    """A line for everything that is not as it was; what was first imported in between has no entry before."""
    lines = []
    for what, was in before.items():
        now = after[what]
        if was is not None and now != was:
            new = [f"{name}={now.get(name)}" for name in {**was, **now} if was.get(name, what) != now.get(name, what)]
            lines.append(f"{what} changed: {', '.join(new)}")
    return lines


def _rc_params():
    if not (matplotlib := sys.modules.get("matplotlib")):
        return None
    return {name: value for name, value in dict.items(matplotlib.rcParams) if name not in CHOSEN}


def _loggers():
    """The handlers and levels of the root and of our own, where there are any."""
    ours = [name for name in logging.root.manager.loggerDict if name.split(".")[0] == "cooploc"]
    found = [logging.root, *map(logging.getLogger, ours)]
    states = {one.name: (_added(one), one.level, one.disabled) for one in found}
    return {name: state for name, state in states.items() if any(state)}


def _added(logger):
    """Its handlers, without those of pytest, which come and go."""
    return [handler for handler in logger.handlers if not type(handler).__module__.startswith("_pytest")]


@contextmanager
def own_draws():
    """Numpy's and Python's global generators begin the same for everyone, and are put back."""
    states = np.random.get_state(), random.getstate()  # noqa: NPY002
    np.random.seed(0)  # noqa: NPY002, TID251
    random.seed(0)
    try:
        yield
    finally:
        np.random.set_state(states[0])  # noqa: NPY002
        random.setstate(states[1])

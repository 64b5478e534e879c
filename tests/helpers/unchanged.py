"""What a test, and a file of tests, must leave as it was found: so no test can depend on those before it.

Filters of warnings are put back by pytest, sys.path by conftest.py; what modules cache changes no result.
"""

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
    """Return what is global, by name; each entry by its own name."""
    matplotlib = sys.modules.get("matplotlib")
    parameters = dict.items(matplotlib.rcParams) if matplotlib else ()
    return {
        "os.environ": {name: value for name, value in os.environ.items() if name not in PASSING},
        "the working directory": {"": os.getcwd()},
        "numpy's error state": np.geterr(),
        "matplotlib's rcParams": {name: value for name, value in parameters if name not in CHOSEN} or None,
        "the signal handlers": {one.name: signal.getsignal(one) for one in SIGNALS},
        "the built-in estimators": dict(estimators.BUILTIN),
        "the built-in scenarios": dict(scenarios.BUILTIN),
    }


def changes(before, after):
    """Return a line for everything that is not as it was; what was first imported in between was None before."""
    lines = []
    for what, was in before.items():
        now = after[what]
        if was is not None and now != was:
            new = [f"{name}={now.get(name)}" for name in {**was, **now} if was.get(name, what) != now.get(name, what)]
            lines.append(f"{what} changed: {', '.join(new)}")
    return lines


@contextmanager
def own_draws():
    """Let numpy's and Python's global generators begin the same for every test, and put them back."""
    states = np.random.get_state(), random.getstate()  # noqa: NPY002
    np.random.seed(0)  # noqa: NPY002, TID251
    random.seed(0)
    try:
        yield
    finally:
        np.random.set_state(states[0])  # noqa: NPY002
        random.setstate(states[1])

"""Estimators that cheat or err in ways which small streams do not show: accidents and cheap deceptions, by kind.

Each is an honest filter with one fault. `test_cheats.py` and `reports/truth.md` say what catches it.
"""

from types import ModuleType
from typing import Any

import counting

from cheats import declaring, learning, replacing, rows, seeding, spying, watching

KINDS: tuple[ModuleType, ...] = counting, rows, learning, seeding, declaring, watching, spying, replacing


def label(name: str) -> str:
    """The cheat as a plug-in: `path.py:Name`."""
    return f"{_home(name).__file__}:{name}"


def cheat(name: str) -> Any:
    """Its class."""
    return getattr(_home(name), name)


def _home(name: str) -> ModuleType:
    return next(kind for kind in KINDS if getattr(getattr(kind, name, None), "__module__", "") == kind.__name__)

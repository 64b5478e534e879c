"""What is tuned of a configured estimator: the parameters that its class declares, but for those that its label states.

`mrsl-rssi[K=1]` keeps K=1, whatever is tried of the others. Values have four significant digits, so that a label says
exactly what was run.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from cooploc.estimators import configure, make
from cooploc.estimators.plugins.build import ConfiguredEstimator
from cooploc.estimators.plugins.errors import BadInput
from cooploc.estimators.plugins.tunable import Tunable, Value, declared
from cooploc.scenarios.processes.outcome import WorkerError
from cooploc.scenarios.processes.workers import call

DIGITS = 4  # significant ones of a number that is tried
LIMIT = 600.0  # [s] to import what is not built in


@dataclass(frozen=True)
class Space:
    """An estimator as published, and what may be tried instead."""

    published: ConfiguredEstimator
    parameters: Mapping[str, Tunable]

    def label(self, values: Mapping[str, Value]) -> str:
        """The label of a configuration; that of the published one where nothing differs from it."""
        changed = {key: value for key, value in values.items() if value != self.parameters[key].default}
        if not changed:
            return self.published.label
        written = {**self.published.parameters, **{key: _written(value) for key, value in sorted(changed.items())}}
        return f"{self.published.name}[{','.join(f'{key}={value}' for key, value in written.items())}]"


def space_of(label: str, isolate: bool = True) -> Space:
    """The space of a label; with `isolate`, what is not built in is imported by a process of its own.

    Raises:
        BadInput: it cannot be made.

    """
    one = configure(label)
    if one.builtin or not isolate:
        return Space(one, _declared(label))
    try:
        return Space(one, call(one.name, _declared, label, seconds=LIMIT))
    except WorkerError as e:
        raise BadInput(f"{label!r} cannot be imported or made: {e}") from None


def rounded(value: float) -> float:
    """A number with the digits that a label shows."""
    return float(f"{value:.{DIGITS}g}")


def _declared(label: str) -> dict[str, Tunable]:
    stated = configure(label).parameters
    return {name: one for name, one in declared(make(label)).items() if name not in stated}


def _written(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)

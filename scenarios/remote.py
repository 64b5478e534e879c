"""A scenario that is not built in, as other processes describe it: here it is neither imported nor simulated."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.processes.outcome import WorkerError
from cooploc.scenarios.processes.workers import call, end
from cooploc.scenarios.stream import Stream, Truth


@dataclass(frozen=True)
class RemoteScenario:
    """What a study must know of a scenario in advance, as plain data; it is simulated where `simulate` is called."""

    label: str
    name: str  # of the family
    recorded: bool
    robots: int
    ticks: int
    data: Path | None
    count: int  # trials of a recording
    settings: dict[str, Any]  # every parameter of the model, as JSON

    def trials(self, asked: int) -> int:
        """How many trials a study gets that asks for so many; a recording has a number of its own."""
        return self.count if self.recorded else asked

    def simulate(self, trials: int | Sequence[int], seed: int) -> tuple[Truth, Stream]:
        """Truth and stream of some trials; imports the scenario, so call it in a process of its own.

        Raises:
            BadInput: as `scenarios.simulate`.

        """
        from cooploc.scenarios import resolve

        return resolve(self.label, self.data).simulate(trials, seed)


def described(label: str, data: Path | None, seconds: float = 600.0) -> RemoteScenario:
    """The description of a scenario, made by a process of its own.

    Raises:
        BadInput: as `scenarios.resolve`; or the process died, or took longer than `seconds`.

    """
    owner = f"describe {label}"
    try:
        found: RemoteScenario = call(owner, _described, label, data, seconds=seconds)
    except WorkerError as e:
        raise BadInput(f"the scenario {label!r} cannot be used: {e}") from None
    finally:
        end(owner)
    return found


def _described(label: str, data: Path | None) -> RemoteScenario:
    from cooploc.scenarios import resolve

    found = resolve(label, data)
    size = found.robots, found.ticks
    return RemoteScenario(label, found.name, found.recorded, *size, found.data, found.trials(1), found.settings)

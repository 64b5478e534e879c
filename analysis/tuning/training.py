"""The streams that estimators are tuned on, which never meet those that results are reported of.

Simulated streams come from a seed of their own, a hash of the study's seed that does not lead back to it. A recording
has no seed: the study says in `training` on which other recordings, or other parts of one, it is tuned, and a part that
overlaps with what is judged is refused.
"""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cooploc.analysis.tuning.race import Item
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios import resolve, resolve_isolated
from cooploc.scenarios.processes.workers import call, end
from cooploc.scenarios.remote import RemoteScenario
from cooploc.scenarios.scenario import ResolvedScenario
from cooploc.scenarios.stream import Stream
from cooploc.scenarios.studies.study import ResolvedCell

Resolved = ResolvedScenario | RemoteScenario
LIMIT = 600.0  # [s] to read a recording that is not built in


def derived_seed(seed: int, purpose: str) -> int:
    """A seed below 2^63 that does not lead back to `seed`, and differs from it."""
    for attempt in range(100):
        text = f"{seed}/{purpose}/{attempt}".encode()
        found = int.from_bytes(hashlib.blake2b(text, digest_size=8, person=b"cooploc tuning").digest(), "little") >> 1
        if found != seed:
            return found
    raise AssertionError("a hash gave the same number a hundred times")


@dataclass(frozen=True)
class TrainingLane:
    """The training trials that stand for one judged scenario: its scenarios in turn."""

    judged: str
    scenarios: tuple[Resolved, ...]

    def item(self, number: int) -> Item:
        """The trial of a round; recordings that are used up come again."""
        one = self.scenarios[number % len(self.scenarios)]
        trial = number // len(self.scenarios)
        return Item(one.label, trial % one.trials(1) if one.recorded else trial)


def lanes(
    cells: Iterable[ResolvedCell], training: dict[str, tuple[str, ...]], data: Path | None, isolate: bool
) -> dict[str, TrainingLane]:
    """The lane of every judged scenario; a scenario whose `training` is empty has none, and is only judged.

    Raises:
        BadInput: a recording of which the study does not say on which other it is tuned, or one that overlaps with it.

    """
    cells = list(cells)
    judged = {cell.scenario.label: cell.scenario for cell in cells}
    if unknown := [label for label in training if label not in judged]:
        raise BadInput(f"training names {unknown[0]!r}, which is not a scenario of the study; leave it out")
    read = resolve_isolated if isolate else resolve
    found = {}
    for label, scenario in judged.items():
        if scenario.recorded and label not in training:
            raise BadInput(
                f"scenario {label!r} is a recording, and tuning on the run that is judged is refused: say in the "
                f'study on which other it is tuned, training = {{ "{label}" = ["..."] }}, or [] for none'
            )
        own = tuple(read(one, data) for one in training[label]) if label in training else (scenario,)
        if own:
            found[label] = TrainingLane(label, own)
    _demand_other_recordings(list(judged.values()), [one for lane in found.values() for one in lane.scenarios])
    return found


def _demand_other_recordings(judged: Sequence[Resolved], trained: Sequence[Resolved]) -> None:
    """Refuse to train on any part of a recording that is judged.

    Raises:
        BadInput: two overlap; says which.

    """
    reported = [(one.label, stream) for one in judged if one.recorded for stream in _recordings(one)]
    if not reported:
        return
    for one in {one.label: one for one in trained if one.recorded}.values():
        for stream in _recordings(one):
            for label, other in reported:
                if overlap(stream, other):
                    raise BadInput(
                        f"training on {one.label!r} would use readings of {label!r}, which is judged: choose another "
                        "run, or parts of it that do not overlap"
                    )


def _recordings(scenario: Resolved) -> list[Stream]:
    """Its trials, each a stream; what is not built in is read by a process of its own."""
    trials = range(scenario.trials(1))
    if isinstance(scenario, ResolvedScenario):
        return [scenario.simulate([trial], 0)[1] for trial in trials]
    owner = f"simulate {scenario.name}"
    found = [call(owner, scenario.simulate, [trial], 0, seconds=LIMIT)[1] for trial in trials]
    end(owner)
    return found


def overlap(a: Stream, b: Stream) -> bool:
    """Whether two streams are parts of one recording that share any time, or hold the same readings.

    A recording that does not say its name counts as the same.
    """
    rssi, others = a.senses.anchor_rssi, b.senses.anchor_rssi
    if set(a.hashes) & set(b.hashes) or (rssi.size and np.array_equal(rssi, others, equal_nan=True)):
        return True
    one, other = (stream.notes.get("recording") for stream in (a, b))
    if one is not None and other is not None and one != other:
        return False
    starts = [float(stream.time[0] - stream.senses.dt[0, 0].max()) for stream in (a, b)]
    ends = [float(stream.time[-1]) for stream in (a, b)]
    return max(starts) < min(ends) - 1e-6


def demand_apart(training_seed: int, seed: int, trained: Iterable[str], reported: Iterable[str]) -> None:
    """Refuse results of which tuning saw a stream.

    Raises:
        BadInput: the seeds are equal, or a hash of a stream is in both.

    """
    met = set(trained) & set(reported)
    if training_seed == seed or met:
        raise BadInput(
            f"tuning has seen {len(met)} of the reported streams (training seed {training_seed}, seed {seed}): "
            "choose another seed"
        )

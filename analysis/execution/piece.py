"""A part's identity: which trials of which scenario and estimator it holds, and the name of its file."""

import hashlib
import re
from typing import NamedTuple

PART = re.compile(r"(.+--[0-9a-f]{8}--)(\d{5,9})-(\d{5,9})\.(?:parquet|json)")
MOST_TRIALS = 10_000  # of one part, which is a chunk of at most fifty


class Piece(NamedTuple):
    """Which trials of which scenario and estimator a part holds."""

    scenario: str
    estimator: str
    trials: range

    @property
    def name(self) -> str:
        """Its file's name: readable, the same on every system, and unique by a digest of the labels."""
        return f"{self.stem}{self.trials.start:05d}-{self.trials.stop:05d}"

    @property
    def stem(self) -> str:
        """The name without the trials."""
        labels = "--".join(re.sub(r"[^A-Za-z0-9.=]+", "-", label).strip("-") for label in self[:2])
        digest = hashlib.sha256("\0".join(self[:2]).encode()).hexdigest()[:8]
        return f"{labels[:150]}--{digest}--"


def trials_of(name: str) -> range:
    """The trials in the name of a part's file; empty where it is not one."""
    match = PART.fullmatch(name)
    trials = range(int(match[2]), int(match[3])) if match else range(0)
    return trials if len(trials) <= MOST_TRIALS else range(0)


def stem_of(name: str) -> str:
    """The name of a part's file without its trials, as `Piece.stem`; empty where it is not one."""
    match = PART.fullmatch(name)
    return match[1] if match else ""

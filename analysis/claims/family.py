"""A ledger's verdicts as a family of tests: how many are decided, how many stand, how many are expected to be false."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.claims.verdicts import DECIDED, once
from cooploc.analysis.formats import counted
from cooploc.analysis.metrics import statistics


class Family(NamedTuple):
    """The verdicts of a ledger as a family of tests."""

    judged: int  # cases
    decided: int
    stand: int  # decided, and by Holm over all judged cases too
    at_most: float  # decided ones expected to be false if every truth lay at the edge of a zone
    expected: float  # decided ones expected to be false, by `statistics.expected_false`

    def __str__(self) -> str:
        if not self.decided:
            return f"Of {counted(self.judged, 'judged case')} none is decided."
        return (
            f"Of {counted(self.judged, 'judged case')} {self.decided} are decided, and {self.stand} of these stand "
            f"after Holm's correction over all. Of the {self.decided} about {self.expected:.1f} are expected to be "
            f"false, judging by how many p-values lie above one half, and {self.at_most:.1f} at most."
        )


def of(verdicts: pd.DataFrame) -> Family:
    """How many verdicts of `judge` are decided, stand after correction over all, and are expected to be false.

    At 5 % a case, 5 % of the judged ones are decided wrongly where every truth lies at the edge of its zone, and fewer
    elsewhere; where a truth lies far from the edge, a false verdict is next to impossible. A case that several variants
    share counts once.
    """
    verdicts = verdicts[once(verdicts)]
    p = verdicts["p"].to_numpy(float)
    decided, judged = int(verdicts["verdict"].isin(DECIDED).sum()), int((~np.isnan(p)).sum())
    at_most = min((1 - statistics.LEVEL) * judged, float(decided))
    expected = min(statistics.expected_false(p), at_most)
    return Family(judged, decided, int(verdicts["stands"].sum()), at_most, expected)

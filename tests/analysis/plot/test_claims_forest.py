"""The picture of a ledger: every number beside what was claimed."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

import cooploc as cl
from cooploc.analysis.claims.verdicts import COLUMNS

CASES = (
    # claim, scenario, than, definition, size, value, low, high, verdict
    ("1", "quick/n=2", "arl", "change", -0.66, -0.2, -0.3, -0.1, "direction only"),
    ("1", "quick/n=3", "arl", "change", -0.66, -0.6, -0.7, -0.5, "supported"),
    ("2", "nlos", "arl", "ratio", -0.33, 0.4, np.nan, np.nan, "contradicted"),
    ("3", "nlos", "arl", "", np.nan, 0.4, 0.3, 0.5, "contradicted"),
)


def verdicts(variant="paper"):
    names = ("claim", "scenario", "than", "definition", "size", "value", "low", "high", "verdict")
    frame = pd.DataFrame(CASES, columns=names)
    told = {"says": "Ours is better", "kind": "change", "variant": variant, "of": "mrsl-rssi"}
    return frame.assign(**told).reindex(columns=list(COLUMNS))


def test_each_case_is_drawn_once_beside_its_claim():
    ax = cl.plot.claims(verdicts())
    labels = [tick.get_text() for tick in ax.get_yticklabels()]
    assert labels == ["mrsl-rssi vs arl, quick/n=2", "mrsl-rssi vs arl, quick/n=3", "mrsl-rssi vs arl, nlos"]
    points = [line.get_xdata()[0] for line in ax.lines if len(line.get_xdata()) == 1]
    np.testing.assert_allclose(points, [-20, -60, 40])
    claimed = [line.get_xdata()[0] for line in ax.lines if len(line.get_xdata()) == 2 and line.get_linewidth() == 2]
    np.testing.assert_allclose(claimed, [-66, -33])
    plt.close(ax.figure)


def test_a_reading_that_was_not_run_is_refused():
    with pytest.raises(cl.BadInput, match="no claim of the reading 'literal'"):
        cl.plot.claims(verdicts(), variant="literal")

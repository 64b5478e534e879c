"""The pictures of ledgers: every number beside what was claimed, every specification above its choices."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

import cooploc as cl
from cooploc.analysis.claims.multiverse import SHOWN
from cooploc.analysis.claims.verdicts import COLUMNS
from cooploc.analysis.report import claim_tables


def verdicts():
    rows = (
        ("1", "quick/n=2", "arl", "change", -0.66, -0.2, -0.3, -0.1, "direction only"),
        ("1", "quick/n=3", "arl", "change", -0.66, -0.6, -0.7, -0.5, "supported"),
        ("2", "nlos", "arl", "ratio", -0.33, 0.4, np.nan, np.nan, "contradicted"),
        ("3", "nlos", "arl", "", np.nan, 0.4, 0.3, 0.5, "contradicted"),
    )
    names = ["claim", "scenario", "than", "definition", "size", "value", "low", "high", "verdict"]
    same = {"says": "Ours is better", "kind": "change", "variant": "paper", "of": "mrsl-rssi"}
    return pd.DataFrame(rows, columns=names).assign(**same).reindex(columns=list(COLUMNS))


@pytest.fixture
def found():
    rows = (
        ("1", "change", -0.66, -0.2, "direction only", False, True, "walk", ""),
        ("1", "change", -0.66, -0.7, "supported", True, False, "box", ""),
        ("1", "change", -0.66, 0.1, "contradicted", False, False, "none", ""),
        ("2", "level", 1.0, 0.8, "supported", True, True, "walk", "received"),
        ("3", "all", np.nan, 0.4, "contradicted", True, True, "walk", ""),
    )
    names = ["claim", "kind", "size", "value", "verdict", "letter", "preset", "sampling", "fusion"]
    same = {"says": "Ours is better", "scenario": "nlos", "of": "mrsl-rssi", "than": "arl", "definition": "change"}
    frame = pd.DataFrame(rows, columns=names).assign(**same)
    frame = frame.assign(low=frame["value"] - 0.1, high=frame["value"] + 0.1)
    yield frame.reindex(columns=[*SHOWN, "sampling", "fusion"])
    plt.close("all")


def test_each_case_is_drawn_once_beside_its_claim():
    ax = cl.plot.claims(verdicts())
    labels = [tick.get_text() for tick in ax.get_yticklabels()]
    assert labels == ["mrsl-rssi vs arl, quick/n=2", "mrsl-rssi vs arl, quick/n=3", "mrsl-rssi vs arl, nlos"]
    points = [line.get_xdata()[0] for line in ax.lines if len(line.get_xdata()) == 1]
    np.testing.assert_allclose(points, [-20, -60, 40])
    claimed = [line.get_xdata()[0] for line in ax.lines if len(line.get_xdata()) == 2 and line.get_linewidth() == 2]
    np.testing.assert_allclose(claimed, [-66, -33])
    plt.close(ax.figure)


def test_a_decided_case_says_whether_it_stands_over_all_of_them():
    judged = verdicts().assign(trials=20, stands=[True, False, True, False], p_holm=0.01, remark="", otherwise="")
    table = claim_tables.cases(judged.replace({"verdict": {"supported": "undecided"}}))
    where = [column.head for column in table.columns].index("stands")
    assert [line[where] for line in table.texts()] == ["yes", "", "yes", "no"]
    untested = claim_tables.cases(judged.assign(p_holm=float("nan")))
    assert {line[where] for line in untested.texts()} == {""}


def marks(ax):
    """Return where vertical marks stand, and the words beside."""
    x = [float(segment[0, 0]) for lines in ax.collections for segment in lines.get_segments()]
    return sorted(x), [text.get_text() for text in ax.texts]


def test_the_map_has_every_number_the_claimed_one_and_the_count(found):
    changes = cl.plot.readings(found)
    assert marks(changes) == (pytest.approx([-70, -66, -20, 10]), ["1. Ours is better", "1 of 3"])
    assert marks(changes.figure.axes[1]) == (pytest.approx([0.8, 1.0]), ["2. Ours is better", "1 of 1"])
    ends = {line.get_marker(): line.get_xdata()[0] for line in changes.lines if line.get_marker() in ("v", "^")}
    assert ends == pytest.approx({"v": -70, "^": -20})


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda found: cl.plot.claims(verdicts(), variant="literal"), "no claim of the reading 'literal'"),
        (lambda found: cl.plot.readings(found[found["claim"] == "3"]), "no claim that names a size was run"),
    ],
)
def test_a_claim_that_is_not_there_is_refused(found, draw, message):
    with pytest.raises(cl.BadInput, match=message):
        draw(found)

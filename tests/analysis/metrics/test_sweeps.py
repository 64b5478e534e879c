"""Labels say what they sweep, whatever else they are."""

import numpy as np
import pandas as pd
import pytest

from cooploc.analysis.metrics.sweeps import add_sweep, sweeps

GRID = ["a/n=1[x=1]", "a/n=1[x=2]", "a/n=1[x=3]", "a/n=2[x=1]", "a/n=2[x=2]", "a/n=2[x=3]"]


@pytest.mark.parametrize(
    ("labels", "points"),
    [
        (["a/x=0.7", "a/x=0"], [("a", "x", 0.7), ("a", "x", 0.0)]),
        (["a/n=3[x=1]", "a/n=4[x=1]"], [("a[x=1]", "n", 3.0), ("a[x=1]", "n", 4.0)]),
        (["nlos[eta=2]", "nlos[eta=3]"], [("nlos", "eta", 2.0), ("nlos", "eta", 3.0)]),
        (["a[x=1e-3,y=b]", "a[x=-.5,y=b]"], [("a[y=b]", "x", 0.001), ("a[y=b]", "x", -0.5)]),
        (["a/n=3[x=1]", "a/n=3[x=2]"], [("a/n=3", "x", 1.0), ("a/n=3", "x", 2.0)]),
        (["a=b.py:C[g=1]", "a=b.py:C[g=2]"], [("a=b.py:C", "g", 1.0), ("a=b.py:C", "g", 2.0)]),
        (GRID, [(f"a/n={n}", "x", float(x)) for n in (1, 2) for x in (1, 2, 3)]),
    ],
)
def test_labels_say_what_they_sweep(labels, points):
    assert list(sweeps(labels).values()) == points


@pytest.mark.parametrize(
    "label",
    ["mrclam/all", "nlos[eta=2]", "here/worlds.py:Mine[x=a]", "a/kind=fine", "a/n=inf", "a/n=3", "odom [raw", "b=1]"],
)
def test_a_label_that_sweeps_nothing_is_its_family(label):
    table = add_sweep(pd.DataFrame({"scenario": [label, label, "nlos/n=3"]}))
    assert table["family"].tolist() == [label, label, "nlos/n=3"]
    assert table["parameter"].tolist() == ["", "", ""]
    assert np.isnan(table["value"][0])

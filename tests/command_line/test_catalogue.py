"""The README's table of estimators is what the code says."""

import re
from pathlib import Path

from cooploc import estimators
from cooploc.catalogue import KNOWN, markdown

README = Path(__file__).resolve().parents[2] / "README.md"


def block(name):
    """What the README holds between two comments."""
    told = re.search(rf"<!-- {name}: .*? -->\n(.*?)\n<!-- end of {name} -->", README.read_text("utf-8"), re.DOTALL)
    assert told is not None
    return told[1]


def test_the_readmes_table_is_made_from_the_code():
    assert block("estimators") == markdown(), "put the output of `cooploc list estimators --markdown` there"


def test_the_readmes_map_is_the_reports():
    kept = (README.parent / "reports/readings/map.md").read_text("utf-8")
    assert block("readings") + "\n" == kept


def test_the_readmes_table_of_tuned_estimators_is_the_reports():
    kept = (README.parent / "reports/tuned-side-by-side.md").read_text("utf-8")
    assert block("tuned") + "\n" == kept


def test_every_builtin_estimator_is_in_it_with_its_source():
    rows = block("estimators").splitlines()[2:]
    assert [row.split("`")[1] for row in rows] == list(estimators.BUILTIN) == list(KNOWN)
    assert all(re.search(r"(19|20)\d\d \|$", row) for row in rows if "dead-reckoning" not in row)

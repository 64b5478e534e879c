"""The README's table of estimators is what the code says."""

import re
from pathlib import Path

from cooploc import estimators
from cooploc.catalogue import KNOWN, markdown

README = Path(__file__).resolve().parent.parent / "README.md"


def test_the_readmes_table_is_made_from_the_code():
    told = re.search(
        r"<!-- estimators: .*? -->\n(.*?)\n<!-- end of estimators -->", README.read_text("utf-8"), re.DOTALL
    )
    assert told is not None
    assert told[1] == markdown(), "put the output of `cooploc list estimators --markdown` there"


def test_every_builtin_estimator_is_in_it_with_its_source():
    rows = markdown().splitlines()[2:]
    assert [row.split("`")[1] for row in rows] == list(estimators.BUILTIN) == list(KNOWN)
    assert all(re.search(r"(19|20)\d\d \|$", row) for row in rows if "dead-reckoning" not in row)

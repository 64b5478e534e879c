"""The table of estimators in the documentation is what the code says."""

import re
from pathlib import Path

from cooploc.catalogue import markdown

PAGE = Path(__file__).resolve().parents[2] / "docs/reference/estimators.md"


def block(name):
    """What the page holds between two comments."""
    told = re.search(rf"<!-- {name}: .*? -->\n(.*?)\n<!-- end of {name} -->", PAGE.read_text("utf-8"), re.DOTALL)
    assert told is not None
    return told[1]


def test_the_table_is_made_from_the_code():
    """What the page says is so; a new estimator is added to it by `cooploc list estimators --markdown`."""
    assert set(block("estimators").splitlines()) <= set(markdown().splitlines())


def test_the_numbers_of_the_first_sentences_are_those_of_the_map():
    root = PAGE.parents[2]
    sentences, found = (
        (root / file).read_text("utf-8") for file in ("reports/paper/README.md", "reports/readings/README.md")
    )
    first = r"This\s+claim\s+holds\s+in\s+(\d+)\s+of\s+(\d+)\s+specifications"
    second = r"its\s+second,[^,]*,\s+in\s+(\d+)\s+and\s+\d+\s+of\s+(\d+)"
    for claim, said in (("1", first), ("2", second)):
        number, of = re.search(said, sentences).groups()
        assert re.search(rf"\*\*{claim}\.\*\*[^*]* holds in {number} of {of} specifications", found)

"""Sections of reports/reliability.md, which several commands write at once."""

import importlib
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "benchmarks" / "reliability"


@pytest.fixture(scope="module")
def put():
    sys.path.insert(0, str(SCRIPTS))
    yield importlib.import_module("sections").put
    sys.path.remove(str(SCRIPTS))


def test_a_section_replaces_itself_alone(put, tmp_path):
    page = tmp_path / "reliability.md"
    for name, text in (("one", "first"), ("two", "second"), ("one", "third")):
        put(page, name, text)
    assert page.read_text("utf-8").startswith("# Reliability\n")
    assert page.read_text("utf-8").endswith(
        "\n\n<!-- one -->\nthird\n<!-- end of one -->\n\n<!-- two -->\nsecond\n<!-- end of two -->\n"
    )


def test_no_section_is_lost_where_several_are_written_at_once(put, tmp_path):
    page, names = tmp_path / "reliability.md", [f"section {k}" for k in range(20)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda name: put(page, name, f"text of {name}"), names * 5))
    text = page.read_text("utf-8")
    assert all(text.count(f"<!-- {name} -->\ntext of {name}\n") == 1 for name in names)

"""Directories of tunings that came to harm: one line, or what was written; then the same command goes on."""

import json
import shutil

import pandas as pd
import pytest
from attempts import attempted, cases
from damage import HARM, JSON, PLACES, changed, harm_file
from hypothesis import given
from hypothesis import strategies as st

import cooploc as cl
from cooploc.analysis.tuning.tables import VALUE
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.sealed import seal

FILES = "tuning.json", "history.csv", "published-and-tuned.csv"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tuned")
    study = folder / "small.toml"
    study.write_text('trials = 5\nscenarios = ["robots-1-3/n=1[ticks=3]"]\nestimators = ["ekf-local"]\n')
    return study, cl.tune(study, 4, out=folder / "out")


@pytest.fixture
def copied(written, tmp_path):
    return shutil.copytree(written[1].folder, tmp_path / "out")


def same(one, other):
    for name in ("history", "table"):
        tables = getattr(one, name), getattr(other, name)
        a, b = (table.loc[:, ~table.columns.str.startswith(VALUE)] for table in tables)  # values: text in memory
        pd.testing.assert_frame_equal(a, b, check_dtype=False, check_exact=True)
    assert one.tuned == other.tuned
    assert one.record["budget"] == other.record["budget"]


def test_a_tuning_is_read_as_it_was_written(written):
    same(cl.load_tuned(written[1].folder), written[1])


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("content", [b"", b"[]", b"{}", b'{"budget": 4', b"\xff\0"])
def test_a_file_of_something_else_is_one_line_and_the_same_command_repairs_it(written, copied, name, content):
    (copied / name).write_bytes(content)
    with pytest.raises(BadInput, match=r"damaged.*cooploc tune"):
        cl.load_tuned(copied)
    same(cl.tune(written[0], 4, out=copied), written[1])
    same(cl.load_tuned(copied), written[1])


def test_an_edited_budget_is_not_believed(copied):
    record = copied / "tuning.json"
    record.write_text(record.read_text().replace('"budget": 4', '"budget": 4000'))
    with pytest.raises(BadInput, match="does not match its checksum"):
        cl.load_tuned(copied)


def test_an_edited_table_is_not_believed(copied):
    table = copied / "published-and-tuned.csv"
    table.write_text(table.read_text().replace("0.", "1."))
    with pytest.raises(BadInput, match=r"published-and-tuned\.csv is damaged"):
        cl.load_tuned(copied)


@cases(200)
@given(st.sampled_from(FILES), HARM)
def test_harm_to_a_tuning_is_one_line_or_changes_no_number(written, tmp_path_factory, name, harm):
    folder = tmp_path_factory.getbasetemp() / "harmed"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(written[1].folder, folder)
    harm_file(folder / name, harm)
    found = attempted(cl.load_tuned, folder)
    if not isinstance(found, BadInput):
        same(found, written[1])


@cases(100)
@given(PLACES, JSON)
def test_a_record_that_says_anything_is_one_line(written, tmp_path_factory, where, value):
    folder = tmp_path_factory.getbasetemp() / "changed"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(written[1].folder, folder)
    content = json.loads((folder / "tuning.json").read_text())
    content.pop("checksum")
    found = changed(content, where, value)
    (folder / "tuning.json").write_text(json.dumps(seal(found if isinstance(found, dict) else {"found": found})))
    attempted(cl.load_tuned, folder)

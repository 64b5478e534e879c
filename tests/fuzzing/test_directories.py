"""Run directories that came to harm: one line, or the numbers that were written, never others; then the run goes on."""

import json
import shutil

import pandas as pd
import pytest
from attempts import attempted, cases, commanded
from damage import HARM, JSON, PLACES, changed, harm_file
from hypothesis import given
from hypothesis import strategies as st

from cooploc.analysis.execution import reproduce
from cooploc.analysis.execution.run import execute
from cooploc.analysis.execution.run_directory import read_run
from cooploc.analysis.report import run_diff
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.sealed import seal
from cooploc.scenarios.studies.study import Study

STUDY = Study(
    name="small",
    trials=2,
    scenarios=("robots-1-3/n=2[ticks=3]",),
    estimators=("dead-reckoning", "ekf-local"),
)
KEY = ["scenario", "estimator", "trial", "robot"]
NUMBER = st.floats(0, 1, exclude_max=True)


@pytest.fixture(scope="module")
def honest(tmp_path_factory):
    folder = tmp_path_factory.mktemp("honest") / "run"
    return folder, execute(STUDY, folder).set_index(KEY)


@pytest.fixture(scope="module")
def copied(honest, tmp_path_factory):
    """Makes a fresh copy of the directory, always in the same place."""

    def copy():
        place = tmp_path_factory.getbasetemp() / "harmed"
        shutil.rmtree(place, ignore_errors=True)
        return shutil.copytree(honest[0], place)

    return copy


def files(folder):
    return sorted(file for file in folder.rglob("*") if file.is_file() and file.name != ".lock")


def same(rows, written, *without):
    """Whether all rows are, bit by bit, among those that were written."""
    rows = rows.set_index(KEY)
    pd.testing.assert_frame_equal(
        rows.drop(columns=[*without]), written.loc[rows.index].drop(columns=[*without]), check_exact=True
    )


@cases(200)
@given(NUMBER, HARM)
def test_harm_to_a_file_is_one_line_or_changes_no_number(honest, copied, which, harm):
    folder = copied()
    there = files(folder)
    harm_file(there[int(which * len(there))], harm)
    commanded("show", folder)
    kept = attempted(read_run, folder)
    if not isinstance(kept, BadInput):
        same(kept.rows, honest[1])
        assert kept.gaps or len(kept.rows) == len(honest[1])


@cases(60)
@given(NUMBER, HARM)
def test_the_same_command_goes_on_after_any_harm(honest, copied, which, harm):
    folder = copied()
    there = files(folder)
    file = there[int(which * len(there))]
    harm_file(file, harm)
    rows = attempted(execute, STUDY, folder) if harm[0] != "folder" else None
    if file.name == "manifest.json" and isinstance(rows, BadInput):
        assert any(word in str(rows) for word in ("update cooploc", "not a run directory"))
        return
    if rows is not None:
        assert len(rows) == len(honest[1])
        same(rows, honest[1], "seconds")
        assert not read_run(folder).gaps


@cases(200)
@given(PLACES, JSON)
def test_a_manifest_that_says_anything_is_one_line(honest, copied, where, value):
    folder = copied()
    content = json.loads((folder / "manifest.json").read_text())
    content.pop("checksum")
    (folder / "manifest.json").write_text(json.dumps(seal(dict_of(changed(content, where, value)))))
    commanded("show", folder)
    kept = attempted(read_run, folder)
    if not isinstance(kept, BadInput):
        attempted(lambda: kept.experiments)
        attempted(run_diff.settings, kept, read_run(honest[0]))


@cases(120)
@given(PLACES, JSON)
def test_a_page_that_embeds_anything_is_one_line(honest, tmp_path_factory, where, value):
    page = tmp_path_factory.getbasetemp() / "page.html"
    content = reproduce.embedded(read_run(honest[0]))
    content.pop("checksum")
    embedded = json.dumps(seal(dict_of(changed(json.loads(json.dumps(content)), where, value))))
    page.write_text(f'<script type="application/json" id="manifest">{embedded}</script>')
    found = attempted(reproduce.load, page)
    if not isinstance(found, BadInput):
        attempted(reproduce.rerun, found, 1)


@cases(50)
@given(
    st.lists(st.tuples(st.text("abmnpr-_.0123456789/", min_size=1, max_size=12), st.binary(max_size=40)), max_size=4)
)
def test_a_directory_of_anything_is_one_line(tmp_path_factory, found):
    folder = tmp_path_factory.mktemp("anything")
    for name, content in [*found, ("manifest.json", b'{"format": 2}')][-3:]:
        file = folder / "run" / name.replace("/", "x").strip(".")
        file.parent.mkdir(exist_ok=True)
        if not file.exists():
            file.write_bytes(content)
    for command in ("show", "verdicts"):
        assert commanded(command, folder / "run").returncode == 2


def dict_of(content):
    return content if isinstance(content, dict) else {"content": content}


def test_foreign_files_among_the_parts_are_ignored_with_a_line(honest, copied):
    folder = copied()
    part = files(folder / "parts")[0]
    shutil.copy(part, part.with_name(f"{part.stem} (1).parquet"))
    (folder / "receipts" / ".DS_Store").write_bytes(b"\0")
    shown = commanded("show", folder)
    assert shown.stdout.count("is not of this run, and ignored") == 2
    same(read_run(folder).rows, honest[1])
    assert len(execute(STUDY, folder)) == len(honest[1])


def test_a_part_of_another_run_is_not_taken_for_one_of_this(honest, tmp_path):
    other = tmp_path / "other"
    execute(STUDY.with_options(seed=9), other)
    shutil.copytree(honest[0], tmp_path / "run")
    for file in (*files(other / "parts"), *files(other / "receipts")):
        shutil.copy(file, tmp_path / "run" / file.relative_to(other))
    with pytest.raises(BadInput, match="no results yet"):
        read_run(tmp_path / "run")
    same(execute(STUDY, tmp_path / "run"), honest[1], "seconds")


def test_a_directory_of_the_first_format_is_still_read(honest, copied):
    folder = copied()
    for file in (folder / "manifest.json", *files(folder / "receipts")):
        content = json.loads(file.read_text())
        for key in ("checksum", "settings", "failed", *(["format"] if file.parent.name == "receipts" else [])):
            content.pop(key, None)
        file.write_text(json.dumps({**content, "format": 1} if "format" in content else content))
    same(read_run(folder).rows, honest[1])
    assert commanded("show", folder).returncode == 0


def test_a_lost_manifest_is_made_again_from_the_same_command_only(honest, copied):
    folder = copied()
    before = {file.name: file.stat().st_mtime_ns for file in files(folder / "parts")}
    (folder / "manifest.json").unlink()
    assert "manifest.json is gone" in commanded("show", folder).stderr
    with pytest.raises(BadInput, match="is gone, and there are parts"):
        execute(STUDY.with_options(seed=2), folder)
    same(execute(STUDY, folder), honest[1])
    assert {file.name: file.stat().st_mtime_ns for file in files(folder / "parts")} == before
    same(read_run(folder).rows, honest[1])

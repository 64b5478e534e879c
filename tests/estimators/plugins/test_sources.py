"""What a plug-in is made of is found without importing it."""

import sys
from importlib.metadata import version

import pytest

from cooploc.analysis.execution.provenance import plugins
from cooploc.estimators import configure
from cooploc.estimators.plugin_files import files_of_module, neighbours_of


def write(folder, **texts):
    for name, text in texts.items():
        (folder / f"{name}.py").write_text(text)


@pytest.mark.slow
def test_helpers_in_a_files_folder_are_found_and_those_of_helpers_and_all_their_versions(tmp_path):
    write(tmp_path, mine="import numpy, one\ndef f():\n    from pack.deep import g\n", two="import mine", unused="")
    write(tmp_path, one="import two, cooploc, json\ndef f():\n    from filterpy import kalman", json="")
    (tmp_path / "pack").mkdir()
    write(tmp_path / "pack", __init__="", deep="raise SystemExit")
    found = [name for name, _ in neighbours_of(tmp_path / "mine.py")]
    assert found == ["one.py", "pack/__init__.py", "pack/deep.py", "two.py"]
    asked = [configure(f"{tmp_path}/mine.py:Mine")]
    assert list(plugins(asked)[1].values()) == [{"filterpy": version("filterpy"), "numpy": version("numpy")}]
    before = plugins(asked)[0]
    assert plugins(asked)[0] == before
    write(tmp_path, two="x = 2")
    assert plugins(asked)[0] != before


def test_a_package_is_found_without_being_imported(tmp_path, monkeypatch):
    (tmp_path / "spaced" / "inner").mkdir(parents=True)
    write(tmp_path / "spaced" / "inner", __init__="raise SystemExit", filter="raise SystemExit")
    write(tmp_path, lonely="raise SystemExit")
    monkeypatch.syspath_prepend(tmp_path)
    assert [name for name, _ in files_of_module("spaced.inner.filter")] == ["inner/__init__.py", "inner/filter.py"]
    assert [name for name, _ in files_of_module("lonely")] == ["lonely.py"]
    assert files_of_module("nowhere.at.all") == []
    assert not {"spaced.inner", "lonely"} & set(sys.modules)

"""What a plug-in is made of is found without importing it."""

import sys
from importlib.metadata import version

from cooploc.analysis.execution.provenance import files, imports
from cooploc.estimators import configure
from cooploc.estimators.plugin_files import files_of_module, neighbours_of


def write(folder, **texts):
    for name, text in texts.items():
        (folder / f"{name}.py").write_text(text)


def test_helpers_in_a_files_folder_are_found_and_those_of_helpers_too(tmp_path):
    write(
        tmp_path, mine="import numpy, one\ndef f():\n    from pack.deep import g\n", one="import two", two="import mine"
    )
    write(tmp_path, unused="", json="")
    (tmp_path / "pack").mkdir()
    write(tmp_path / "pack", __init__="", deep="raise SystemExit")
    found = [name for name, _ in neighbours_of(tmp_path / "mine.py")]
    assert found == ["one.py", "pack/__init__.py", "pack/deep.py", "two.py"]


def test_an_edited_helper_is_another_version_of_the_file(tmp_path):
    write(tmp_path, mine="from one import x", one="x = 1")
    asked = [configure(f"{tmp_path}/mine.py:Mine")]
    before = files(asked)
    assert files(asked) == before
    write(tmp_path, one="x = 2")
    assert files(asked) != before


def test_a_package_is_found_without_being_imported(tmp_path, monkeypatch):
    (tmp_path / "spaced" / "inner").mkdir(parents=True)
    write(tmp_path / "spaced" / "inner", __init__="raise SystemExit", filter="raise SystemExit")
    write(tmp_path, lonely="raise SystemExit")
    monkeypatch.syspath_prepend(tmp_path)
    assert [name for name, _ in files_of_module("spaced.inner.filter")] == ["inner/__init__.py", "inner/filter.py"]
    assert [name for name, _ in files_of_module("lonely")] == ["lonely.py"]
    assert files_of_module("nowhere.at.all") == []
    assert not {"spaced.inner", "lonely"} & set(sys.modules)


def test_the_versions_of_what_a_file_and_its_helpers_import_are_found(tmp_path):
    write(
        tmp_path, mine="import numpy as np\nimport one, cooploc, json", one="def f():\n    from filterpy import kalman"
    )
    (found,) = imports([configure(f"{tmp_path}/mine.py:Mine")]).values()
    assert found == {"filterpy": version("filterpy"), "numpy": version("numpy")}

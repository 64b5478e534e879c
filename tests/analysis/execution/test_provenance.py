"""The hash of the source sees every file that makes results, by its content and its place."""

import shutil

import pytest

from cooploc.analysis.execution.provenance import FLOORS, ROOT, source_hash

PACKAGES = sorted(
    {file.parent.relative_to(ROOT).as_posix() for floor in FLOORS for file in (ROOT / floor).rglob("*.py")}
)


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """A copy of the source."""
    root = tmp_path_factory.mktemp("source")
    for floor in FLOORS:
        shutil.copytree(ROOT / floor, root / floor, ignore=shutil.ignore_patterns("__pycache__"))
    (root / "analysis" / "metrics").mkdir(parents=True)
    shutil.copy(ROOT / "analysis" / "metrics" / "errors.py", root / "analysis" / "metrics")
    return root


@pytest.mark.parametrize("package", [*PACKAGES, "analysis/metrics"])
def test_a_change_in_any_package_changes_the_hash(tree, package):
    before, file = source_hash(tree), sorted((tree / package).glob("*.py"))[-1]
    text = file.read_text()
    file.write_text(text + "\n")
    assert source_hash(tree) != before
    file.write_text(text)
    assert source_hash(tree) == before


def test_a_file_that_is_added_or_moves_to_another_package_changes_the_hash(tree):
    hashes, file = [source_hash(tree)], tree / "scenarios" / "worlds" / "zzz.py"
    file.write_text("")
    hashes.append(source_hash(tree))
    file.rename(tree / "scenarios" / "studies" / "zzz.py")
    assert len({*hashes, source_hash(tree)}) == 3

"""What a contributor is told is so: files exist, targets too, hooks run what CI runs, every room has quick tests."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
MAKEFILE = (ROOT / "Makefile").read_text("utf-8")
FLOORS = ("estimators", "scenarios", "analysis")
ROOMS = sorted(
    file.parent.relative_to(ROOT)
    for floor in FLOORS
    for file in (ROOT / floor).glob("*/__init__.py")
    if f"cooploc.{floor}.{file.parent.name}:" not in (ROOT / floor / "__init__.py").read_text("utf-8")  # a method
)


def test_contributing_names_only_files_that_exist():
    named = [word for word in re.findall(r"`([^`\s]+)`", TEXT) if re.search(r"/|\.(py|toml|md|cff|lock)$", word)]
    assert len(named) > 40
    there = {path.name for path in ROOT.glob("*/**/*.*")}
    assert [
        word for word in named if not (any(ROOT.glob(f"**/{word.rstrip('/')}")) or word in there | {"log.toml"})
    ] == []


def test_a_citation_is_of_this_version():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"\n## {version}" in (ROOT / "CHANGELOG.md").read_text("utf-8").replace("[", "").replace("]", "")


@pytest.mark.parametrize("room", ROOMS, ids=str)
def test_every_room_has_tests_that_are_quick(room):
    """Some test is not marked slow, by itself or with its whole file."""
    sources = [file.read_text("utf-8") for file in (ROOT / "tests" / room).glob("test_*.py")]
    quick = [source for source in sources if not re.search(r"^pytestmark = (\[[^]]*|.*)\bslow\b", source, re.MULTILINE)]
    assert sum(source.count("\ndef test_") - source.count("mark.slow") for source in quick) > 0

"""Command lines that may be anything: the right exit code, one plain line, at once."""

from pathlib import Path

import pytest
from attempts import cases, commanded
from hypothesis import example, given
from hypothesis import strategies as st

TINY = 'trials = 1\nscenarios = ["robots-1-3/n=1[ticks=2]"]\nestimators = ["dead-reckoning"]\n'
WORDS = st.one_of(
    st.sampled_from(
        ["", " ", "-", "--", "tiny.toml", "gone.toml", "run", "afile", "folder", "x.py", "x.py:Name", "..", "/"]
    ),
    st.sampled_from(
        ["\x1b[2J", "a\nb", "\u202egnp", "=1+1", "x" * 5000, "quik", "/dev/null", "/dev/full", "~", "%s%n{}"]
    ),
    st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12),
)
NUMBERS = st.sampled_from(["0", "-1", "nan", "inf", "1e9", "1000000000000", "0x1", "", "two", "1.5", "9" * 5000, "٣"])
COMMANDS = st.sampled_from(
    ["show", "report", "verdicts", "compare", "reproduce", "judge", "check", "new-estimator", "run", "list", "fly", ""]
)
OPTIONS = st.one_of(
    st.tuples(st.sampled_from(["--trials", "--seed", "--jobs"]), NUMBERS),
    st.tuples(st.sampled_from(["--out", "-o", "--ledger", "--data", "--estimators", "--tum"]), WORDS),
    st.tuples(st.sampled_from(["--json", "--trust", "--retry-failed", "--no-check", "--markdown", "--nonsense"])),
    st.tuples(WORDS),
)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("commands")
    (folder / "tiny.toml").write_text(TINY)
    (folder / "afile").write_text("precious")
    (folder / "folder").mkdir()
    (folder / "folder" / "thesis.txt").write_text("precious")
    return folder


@cases(350)
@given(COMMANDS, WORDS, st.lists(OPTIONS, max_size=3))
@example("run", "tiny.toml", [("--estimators", "")])
@example("run", "tiny.toml", [("--trials", "1000000000000")])
@example("run", "tiny.toml", [("--jobs", "1000000000")])
def test_a_command_ends_as_promised(place, command, word, options):
    before = set(place.parent.iterdir())
    commanded(command, word, *(part for option in options for part in option), cwd=place)
    assert (place / "afile").read_text() == (place / "folder" / "thesis.txt").read_text() == "precious"
    assert set(place.parent.iterdir()) == before


@cases(60)
@given(st.text(st.characters(exclude_categories=["Cs"]), max_size=20))
@example("../../outside")
@example(".\x1b[31m/..\\")
def test_a_study_cannot_name_a_directory_outside(tmp_path_factory, name):
    folder = tmp_path_factory.mktemp("named")
    quoted = "".join(f"\\U{ord(c):08X}" for c in name)
    (folder / "tiny.toml").write_text(f'name = "{quoted}"\n{TINY}')
    commanded("run", "tiny.toml", "--estimators", "no-such-estimator,arl", cwd=folder)
    from cooploc.scenarios.studies.study import load

    if name:
        inner = Path("runs") / load(str(folder / "tiny.toml")).folder_name
        assert (folder / inner).resolve().parent == (folder / "runs").resolve()

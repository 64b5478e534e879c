"""Labels and study files that may be anything: understood, or refused in one line, at once."""

import json

import pytest
from attempts import attempted, cases, in_time
from hypothesis import example, given
from hypothesis import strategies as st

from cooploc.api import run_study
from cooploc.estimators import make, names
from cooploc.estimators.errors import BadInput
from cooploc.scenarios import resolve
from cooploc.scenarios.recordings.inspect.draft_toml import toml as toml_value
from cooploc.scenarios.studies.study import Study, load, resolve_study

REAL = [name for name in names() if name != "cvxpy"]


def one_of(text):
    return st.sampled_from(["", *text.split()])


NAMES = st.one_of(st.sampled_from([*REAL, " ", "=1+1", "\x1b[2J"]), one_of("arll x.py ../no_such_file.py:Name"))
KEYS = one_of("particles gate M K window iterations decay lost alpha uses api")
STRANGE = one_of("nan inf -inf 1e308 1e-308 -0 0x10 1_0 ٣ true [] {1..3} '")
NUMBERS = st.one_of(st.integers(-5, 10**13).map(str), st.floats().map(str), STRANGE)
TEXT = st.text(max_size=20)
JUNK = st.text("[]{},=./;: \t\n\\\"'0123456789abc\x1b\u202e", max_size=30)
OPTIONS = st.lists(st.tuples(st.one_of(KEYS, TEXT), NUMBERS).map("=".join), max_size=4).map(",".join)
LABELS = st.one_of(st.builds("{}[{}]".format, NAMES, OPTIONS), NAMES, JUNK, TEXT)
SWEPT = one_of("n drop a sd bias r samples robots ticks side rate walls radio_range shadowing")
FAMILIES = one_of("robots-1-3 scalability packet-drop nlos camera arena-60m mrclam log")
SCENARIOS = st.one_of(
    st.builds("{}/{}={}".format, FAMILIES, SWEPT, NUMBERS),
    st.builds("{}[{}={}]".format, FAMILIES, SWEPT, NUMBERS),
    st.builds("{}/{}={{{}..{}..{}}}".format, FAMILIES, SWEPT, NUMBERS, NUMBERS, NUMBERS),
    JUNK,
)
VALUES = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(-(10**20), 10**20), st.floats(), LABELS, SCENARIOS),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(TEXT, inner, max_size=3)),
    max_leaves=6,
)
FIELDS = st.sampled_from([*Study.model_fields, "nonsense", ""])
SOUND = {"trials": 2, "baseline": "arl", "scenarios": ["trajectory[ticks=3]"], "estimators": ["arl", "ekf-joint"]}


@cases(450)
@given(LABELS)
@example("arl[particles=1e308]")
@example("ekf-local[gate=-1]")
@example("arl[particles=50,particles=60]")
def test_an_estimator_is_made_or_refused(label):
    attempted(make, label)


@cases(350)
@given(SCENARIOS)
@example("scalability/n=100000")
@example("trajectory[ticks=999999999999]")
def test_a_scenario_is_resolved_or_refused(label):
    attempted(resolve, label)


@cases(350)
@given(st.dictionaries(FIELDS, VALUES, max_size=3))
@example({"scenarios": ["robots-1-3/n={nan..5}", "robots-1-3/n={0..1e-999999..1e-999999}"]})
@example({"name": "../../outside\x1b[2J"})
def test_a_study_is_read_or_refused(tmp_path_factory, changes):
    file = tmp_path_factory.getbasetemp() / "fuzzed.toml"
    file.write_text(toml({**SOUND, **changes}), encoding="utf-8", errors="replace")
    study = attempted(load, str(file))
    if isinstance(study, Study):
        assert "/" not in study.folder_name()
        assert study.folder_name().isprintable() or not study.folder_name().isascii()
        attempted(resolve_study, study)


def toml(content):
    """TOML of a study, as far as TOML can say it."""
    text = "".join(f"{json.dumps(key)} = {toml_value(value)}\n" for key, value in content.items())
    return text.replace("NaN", "nan").replace("Infinity", "inf")


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"scenarios": ["robots-1-3/n={1..1e9}"]}, "1000000000 values, and at most 10000"),
        ({"scenarios": ["nlos/n={1..200}[ticks={1..200}]"]}, "40000 labels, and at most 10000"),
        ({"trials": 10**12}, "1000000, not 1000000000000"),
        ({"scenarios": ["scalability/n=9999"]}, "takes about .* of memory .* this machine has"),
        ({"scenarios": ["trajectory[side=1e308]"]}, "1000000"),
        ({"scenarios": ["arena-60m/sd=nan"]}, "sigma: .*'nan'"),
        ({"estimators": ["arl", "ekf-local[gate=nan]"]}, "gate is nan; it must be a number"),
        ({"estimators": ["arl", "ekf-local[gate=1,gate=2]"]}, "gives gate twice"),
        ({"time_limit": True}, "time_limit: .*not True"),
    ],
)
def test_what_is_too_large_is_refused_at_once_with_the_number_and_the_limit(tmp_path, asked, words):
    (tmp_path / "large.toml").write_text(toml({**SOUND, **asked}))
    with in_time(), pytest.raises(BadInput, match=words):
        run_study(tmp_path / "large.toml", out=tmp_path / "run")
    assert not (tmp_path / "run").exists()

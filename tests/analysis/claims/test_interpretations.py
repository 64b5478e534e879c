"""The readings that a vague paper allows: the design covers all pairs, and is applied to every method alike."""

from itertools import combinations, product

import numpy as np
import pytest

import cooploc as cl
from cooploc.analysis.claims import interpretations
from cooploc.analysis.claims.ledger import load, read
from cooploc.estimators import make
from cooploc.estimators.listing import READ, setting_kind
from cooploc.scenarios.studies import study

DIMENSIONS = load().dimensions
PARTICLE = ("arl", "mrsl-rssi", "mrsl-distance", "ctrn")
WEIGHTS = {"ctrn": {"weights": "exact"}}


def reading(**chosen):
    return {**interpretations.preset(DIMENSIONS), **chosen}


def pairs(rows):
    """The pairs of choices in rows, without dimensions that another choice settles."""
    settled = [interpretations.find_settled(row, DIMENSIONS) for row in rows]
    matter = [[c for c in row.items() if c[0] not in off] for row, off in zip(rows, settled, strict=True)]
    return {pair for choices in matter for pair in combinations(choices, 2)}


@pytest.mark.slow
def test_every_possible_pair_of_choices_stands_in_the_covering_array():
    every = {
        ((a, x), (b, y))
        for a, b in combinations(DIMENSIONS, 2)
        for x, y in product(DIMENSIONS[a].of_paper, DIMENSIONS[b].of_paper)
        if b not in DIMENSIONS[a].choices[x].settles and a not in DIMENSIONS[b].choices[y].settles
    }
    rows = interpretations.cover_pairs(DIMENSIONS)
    assert pairs(rows) == every
    assert len(rows) <= 25  # of 124,416 combinations
    assert pairs(interpretations.design(DIMENSIONS)) >= every


def test_the_design_holds_both_ends_and_all_main_effects_each_once():
    design = interpretations.design(DIMENSIONS)
    preset, letter = interpretations.preset(DIMENSIONS), interpretations.letter(DIMENSIONS)
    assert design[:2] == [preset, letter]
    for end in (preset, letter):
        for name, dimension in DIMENSIONS.items():
            for choice in dimension.of_paper:
                assert interpretations.canonical({**end, name: choice}, DIMENSIONS) in design
    assert len({tuple(row.items()) for row in design}) == len(design)


@pytest.mark.parametrize("label", PARTICLE)
def test_a_reading_is_applied_to_every_method_that_has_the_parameter(label):
    for name, dimension in DIMENSIONS.items():
        for choice, one in dimension.choices.items():
            about = not dimension.only or label in dimension.only
            wanted = {key: value for key, value in one.estimators.items() if about and hasattr(make(label), key)}
            assert make(interpretations.estimator(label, reading(**{name: choice}), DIMENSIONS)) == make(
                label, **wanted
            )


@pytest.mark.slow
def test_the_reading_of_public_code_changes_what_the_code_settles_and_stands_once_in_the_design():
    code = interpretations.code(DIMENSIONS)
    assert interpretations.design(DIMENSIONS).count(code) == 1
    assert interpretations.estimator("arl", code, DIMENSIONS) == "arl[box=0.1,point=max,proposal=best,residual=code]"
    assert interpretations.scenario("nlos", code, DIMENSIONS) == "nlos"
    only = {(d, name) for d, one in DIMENSIONS.items() for name, choice in one.choices.items() if choice.of_code}
    others = [one for one in interpretations.design(DIMENSIONS) if one != code]
    assert only
    assert not any(only & set(one.items()) for one in others)


@pytest.mark.parametrize("name", READ)
@pytest.mark.parametrize("end", ["preset", "letter", "code"])
def test_tables_name_a_reading_as_the_ledger_has_it(name, end):
    reading = getattr(interpretations, end)(DIMENSIONS)
    assert setting_kind(interpretations.estimator(name, reading, DIMENSIONS)) == end


def test_a_choice_is_kept_from_methods_and_worlds_that_its_dimension_is_not_about():
    rssi, wide = reading(**{"CTRN measures": "RSSI"}), reading(prior="1 m")
    for label, found in (("ctrn[weights=exact]", "ctrn[reading=rssi,weights=exact]"), ("mrsl-distance",) * 2):
        assert interpretations.estimator(label, rssi, DIMENSIONS) == found
    for label, added in (("nlos/bias=0.5", "[prior_sigma=1.0]"), ("scalability/n={2..9}", "[prior_sigma=1.0]")):
        assert interpretations.scenario(label, wide, DIMENSIONS) == label + added
    assert interpretations.scenario("arena-60m/sd=5", wide, DIMENSIONS) == "arena-60m/sd=5"


@pytest.mark.parametrize(
    ("dimension", "choice"),
    [("anchors", "RSSI"), ("anchors", "gradient"), ("window", "1 sample"), ("density", "exact")],
)
@pytest.mark.parametrize("label", PARTICLE)
def test_a_dimension_that_is_settled_changes_no_estimate(dimension, choice, label):
    _, stream = cl.simulate("robots-1-3/n=2", ticks=8, trials=2)
    one, small = DIMENSIONS[dimension].choices[choice], {"particles": 30, **WEIGHTS.get(label, {})}
    expected = estimates(make(label, **one.estimators, **small), stream)
    for name in one.settles:
        for other in DIMENSIONS[name].choices.values():
            chosen = {key: value for key, value in other.estimators.items() if hasattr(make(label), key)}
            found = estimates(make(label, **{**chosen, **one.estimators, **small}), stream)
            np.testing.assert_array_equal(found, expected)


def estimates(estimator, stream):
    (trace,) = cl.run([estimator], stream).traces.values()
    return trace.x


def test_the_shipped_study_runs_every_interpretation():
    ran = {(cell.scenario, name) for cell in study.load("readings").cells() for name in cell.estimators}
    scenarios = ("robots-1-3/n=3", "nlos/bias=0.5", "scalability/n=11", "arena-60m/sd=5")
    for one in interpretations.design(DIMENSIONS):
        labels = [interpretations.estimator(label, one, DIMENSIONS) for label in (*PARTICLE[:3], "ctrn[weights=exact]")]
        assert ran >= set(product([interpretations.scenario(s, one, DIMENSIONS) for s in scenarios], labels))


CLAIM = {"id": "1", "says": "x", "kind": "level", "of": "arl", "scenarios": "nlos", "size": 1.0}
GOOD = {"says": "x", "letter": "b", "choices": {"a": {}, "b": {"estimators": {"K": "1"}}}}


def choosing(**b):
    return {"d": {**GOOD, "choices": {"a": {}, "b": b}}}


@pytest.mark.parametrize(
    ("dimensions", "said"),
    [
        ({"d": {**GOOD, "leter": "a"}}, "dimensions.d: there is no key 'leter'; did you mean 'letter'?"),
        ({"d": {**GOOD, "letter": "c"}}, "letter is 'c'; it must be one of a, b"),
        ({"d": {"says": "x", "letter": "a", "choices": {"a": {}}}}, "dimensions.d.choices"),
        (3, "dimensions"),
        ({"d": {**GOOD, "choices": {"a": {"estimators": {"K": "1"}}, "b": {}}}}, "'a' is its first choice"),
        (choosing(estimator={}), "there is no key 'estimator'; did you mean 'estimators'?"),
        (choosing(estimators={"particls": "9"}), "nothing here is called 'particls'; did you mean 'particles'?"),
        (choosing(settles="e"), "nothing here is called 'e'"),
        (choosing(settles="d"), "nothing here is called 'd'"),
        ({"d": {**GOOD, "only": "alr"}}, "nothing here is called 'alr'; did you mean 'arl'?"),
    ],
)
def test_bad_dimensions_are_refused_in_one_line(dimensions, said):
    with pytest.raises(cl.BadInput, match=r"\Al\.toml: .*\Z") as caught:
        read({"paper": "p", "claims": [CLAIM], "dimensions": dimensions}, "l.toml")
    assert said in str(caught.value)

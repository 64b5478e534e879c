"""Verdicts on rows whose truth is known: every one is reached, and false ones are rare."""

import re

import numpy as np
import pandas as pd
import pytest
from made_errors import rows
from scipy.stats import norm

import cooploc as cl
from cooploc.analysis.claims.kinds import KINDS
from cooploc.analysis.claims.ledger import load, read, variants
from cooploc.analysis.claims.trial_table import canonical
from cooploc.analysis.claims.verdicts import COLUMNS, VERDICTS, judge, overview, verdict_sentence
from cooploc.estimators import make
from cooploc.scenarios import resolve
from cooploc.terminal.tables import show_verdicts

TRIALS, ROBOTS = 40, 2


def without_luck():
    """Draws the quantiles of a lognormal, each column in an order of its own: the median is the truth, for any seed."""
    rng = np.random.default_rng(0)

    def lognormal(mean, sigma, shape):
        quantiles = np.exp(mean + sigma * norm.ppf((np.arange(shape[0]) + 0.5) / shape[0]))
        return rng.permuted(np.broadcast_to(quantiles[:, None], shape), axis=0)

    return lognormal


def errors(rmse, trials=TRIALS, spread=0.1, rng=None, **more):
    """Rows of {scenario: {estimator: RMSE}}; what is hard in a trial is hard for all estimators."""
    lognormal = rng.lognormal if rng else without_luck()
    frames = []
    for name, estimators in rmse.items():
        hard = lognormal(0, 0.3, (trials, 1))
        for estimator, level in estimators.items():
            mse = level**2 * hard * lognormal(0, spread, (trials, ROBOTS))
            frames.append(rows(estimator, mse, scenario=name, stream=name, **more))
    return pd.concat(frames, ignore_index=True)


REPEATED = [f"s/n={k}" for k in range(200)]  # as many repetitions of one case


def repeated(mine, **more):
    return errors({label: {"a": mine, "b": 1.0} for label in REPEATED}, **more)


def ledger(**claim):
    return read({"paper": "p", "claims": [{"id": "1", "says": "it is so", **claim}]}, "l.toml")


def verdict(table, **claim):
    return judge(ledger(**claim), table).iloc[0]


CHANGE = {"kind": "change", "of": "a", "than": "b", "scenarios": "s", "definitions": ["change"]}


@pytest.mark.parametrize(
    ("mine", "size", "expected"),
    [
        (0.5, -0.4, "supported"),  # by 50 %
        (0.5, None, "supported"),
        (0.8, -0.4, "direction only"),
        (1.3, -0.4, "contradicted"),
        (1.3, None, "contradicted"),
        (1.0, -0.4, "undecided"),
        (2.0, 0.5, "supported"),  # what is claimed to be worse
        (1.3, 0.5, "direction only"),
        (0.8, 0.5, "contradicted"),
    ],
)
def test_a_change_reaches_every_verdict(mine, size, expected):
    table = errors({"s": {"a": mine, "b": 1.0}}, spread=0.3)
    found = verdict(table, **CHANGE, **({} if size is None else {"size": size}))
    assert found["verdict"] == expected
    assert found["value"] == pytest.approx(mine - 1, abs=0.1)
    assert found["low"] < found["value"] < found["high"]
    assert np.isfinite(found["needed"]) == (expected == "undecided")


@pytest.mark.parametrize(
    ("definitions", "size", "expected", "otherwise"),
    [
        (["change", "ratio"], -0.66, "direction only", "as a ratio (-40 %): supported"),
        (["ratio", "change"], 1 / 1.66 - 1, "supported", "as a change (-66 %): direction only"),
        (["change"], -0.66, "direction only", ""),
    ],
)
def test_one_interval_has_one_verdict_and_says_what_the_other_definition_makes_of_it(
    definitions, size, expected, otherwise
):
    """40 % less error is 66 % better by the ratio, and only that."""
    table = judge(
        ledger(**{**CHANGE, "definitions": definitions, "size": -0.66}),
        errors({"s": {"a": 1 / 1.66, "b": 1.0}}, trials=100),
    )
    (row,) = table.to_dict("records")
    assert (row["verdict"], row["definition"], row["otherwise"]) == (expected, definitions[0], otherwise)
    assert (row["value"], row["size"]) == (pytest.approx(-0.4, abs=0.05), pytest.approx(size))
    assert (f"Read {otherwise}." in verdict_sentence(table.iloc[0])) == bool(otherwise)


@pytest.mark.parametrize(("size", "direction"), [(-0.3, 0.72), (0.5, 1.48)])
def test_a_direction_that_is_decided_without_its_size_is_told(size, direction):
    table = errors({"s": {"a": direction, "b": 1.0}}, spread=0.4, trials=20, rng=np.random.default_rng(4))
    found = verdict(table, **CHANGE, size=size)
    assert (found["verdict"], found["remark"]) == ("undecided", "the direction is decided, the size is not")


def test_no_difference_at_all_contradicts_better():
    table = errors({"s": {"b": 1.0}})
    equal = pd.concat([table, table.assign(estimator="a")])
    assert verdict(equal, **CHANGE)["verdict"] == "contradicted"
    alike = verdict(equal, kind="all", of="a", than="b", scenarios="s")
    assert (alike["verdict"], alike["value"]) == ("contradicted", 0)


def test_trials_needed_do_decide_and_a_quarter_of_them_do_not():
    rng = np.random.default_rng(5)
    claim = {**CHANGE, "scenarios": REPEATED[:60]}
    asked = judge(ledger(**claim), repeated(0.85, trials=20, spread=0.8, rng=rng))
    undecided = asked[asked["verdict"] == "undecided"]
    assert len(undecided) > 20
    needed = int(undecided["needed"].median())
    decided = [
        (judge(ledger(**claim), repeated(0.85, trials=n, spread=0.8, rng=rng))["verdict"] == "supported").mean()
        for n in (needed, needed // 4)
    ]
    assert decided[0] > 0.75
    assert decided[1] < 0.75


SWEEP = {"kind": "all", "of": "a", "than": ["b", "c"], "scenarios": "s/n={2..9}"}


def sweep(a, b=1.0, c=1.2):
    return {f"s/n={k}": {"a": level, "b": b, "c": c} for k, level in zip((1, 2, 5, 9), a, strict=True)}


@pytest.mark.parametrize(
    ("a", "expected", "where"),
    [
        ((2.0, 0.5, 0.7, 0.9), "supported", "s/n=9"),  # n = 1 is outside the range
        ((0.5, 0.5, 1.2, 0.7), "contradicted", "s/n=5"),
        ((0.5, 0.5, 1.0, 0.7), "undecided", "s/n=5"),
    ],
)
def test_all_is_decided_by_its_worst_case(a, expected, where):
    found = verdict(errors(sweep(a)), **SWEEP)
    assert (found["verdict"], found["scenario"], found["than"]) == (expected, where, "b")


@pytest.mark.parametrize(
    ("a", "expected"),
    [
        ((1.0, 0.5, 0.5, 0.5), "supported"),
        ((1.0, 0.9, 0.9, 0.9), "direction only"),
        ((1.0, 1.4, 1.4, 1.4), "contradicted"),
    ],
)
def test_a_trend_compares_the_first_scenario_with_each_later_one(a, expected):
    claim = {
        "kind": "trend",
        "of": "a",
        "size": -0.35,
        "definitions": ["change"],
        "scenarios": ["s/n=1", "s/n=5", "s/n=9"],
    }
    table = judge(ledger(**claim), errors(sweep(a), trials=200))
    assert table["verdict"].tolist() == [expected] * 2
    assert table["scenario"].tolist() == ["s/n=1 to s/n=5", "s/n=1 to s/n=9"]


@pytest.mark.parametrize(
    ("a", "expected"),
    [
        ((1.0, 1.0, 1.0, 1.0), "supported"),
        ((1.0, 1.04, 1.08, 1.3), "contradicted"),  # small steps add up
        ((1.0, 1.0, 1.0, 1.1), "undecided"),
    ],
)
def test_what_is_the_same_is_shown_by_equivalence(a, expected):
    rng = np.random.default_rng(3)
    common = rng.lognormal(0, 0.3, (60, 1))  # the scenarios of one seed
    frames = [
        rows("a", v**2 * common * rng.lognormal(0, 0.1, (60, ROBOTS)), scenario=f"s/n={k}", stream=f"{k}")
        for k, v in enumerate(a)
    ]
    found = verdict(pd.concat(frames), kind="same", of="a", scenarios="s/n={0..9}", margin=0.1)
    assert found["verdict"] == expected


@pytest.mark.parametrize(
    ("a", "expected"), [((1.0, 1.2, 2.0, 5.0), "supported"), ((5.0, 4.0, 2.0, 1.0), "contradicted")]
)
def test_growth_is_the_slope_of_the_logarithm(a, expected):
    found = verdict(errors(sweep(a)), kind="growth", of="a", scenarios="s/n={1..9}")
    assert found["verdict"] == expected
    assert found["value"] == pytest.approx(np.expm1(np.polyfit([1, 2, 5, 9], np.log(a), 1)[0]), abs=0.03)


@pytest.mark.parametrize(
    ("last", "noise", "expected"),
    [
        (1.0, 0.05, "flat"),
        (1.02, 0.005, "flat"),  # differs from no growth, and is too small to matter
        (1.3, 0.05, "supported"),
        (0.7, 0.05, "contradicted"),
        (1.05, 1.0, "undecided"),
    ],
)
def test_growth_may_be_flat_within_its_margin_over_the_whole_sweep(last, noise, expected):
    rng, frames = np.random.default_rng(0), []
    common = rng.lognormal(0, 0.3, (100, 1))  # the scenarios of one seed
    for k in (1, 2, 5, 9):
        mse = last ** ((k - 1) / 4) * common * rng.lognormal(0, noise, (100, ROBOTS))
        frames.append(rows("a", mse, scenario=f"s/n={k}", stream=f"{k}"))
    found = verdict(pd.concat(frames), kind="growth", of="a", scenarios="s/n={1..9}", margin=0.05)
    assert found["verdict"] == expected
    assert (found["p"] <= 0.05) == (expected != "undecided")
    assert (found["low"] > 0) == (last in (1.02, 1.3))


def with_covariances(anees, coverage, trials=40):
    spread = 1 + 0.1 * np.sin(np.repeat(np.arange(trials), ROBOTS))
    return errors({"s": {"a": 1.0}}, trials=trials).assign(anees=anees * spread, coverage95=coverage * spread**0.1)


@pytest.mark.parametrize(
    ("anees", "coverage", "expected"),
    [(1.0, 0.95, "supported"), (0.3, 0.99, "supported"), (6.0, 0.5, "contradicted"), (1.5, 0.95, "undecided")],
)
def test_over_convergence_is_judged_by_anees_and_coverage(anees, coverage, expected):
    found = verdict(with_covariances(anees, coverage), kind="consistency", of="a", scenarios="s")
    assert (found["verdict"], found["value"]) == (expected, pytest.approx(anees, rel=0.05))
    assert (found["p"] <= 0.05) == (expected != "undecided")


@pytest.mark.parametrize(("coverage", "expected"), [(0.5, "contradicted"), (0.95, "undecided")])
def test_where_one_collapsed_trial_makes_anees_useless_coverage_decides(coverage, expected):
    table = with_covariances(1.0, coverage)
    table.loc[table["trial"] == 3, "anees"] = 1e12
    assert verdict(table, kind="consistency", of="a", scenarios="s")["verdict"] == expected


@pytest.mark.parametrize(("seconds", "expected"), [(0.01, "supported"), (3.0, "contradicted"), (1.0, "undecided")])
def test_real_time_is_judged_by_the_seconds_of_a_robots_tick(seconds, expected):
    table = errors({"s": {"a": 1.0}}, trials=8)
    table["seconds"] = seconds * (1 + 0.05 * np.tile([-1, 1], 8)[table["trial"]])
    table["seconds"] += 1e-6 * table["trial"]  # every trial is a part of the run
    found = verdict(table, kind="time", of="a", scenarios="s", size=1.0)
    assert (found["verdict"], found["trials"]) == (expected, 8)
    assert f"{found['value'] * 1e3:.0f}" in verdict_sentence(found).replace(".00 ms", " ms")


@pytest.mark.parametrize(("b", "expected"), [(1.1, "supported"), (4.0, "contradicted"), (2.0, "undecided")])
def test_an_interaction_compares_losses(b, expected):
    table = errors({"s/d=0": {"a": 0.5, "b": 1.0}, "s/d=1": {"a": 1.0, "b": b}})
    found = verdict(table, kind="interaction", of="a", than="b", scenarios=["s/d=0", "s/d=1"])
    assert found["verdict"] == expected
    assert found["value"] == pytest.approx(2 / b - 1, abs=0.15)


@pytest.mark.parametrize(("a", "expected"), [(0.5, "supported"), (2.0, "contradicted"), (1.0, "undecided")])
def test_a_level_is_absolute(a, expected):
    size = np.exp(0.025)  # the root of the mean of what `errors` draws around 1
    assert verdict(errors({"s": {"a": a}}), kind="level", of="a", scenarios="s", size=size)["verdict"] == expected


def timed(powers, rng, sizes=(1, 3, 10, 30, 100)):
    """Rows whose seconds grow with a power of the team's size; each trial is a part of the run."""
    frames = []
    for n in sizes:
        table = errors({f"s/n={n}": dict.fromkeys(powers, 1.0)}, trials=8).assign(robots=n)
        for name, (level, power) in powers.items():
            mine = table["estimator"] == name
            noise = np.repeat(rng.lognormal(0, 0.02, 8), ROBOTS)
            table.loc[mine, "seconds"] = level * n**power * noise
        frames.append(table)
    return pd.concat(frames, ignore_index=True)


@pytest.mark.parametrize(("power", "expected"), [(0.9, "supported"), (2.0, "contradicted")])
def test_a_slope_is_the_exponent_of_the_cost(power, expected):
    table = timed({"a": (1e-4, power)}, np.random.default_rng(0))
    found = verdict(table, kind="slope", of="a", scenarios="s/n={1..100}", size=1.0, margin=0.1)
    assert found["verdict"] == expected
    assert found["value"] == pytest.approx(power, abs=0.02)
    assert found["trials"] == 5


@pytest.mark.parametrize(("level", "expected"), [(5e-5, "supported"), (2e-4, "contradicted")])
def test_a_cost_is_compared_by_parts_of_the_run(level, expected):
    table = timed({"a": (level, 1), "b": (1e-4, 1)}, np.random.default_rng(1), sizes=(3,))
    found = verdict(table, kind="cost", of="a", than="b", scenarios="s/n=3")
    assert (found["verdict"], found["trials"]) == (expected, 8)
    assert found["value"] == pytest.approx(level / 1e-4 - 1, abs=0.1)
    one_part = verdict(table.assign(seconds=1e-4), kind="cost", of="a", than="b", scenarios="s/n=3")
    assert (one_part["verdict"], one_part["trials"]) == ("undecided", 1)
    assert "fewer than 5" in one_part["remark"]


def test_what_cannot_be_tested_says_why():
    found = verdict(errors({"s": {"a": 1.0}}), kind="untestable", why="it is geometry")
    assert (found["verdict"], found["remark"]) == ("not testable", "it is geometry")


@pytest.mark.parametrize(
    ("claim", "missing"),
    [
        ({**CHANGE, "than": "bb"}, "no rows of bb in s; did you mean 'b'?"),
        ({**CHANGE, "scenarios": "t"}, "no rows of scenario t"),
        ({**SWEEP, "scenarios": "s/k={2..9}"}, r"no rows of any scenario s/k={2..9}"),
        ({"kind": "growth", "of": "a", "scenarios": "s"}, "growth needs three scenarios, the run has s"),
        ({"kind": "slope", "of": "a", "scenarios": "s", "size": 1}, "five sizes, the run has 1"),
        ({"kind": "same", "of": "a", "scenarios": "s", "margin": 0.1}, "only s was run"),
    ],
)
def test_what_was_not_run_says_what_is_missing(claim, missing):
    found = verdict(errors({"s": {"a": 1.0, "b": 1.0}}), **claim)
    assert found["verdict"] == "not run"
    assert missing in found["remark"]


def test_below_five_trials_nothing_is_decided():
    found = verdict(errors({"s": {"a": 0.1, "b": 1.0}}, trials=4), **CHANGE)
    assert (found["verdict"], found["remark"]) == ("undecided", "fewer than 5 trials")


def test_over_confidence_failures_and_centralised_estimators_are_told():
    table = errors({"s": {"a": 0.5, "b": 1.0}})
    table.loc[table["estimator"] == "a", "anees"] = 4.0
    table["failure"] = None
    table.loc[(table["estimator"] == "b") & (table["trial"] == 3), "failure"] = "boom"
    table.loc[table["estimator"] == "b", "centralised"] = True
    found = verdict(table, **CHANGE)
    failed = "it would be supported, but b failed"
    assert found["remark"] == f"{failed}; a over-confident; 1 trial of b failed; b is centralised"
    assert (found["verdict"], found["p"]) == ("undecided", 1.0)
    assert found["trials"] == TRIALS - 1


@pytest.mark.parametrize("lost", [np.nan, np.inf, 1e200])
def test_an_error_that_is_not_finite_supports_no_claim(lost):
    table = errors({"s": {"a": 0.5, "b": 1.0}})
    table.loc[(table["estimator"] == "a") & (table["trial"] == 3) & (table["robot"] == 0), "mse"] = lost
    found = verdict(table, **CHANGE)
    assert (found["verdict"], found["trials"]) == ("undecided", TRIALS - 1)
    assert found["remark"] == "it would be supported, but a failed; 1 trial of a failed"


def test_a_failed_check_supports_no_claim_and_a_passed_one_does():
    table = errors({"s": {"a": 0.5, "b": 1.0}})
    for line, expected in {"failed: causality: it peeks": "undecided", "passed: 17 checks": "supported"}.items():
        checked = table.assign(certificate=np.where(table["estimator"] == "a", line, ""))
        assert verdict(checked, **CHANGE)["verdict"] == expected


@pytest.mark.parametrize(("who", "expected"), [("a", "contradicted"), ("b", "undecided")])
def test_no_estimator_escapes_a_contradiction_by_failing_and_none_earns_one(who, expected):
    table = errors({"s": {"a": 1.5, "b": 1.0}})
    table.loc[(table["estimator"] == who) & (table["trial"] == 3), "mse"] = np.inf
    assert verdict(table, **CHANGE)["verdict"] == expected


def test_trials_that_err_far_more_than_usual_are_told_with_a_verdict():
    table = errors({"s": {"a": 0.5, "b": 1.0}})
    table.loc[(table["estimator"] == "b") & (table["trial"] == 3), "mse"] *= 400
    said = "1 trial of b errs 5 times as much as the median one: intervals are too narrow"
    assert said in verdict(table, **CHANGE)["remark"]


def test_trials_pair_by_number_and_not_by_order():
    table = errors({"s": {"b": 1.0}})
    half = table.assign(estimator="a", mse=table["mse"] / 4).sample(frac=1, random_state=0)
    found = verdict(pd.concat([table, half]), **CHANGE)
    assert (found["value"], found["low"], found["high"]) == pytest.approx((-0.5, -0.5, -0.5), abs=1e-6)


def test_rows_of_different_streams_are_refused():
    table = errors({"s": {"a": 1.0, "b": 1.0}})
    table.loc[table["estimator"] == "a", "stream"] += "x"
    with pytest.raises(cl.BadInput, match="different streams"):
        judge(ledger(**CHANGE), table)


@pytest.mark.parametrize(
    ("claim", "level", "false"),
    [
        (CHANGE, 1.0, ("supported", "contradicted")),
        ({**CHANGE, "size": -0.3}, 0.75, ("supported", "contradicted")),  # the edge of 0.3 less its margin
        ({**CHANGE, "size": -0.3}, 0.7, ("direction only", "contradicted")),
        ({"kind": "level", "of": "a", "scenarios": "s", "size": np.exp(0.09 / 4)}, 1.0, ("supported", "contradicted")),
    ],
)
def test_a_false_verdict_comes_at_most_once_in_twenty(claim, level, false):
    """Here at the edges, where it is hardest; make prove has all kinds, more trials and other distributions."""
    claim = {**claim, "scenarios": REPEATED}
    found = judge(ledger(**claim), repeated(level, trials=20, spread=0.01, rng=np.random.default_rng(6)))
    wrong = found["verdict"].isin(false).mean()
    assert wrong < 0.05 + 3 * np.sqrt(0.05 * 0.95 / len(REPEATED))


# ---------------------------------------------------------------- the ledger


def test_a_variant_replaces_all_scenarios_of_a_claim_or_none():
    content = {
        "paper": "p",
        "claims": [
            {"id": "1", "says": "x", **CHANGE},
            {"id": "2", "says": "y", "kind": "trend", "of": "a", "scenarios": ["s", "t"]},
        ],
        "variants": {"other": {"estimators": {"b": "b[k=1]"}}, "world": {"scenarios": {"s": "s2"}}},
    }
    made = read(content, "l.toml")
    assert [name for name, _ in variants(made.claims[0], made)] == ["paper", "other", "world"]
    assert [name for name, _ in variants(made.claims[1], made)] == ["paper"]
    table = errors({"s": {"a": 0.5, "b": 1.0, "b[k=1.0]": 0.2}})
    found = judge(made, table)
    assert found["verdict"].tolist() == ["supported", "contradicted", "not run", "not run"]
    assert overview(found).loc["1"].tolist() == ["supported", "contradicted"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"paper": "p", "clams": []}, "ledger: there is no key 'clams'; did you mean 'claims'?"),
        ({"paper": "p", "claims": [{"id": "7", "sais": "x"}]}, "claim '7': there is no key 'sais'; did you"),
        (
            {"paper": "p", "claims": [{"id": "7", "says": "x", "kind": "levle"}]},
            "no kind 'levle'; did you mean 'level'?",
        ),
        ({"paper": "p", "claims": [{"id": "7", "says": "x"}]}, "kind: Field required"),
        ({"paper": "p", "claims": []}, "claims"),
        ({"paper": "p", "claims": [{"id": "7", "says": "x", "kind": "level", "of": "a", "scenarios": "s"}]}, "'size'"),
        ({"paper": "p", "claims": [{"id": "7", "says": "x", **CHANGE, "why": "x"}]}, "does not use 'why'"),
        (
            {"paper": "p", "claims": [{"id": "7", "says": "x", **CHANGE, "size": -0.03}]},
            "size -0.03 is not beyond margin",
        ),
        ({"paper": "p", "claims": [{"id": "7", "says": "x", **CHANGE, "size": "big"}]}, "size"),
        ({"paper": "p", "claims": [{"id": "7", "says": "x", **CHANGE}] * 2}, "two claims of that id"),
        ({"paper": "p", "claims": [{"id": "7", "says": "x", **CHANGE, "scenarios": "s/n={1..3}"}]}, "takes no range"),
        (
            {"paper": "p", "claims": [{"id": "7", "says": "x", "kind": "trend", "of": "a", "scenarios": "s"}]},
            "at least 2 scenarios",
        ),
        (
            {"paper": "p", "claims": [{"id": "7", "says": "x", **CHANGE}], "variants": {"paper": {}}},
            "cannot be called 'paper'",
        ),
        (
            {"paper": "p", "claims": [{"id": "7", "says": "x", **CHANGE}], "variants": {"v": {"estimator": {}}}},
            "did you mean 'estimators'?",
        ),
    ],
)
def test_a_bad_ledger_is_refused_in_one_line(content, said):
    with pytest.raises(cl.BadInput) as caught:
        read(content, "l.toml")
    assert said in str(caught.value)
    assert str(caught.value).startswith("l.toml")
    assert "\n" not in str(caught.value)


def test_a_ledger_that_is_not_there_or_not_toml_is_refused(tmp_path):
    with pytest.raises(cl.BadInput, match="cannot be read"):
        load(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("paper = ")
    with pytest.raises(cl.BadInput, match="not a TOML file"):
        load(tmp_path / "bad.toml")


def test_a_ledger_for_another_paper_is_ten_lines(tmp_path):
    lines = 'paper = "other"\n[[claims]]\nid = "1"\nsays = "x"\nkind = "level"\nof = "a"\nscenarios = "s"\nsize = 2.0\n'
    (tmp_path / "other.toml").write_text(lines)
    assert judge(load(tmp_path / "other.toml"), errors({"s": {"a": 1.0}}))["verdict"].item() == "supported"


def test_the_papers_ledger_names_what_exists():
    made = load()
    assert {claim.id.rstrip("bc") for claim in made.claims} == {str(k) for k in range(1, 24)}
    assert all(claim.quote for claim in made.claims)
    for claim in made.claims:
        for _, read_ in variants(claim, made):
            for name in (*read_.of, *read_.than):
                make(name)
            for label in read_.scenarios:
                resolve(re.sub(r"{\d+\.\.(\d+)}", r"\1", label))


def of_the_paper(claim, table):
    """The verdicts on one claim of the paper, as it stands."""
    made = load()
    (one,) = (c for c in made.claims if c.id == claim)
    found = judge(made.model_copy(update={"claims": (one,), "variants": {}}), table)
    return found.loc[found["verdict"] != "not run", "verdict"].tolist()


BOTH = ("mrsl-rssi", "mrsl-distance")


@pytest.mark.parametrize(
    ("claim", "levels", "expected"),
    [
        ("6", {f"scalability/n={n}": 1.0 for n in (1, 10, 99)}, "flat"),
        ("6", {f"scalability/n={n}": 1.02**n for n in (1, 10, 99)}, "supported"),
        ("6", {f"scalability/n={n}": 0.98**n for n in (1, 10, 99)}, "contradicted"),
        ("19", {"arena-28m": 1.0, "arena-28m/r=40": 1.0}, "supported"),
        ("19", {"arena-28m": 1.0, "arena-28m/r=40": 1.3}, "contradicted"),
        ("19b", {"arena-28m/r=40": 1.0}, "supported"),
        ("19b", {"arena-28m/r=40": 3.0}, "contradicted"),
        ("21", {"robots-1-3/n=1": 1.0, "robots-1-3/n=2": 0.8, "robots-1-3/n=3": 0.6}, "supported"),
        ("21", {"robots-1-3/n=1": 1.0, "robots-1-3/n=2": 1.2, "robots-1-3/n=3": 1.4}, "contradicted"),
        ("22", {"scalability/n=11": 0.3, "scalability/n=51": 0.3, "scalability/n=99": 0.3}, "supported"),
        ("22", {"scalability/n=11": 3.0, "scalability/n=51": 3.0, "scalability/n=99": 3.0}, "contradicted"),
    ],
)
def test_a_claim_of_the_paper_can_come_out_either_way(claim, levels, expected):
    names = (*BOTH, "arl", "rssi-pf", "mrsl-rssi[anchor_reading=rssi]")
    table = errors({label: dict.fromkeys(names, level) for label, level in levels.items()}, spread=0.02)
    assert set(of_the_paper(claim, same_trials(table))) == {expected}


def same_trials(table):
    """What is hard in a trial is hard in all scenarios."""
    hard = errors({"s": {"a": 1.0}})["mse"].to_numpy()
    level = table.groupby("scenario")["mse"].transform("median")
    return table.assign(mse=level * np.resize(hard, len(table)))


@pytest.mark.parametrize(("anees", "expected"), [(1.0, "supported"), (6.0, "contradicted")])
def test_over_convergence_of_mrsl_can_come_out_either_way(anees, expected):
    table = errors({"robots-1-3/n=3": dict.fromkeys(BOTH, 1.0)}, anees=anees)
    table["anees"] *= 1 + 0.01 * (table["trial"] % 5)
    assert of_the_paper("20", table.assign(coverage95=0.95)) == [expected] * 2


@pytest.mark.parametrize(("seconds", "expected"), [(1e-3, "supported"), (5.0, "contradicted")])
def test_real_time_of_mrsl_can_come_out_either_way(seconds, expected):
    table = errors({"scalability/n=99": dict.fromkeys(BOTH, 1.0)})
    assert of_the_paper("23", table.assign(seconds=seconds * (1 + 0.001 * table["trial"]))) == [expected] * 2


def test_every_kind_is_used_and_can_be_told():
    assert {claim.kind for claim in load().claims} == set(KINDS) - {"untestable"}
    assert all(kind.grows for name, kind in KINDS.items() if name != "untestable")


def test_labels_are_compared_by_what_they_mean():
    assert canonical("packet-drop/drop=0.70") == canonical("packet-drop/drop=.7")
    assert canonical("m[anchor_reading=rssi,K=1]") == canonical("m[K=1.0,own=rssi]")
    assert canonical("m[temper=False]") == canonical("m[temper=false]") != canonical("m")


def test_a_sentence_says_what_the_numbers_say():
    table = errors({"s": {"a": 1.5, "b": 1.0}}, rng=np.random.default_rng(2))
    found = judge(ledger(**{**CHANGE, "size": -0.4}), table).iloc[0]
    low, high = (f"{100 * found[end]:+.0f} %" for end in ("low", "high"))
    assert verdict_sentence(found) == (
        f"s: the RMSE of a is {100 * found['value']:.0f} % higher than that of b (95 % interval {low} to {high}, "
        "40 trials). Claimed: -40 %. Contradicted."
    )
    equal = judge(ledger(**CHANGE), pd.concat([table[table["estimator"] == "b"].assign(estimator=e) for e in "ab"]))
    assert verdict_sentence(equal.iloc[0]) == "s: the RMSE of a equals that of b in each of 40 trials. Contradicted."
    missing = judge(ledger(**{**CHANGE, "than": "zz"}), table).iloc[0]
    assert verdict_sentence(missing).startswith("Not run: no rows of zz in s")


def said(value, low, high, definition="change", **more):
    row = {"scenario": "s", "of": "a", "than": "b", "kind": "change", "definition": definition, "size": np.nan}
    row |= {"value": value, "low": low, "high": high, "trials": 9, "needed": np.nan, "verdict": "undecided"}
    return verdict_sentence(pd.Series(row | more))


def test_a_number_without_an_interval_is_said_to_have_none():
    assert "50 % higher than that of b (no 95 % interval, 9 trials)" in said(0.5, np.nan, np.nan)
    assert "50 % lower than that of b (95 % interval -60 % to +10 %, 9 trials)" in said(-0.5, -0.6, 0.1)


def test_a_size_that_is_claimed_as_a_ratio_is_said_to_be_one():
    assert "Claimed, as a ratio of errors: -40 %." in said(-0.5, -0.6, -0.4, "ratio", size=1 / 1.66 - 1)


def test_a_change_from_an_error_of_zero_is_not_put_into_numbers():
    zero = errors({"s": {"a": 1.0, "b": 1.0}}).assign(mse=lambda t: t["mse"].where(t["estimator"] == "a", 0.0))
    (found,) = judge(ledger(**CHANGE), zero).to_dict("records")
    assert np.isnan(found["value"])
    assert "an RMSE of 0 leaves no number to give (40 trials)" in verdict_sentence(pd.Series(found))


def test_nearly_all_is_not_rounded_to_all():
    told = said(-0.99926, -0.99948, -0.9989)
    assert "99.926 % lower than that of b (95 % interval -99.948 % to -99.89 %" in told
    assert "more than 100000 trials would decide" in said(0.001, -0.1, 0.1, needed=3.3e6)


def test_a_change_that_rounds_to_nothing_has_no_sign():
    assert "is 0.00 % lower than that of b (95 % interval -0.01 % to 0.00 %" in said(-1e-6, -1e-4, 1e-6)


def test_what_was_run_of_a_claim_is_shown_and_what_was_not_is_counted(capsys):
    made = load()
    found = cl.verdicts(errors({"robots-1-3/n=3": {"mrsl-rssi": 0.5, "arl": 1.0}}), made)
    assert list(found.columns) == [*COLUMNS, "map", "sentence"]
    assert set(found["verdict"]) <= set(VERDICTS)
    assert [verdict_sentence(row) for _, row in found.iterrows()]
    show_verdicts(found, made)
    told = capsys.readouterr().out
    assert "Direction only" in told
    assert "not run: 2 of 3 cases: no rows of scenario robots-1-3/n=2; no rows of scenario scalability/n=11\n" in told
    assert "Not run at all, as this run lacks their scenarios or estimators: claims 2, 3, " in told
    assert "hardware: " not in told

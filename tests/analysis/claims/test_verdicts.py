"""Verdicts on rows whose truth is known: each is reached, false ones are rare, p agrees, Holm bounds them."""

import re
from functools import partial

import numpy as np
import pandas as pd
import pytest
from made_errors import rows
from made_runs import rows_of
from scipy.stats import norm

import cooploc as cl
from cooploc.analysis.claims import verdicts
from cooploc.analysis.claims.kinds import FALLS, decide
from cooploc.analysis.claims.ledger import load, read, variants
from cooploc.analysis.claims.verdicts import DECIDED, JUDGED, adjust, judge, overview, verdict_sentence
from cooploc.analysis.metrics import sequential
from cooploc.analysis.metrics.statistics import change, holm, p_of_change
from cooploc.estimators import make
from cooploc.scenarios import resolve

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


@pytest.mark.parametrize(("who", "expected"), [("a", "contradicted"), ("b", "undecided")])
def test_no_estimator_escapes_a_contradiction_by_failing_and_none_earns_one(who, expected):
    table = errors({"s": {"a": 1.5, "b": 1.0}})
    table.loc[(table["estimator"] == who) & (table["trial"] == 3), "mse"] = np.inf
    assert verdict(table, **CHANGE)["verdict"] == expected


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


def claim_with(**keys):
    return {"paper": "p", "claims": [{"id": "7", "says": "x", **keys}]}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"paper": "p", "clams": []}, "l.toml: there is no key 'clams'; did you mean 'claims'?"),
        (claim_with(sais="x"), "claim '7': there is no key 'sais'; did you"),
        (claim_with(kind="levle"), "no kind 'levle'; did you mean 'level'?"),
        (claim_with(), "kind: it is missing"),
        ({"paper": "p", "claims": []}, "claims"),
        (claim_with(kind="level", of="a", scenarios="s"), "'size'"),
        (claim_with(**CHANGE, why="x"), "does not use 'why'"),
        (claim_with(**CHANGE, size=-0.03), "size -0.03 is not beyond margin"),
        (claim_with(**CHANGE, size="big"), "size"),
        ({"paper": "p", "claims": [{"id": "7", "says": "x", **CHANGE}] * 2}, "two claims of that id"),
        (claim_with(**{**CHANGE, "scenarios": "s/n={1..3}"}), "takes no range"),
        (claim_with(kind="trend", of="a", scenarios="s"), "at least 2 scenarios"),
        ({**claim_with(**CHANGE), "variants": {"paper": {}}}, "cannot be called 'paper'"),
        ({**claim_with(**CHANGE), "variants": {"v": {"estimator": {}}}}, "did you mean 'estimators'?"),
    ],
)
def test_a_bad_ledger_is_refused_in_one_line(content, said):
    with pytest.raises(cl.BadInput, match=r"\Al\.toml: .*\Z") as caught:
        read(content, "l.toml")
    assert said in str(caught.value)


def test_a_ledger_that_is_not_there_or_not_toml_is_refused(tmp_path):
    with pytest.raises(cl.BadInput, match="cannot be read"):
        load(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("paper = ")
    with pytest.raises(cl.BadInput, match="not a TOML file"):
        load(tmp_path / "bad.toml")


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


def test_a_change_from_an_error_of_zero_is_not_put_into_numbers():
    zero = errors({"s": {"a": 1.0, "b": 1.0}}).assign(mse=lambda t: t["mse"].where(t["estimator"] == "a", 0.0))
    (found,) = judge(ledger(**CHANGE), zero).to_dict("records")
    assert np.isnan(found["value"])
    assert "an RMSE of 0 leaves no number to give (40 trials)" in verdict_sentence(pd.Series(found))


CLAIMS = [
    {"id": "1", "says": "better", "kind": "change", "of": "mine", "than": "base", "scenarios": "s"},
    {"id": "2", "says": "quicker", "kind": "cost", "of": "mine", "than": "base", "scenarios": "s"},
    {"id": "3", "says": "elsewhere", "kind": "change", "of": "mine", "than": "base", "scenarios": "t"},
    {"id": "4", "says": "beyond any test", "kind": "untestable", "why": "none"},
]
LEDGER = read({"paper": "P", "claims": CLAIMS}, "here")


@pytest.fixture
def looked():
    """Forty trials in which `mine` errs half as much at first, and exactly as much later."""
    made = rows_of("s", {"base": (1.0, 1.0), "mine": (1.0, 1.0)}, trials=40)
    noise = np.exp(np.random.default_rng(2).normal(0, 0.2, (2, 40)))
    noise[1, :20] /= 4
    return made.assign(mse=noise.ravel())


def verdicts_of(found, claim):
    return found[found["claim"] == claim].iloc[0]


def test_a_verdict_keeps_the_look_that_reached_it(looked):
    found = verdicts.judge_run(LEDGER, looked, [10, 20, 40])
    one = verdicts_of(found, "1")
    assert (one["verdict"], one["look"], one["trials"]) == ("supported", 10, 10)
    assert verdicts.verdict_text(one) == "Supported at n = 10"
    assert verdicts_of(found, "3")["look"] == verdicts_of(found, "4")["look"] == 0


def test_what_is_open_keeps_its_cells_going_and_time_never_does(looked):
    equal = looked.assign(mse=np.exp(np.random.default_rng(8).normal(0, 0.3, 80)))
    found = verdicts.judge_at_look(LEDGER, equal, 10)
    assert verdicts_of(found, "1")["verdict"] == "undecided"
    assert verdicts.open_cells(LEDGER, equal, found) == {("s", "mine"), ("s", "base")}
    assert list(verdicts.lasting(LEDGER, found)["claim"]) == ["1"]
    decided = verdicts.judge_at_look(LEDGER, looked, 10)
    assert verdicts.open_cells(LEDGER, looked, decided) == set()


SCENARIOS = [f"s/n={k}" for k in range(40)]
FAMILY_KINDS = {
    "change": {"than": "b"},
    "change of a size": {"than": "b", "size": -0.3},
    "trend": {},
    "all": {"than": "b"},
    "same": {"margin": 0.1},
    "growth": {"margin": 0.1},
    "interaction": {"than": "b"},
    "level": {"size": 1.1},
    "consistency": {},
    "time": {"size": 1e-4},
}


def family_ledger(**claims):
    return read({"paper": "p", "claims": [{"id": i, "says": "x", "of": "a", **one} for i, one in claims.items()]}, "l")


def family_run(rng, levels, trials=20, labels=SCENARIOS):
    """Rows of `a`, whose RMSE is a level in each scenario, and of `b`, whose RMSE is 1."""
    frames = []
    for label, level in zip(labels, levels, strict=True):
        hard = rng.lognormal(0, 0.3, (trials, 1))
        for name, rmse in (("a", level), ("b", 1.0)):
            frame = rows(name, rmse**2 * hard * rng.lognormal(0, 0.3, (trials, 1)), scenario=label, stream=label)
            own = rng.lognormal(0, 0.3, trials)
            frames.append(frame.assign(anees=1.4 * own, coverage95=0.87 + 0.02 * np.log(own), seconds=1e-4 * own))
    return pd.concat(frames, ignore_index=True)


@pytest.mark.parametrize("kind", FAMILY_KINDS)
def test_a_verdict_is_decided_where_its_p_is_at_most_five_percent(kind):
    """Ten groups of scenarios, whose truths lie around the edges of the zones."""
    rng = np.random.default_rng(1)
    groups = [SCENARIOS[k::10] for k in range(10)]
    table = family_run(rng, np.linspace(0.6, 1.25, 40))
    claims = {
        str(k): {"kind": kind.split()[0], "scenarios": group, **FAMILY_KINDS[kind]} for k, group in enumerate(groups)
    }
    found = judge(family_ledger(**claims), table)
    decided = found["verdict"].isin(DECIDED)
    assert found["verdict"].isin(JUDGED).all()
    ever = judge(family_ledger(**claims), table, sequential.ANYTIME)  # a sequence asks more than one look
    if kind != "time":
        assert (ever["high"] - ever["low"] > found["high"] - found["low"])[ever["value"] == found["value"]].all()
    assert ((found["p"] <= 0.05) == decided).all()
    assert decided.sum() > 0


def test_a_case_that_a_variant_leaves_as_it_is_counts_once():
    claim = {"id": "1", "says": "x", "kind": "change", "of": "a", "than": ["b", "c"], "scenarios": SCENARIOS[:5]}
    variant = {"other": {"estimators": {"c": "d"}}}
    table = family_run(np.random.default_rng(5), [0.9, 0.8, 0.7, 0.95, 1.0], labels=SCENARIOS[:5])
    others = [table[table["estimator"] == "b"].assign(estimator=name, mse=lambda t: 1.1 * t["mse"]) for name in "cd"]
    found = judge(read({"paper": "p", "claims": [claim], "variants": variant}, "l"), pd.concat([table, *others]))
    assert (len(found), verdicts.count_verdicts(found).judged) == (20, 15)
    alike = found[found["than"] == "b"].sort_values(["scenario", "variant"])["p_holm"].to_numpy().reshape(5, 2)
    np.testing.assert_array_equal(alike[:, 0], alike[:, 1])
    different = found.drop_duplicates(["scenario", "of", "than"])
    np.testing.assert_allclose(different["p_holm"], holm(different["p"].to_numpy()))


def judged_changes(rng, levels, trials=20):
    """The verdicts on "better" of a family of cases with these true ratios of errors."""
    found = []
    for level in levels:
        hard = rng.lognormal(0, 0.3, (trials, 1))
        a, b = (hard * rng.lognormal(0, 0.3, (trials, 2)) * [1.0, level**2]).T
        one = decide(change(a, b), trials, FALLS, partial(p_of_change, a, b))
        found.append({"verdict": one.verdict, "p": one.p})
    return adjust(
        pd.DataFrame(found).assign(claim="1", scenario=SCENARIOS[: len(found)], of="", than="", definition="")
    )


@pytest.mark.slow
def test_holm_bounds_the_chance_of_any_false_verdict_and_the_number_of_false_ones_is_foreseen():
    """Half of the truths lie at the edge of "better", where either verdict counts as false; the others far from it."""
    rng, repeats, half = np.random.default_rng(4), 200, 10
    wrong, standing, foreseen = [], [], []
    for _ in range(repeats):
        found = judged_changes(rng, [1.0] * half + [0.5] * half)
        false = found["verdict"].isin(DECIDED) & (found.index < half)
        wrong.append(false.sum())
        standing.append((false & found["stands"]).any())
        foreseen.append(verdicts.count_verdicts(found).expected)
    assert np.mean(standing) < 0.05 + 3 * np.sqrt(0.05 * 0.95 / repeats)
    assert np.mean(wrong) < np.mean(foreseen) + 3 * np.std(wrong) / np.sqrt(repeats)
    assert np.mean(foreseen) < 0.05 * 2 * half  # fewer than if every truth lay at an edge

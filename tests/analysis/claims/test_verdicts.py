"""Verdicts on rows whose truth is known: each is reached, false ones are rare, p agrees, Holm bounds them."""

import re
from functools import partial

import numpy as np
import pandas as pd
import pytest
from made_errors import rows
from scipy.stats import norm

import cooploc as cl
from cooploc.analysis.claims import verdicts
from cooploc.analysis.claims.kinds import FALLS, decide, decide_all
from cooploc.analysis.claims.ledger import load, read, variants
from cooploc.analysis.claims.verdicts import DECIDED, adjust, judge, overview, verdict_sentence
from cooploc.analysis.metrics.statistics import FIXED, holm
from cooploc.estimators import make, registry
from cooploc.scenarios import resolve

TRIALS, ROBOTS = 40, 2


def without_luck():
    """Draws the quantiles of a lognormal, each column in an order of its own: the median is the truth, for any seed."""
    rng = np.random.default_rng(0)

    def lognormal(mean, sigma, shape):
        quantiles = np.exp(mean + sigma * norm.ppf((np.arange(shape[0]) + 0.5) / shape[0]))
        return rng.permuted(np.broadcast_to(quantiles[:, None], shape), axis=0)

    return lognormal


def errors(rmse, trials=TRIALS, spread=0.1, rng=None):
    """Rows of {scenario: {estimator: RMSE}}; what is hard in a trial is hard for all estimators."""
    lognormal = rng.lognormal if rng else without_luck()
    frames = []
    for name, estimators in rmse.items():
        hard = lognormal(0, 0.3, (trials, 1))
        for estimator, level in estimators.items():
            mse = level**2 * hard * lognormal(0, spread, (trials, ROBOTS))
            frames.append(rows(estimator, mse, scenario=name, stream=name))
    return pd.concat(frames, ignore_index=True)


def ledger(**claim):
    return read({"paper": "p", "claims": [{"id": "1", "says": "it is so", **claim}]}, "l.toml")


def verdict(table, **claim):
    return judge(ledger(**claim), table).iloc[0]


def two(a, b=1.0, **how):
    return errors({"s": {"a": a, "b": b}}, **how)


def swept(levels, noise, trials):
    """Rows of `a` in scenarios s/n=k of one seed: a trial is as hard in all."""
    rng = np.random.default_rng(3)
    common = rng.lognormal(0, 0.3, (trials, 1))
    frames = [
        rows("a", v**2 * common * rng.lognormal(0, noise, (trials, ROBOTS)), scenario=f"s/n={k}", stream=f"{k}")
        for k, v in levels.items()
    ]
    return pd.concat(frames)


def growing(last, noise, label="s/n={}"):
    found = swept({k: last ** ((k - 1) / 8) for k in (1, 2, 5, 9)}, noise, 100)
    return found.assign(scenario=found["scenario"].map({f"s/n={k}": label.format(k) for k in (1, 2, 5, 9)}))


def with_covariances(anees, coverage):
    spread = 1 + 0.1 * np.sin(np.repeat(np.arange(TRIALS), ROBOTS))
    return errors({"s": {"a": 1.0}}).assign(anees=anees * spread, coverage95=coverage * spread**0.1)


def sending(byte_count):
    table = two(1.0)
    return table.assign(bytes=np.where(table["estimator"] == "a", byte_count, 48.0))


def timed(power, level=1e-4, sizes=(1, 3, 10, 30, 100)):
    """Rows of `a` and `b`, whose seconds grow with a power of the team's size; each trial is a part of the run."""
    rng, frames = np.random.default_rng(1), []
    for n in sizes:
        table = errors({f"s/n={n}": {"a": 1.0, "b": 1.0}}, trials=8).assign(robots=n)
        noise = np.repeat(rng.lognormal(0, 0.02, 16), ROBOTS)
        frames.append(table.assign(seconds=np.where(table["estimator"] == "a", level, 1e-4) * n**power * noise))
    return pd.concat(frames, ignore_index=True)


CHANGE = {"kind": "change", "of": "a", "than": "b", "scenarios": "s", "definitions": ["change"]}
LESS, MORE = {**CHANGE, "size": -0.4}, {**CHANGE, "size": 0.5}
SAME = {"kind": "same", "of": "a", "scenarios": "s/n={0..9}", "margin": 0.1}
GROWTH = {"kind": "growth", "of": "a", "scenarios": "s/n={1..9}", "margin": 0.05}
CONSISTENCY = {"kind": "consistency", "of": "a", "scenarios": "s"}
TIME = {"kind": "time", "of": "a", "scenarios": "s/n=3", "size": 1.0}
INTERACTION = {"kind": "interaction", "of": "a", "than": "b", "scenarios": ["s/d=0", "s/d=1"]}
SLOPE = {"kind": "slope", "of": "a", "scenarios": "s/n={1..100}", "size": 1.0, "margin": 0.1}
COST = {"kind": "cost", "of": "a", "than": "b", "scenarios": "s/n=3"}
TRAFFIC = {"kind": "traffic", "of": "a", "than": "b", "scenarios": "s"}


@pytest.mark.parametrize(
    ("claim", "table", "expected", "value"),
    [
        (LESS, two(0.5, spread=0.3), "supported", -0.5),
        (CHANGE, two(0.5, spread=0.3), "supported", -0.5),
        (LESS, two(0.8, spread=0.3), "direction only", -0.2),
        (LESS, two(1.3, spread=0.3), "contradicted", 0.3),
        (CHANGE, two(1.3, spread=0.3), "contradicted", 0.3),
        (LESS, two(1.0, spread=0.3), "undecided", 0.0),
        (MORE, two(2.0, spread=0.3), "supported", 1.0),
        (MORE, two(1.3, spread=0.3), "direction only", 0.3),
        (MORE, two(0.8, spread=0.3), "contradicted", -0.2),
        (SAME, swept({0: 1.0, 1: 1.0, 2: 1.0, 3: 1.0}, 0.1, 60), "supported", 0.0),
        (SAME, swept({0: 1.0, 1: 1.04, 2: 1.08, 3: 1.3}, 0.1, 60), "contradicted", 0.3),  # small steps add up
        (SAME, swept({0: 1.0, 1: 1.0, 2: 1.0, 3: 1.1}, 0.1, 60), "undecided", 0.1),
        (SAME, swept({0: 1.0, 1: 1 / 1.09, 2: 1.0}, 0.002, 60), "supported", -0.08),
        (SAME, swept({0: 1.0, 1: 1 / 1.105, 2: 1.0}, 0.002, 60), "contradicted", -0.1),
        (GROWTH, growing(1.0, 0.05), "flat", 0.0),
        (GROWTH, growing(1.02, 0.005), "flat", 0.0025),  # differs from no growth, and is too small to matter
        (GROWTH, growing(1.3, 0.05), "supported", 0.033),
        (GROWTH, growing(0.7, 0.05), "contradicted", -0.044),
        ({**GROWTH, "scenarios": "s/k=2[b=1,n={1..9}]"}, growing(1.3, 0.05, "s/k=2[n={},b=1]"), "supported", 0.033),
        (GROWTH, growing(1.05, 1.0), "undecided", 0.006),
        (CONSISTENCY, with_covariances(1.0, 0.95), "supported", 1.0),
        (CONSISTENCY, with_covariances(0.3, 0.99), "supported", 0.3),
        (CONSISTENCY, with_covariances(6.0, 0.5), "contradicted", 6.0),
        (CONSISTENCY, with_covariances(1.5, 0.95), "undecided", 1.5),
        (TIME, timed(0, 0.01, sizes=(3,)), "supported", 0.01),
        (TIME, timed(0, 3.0, sizes=(3,)), "contradicted", 3.0),
        (TIME, timed(0, 1.0, sizes=(3,)), "undecided", 1.0),
        (INTERACTION, errors({"s/d=0": {"a": 0.5, "b": 1.0}, "s/d=1": {"a": 1.0, "b": 1.1}}), "supported", 0.82),
        (INTERACTION, errors({"s/d=0": {"a": 0.5, "b": 1.0}, "s/d=1": {"a": 1.0, "b": 4.0}}), "contradicted", -0.5),
        (INTERACTION, errors({"s/d=0": {"a": 0.5, "b": 1.0}, "s/d=1": {"a": 1.0, "b": 2.0}}), "undecided", 0.0),
        (SLOPE, timed(0.9), "supported", 0.9),
        (SLOPE, timed(2.0), "contradicted", 2.0),
        (COST, timed(1, 5e-5, sizes=(3,)), "supported", -0.5),
        (COST, timed(1, 2e-4, sizes=(3,)), "contradicted", 1.0),
        (TRAFFIC, sending(24), "supported", -0.5),
        (TRAFFIC, sending(48), "supported", 0.0),
        (TRAFFIC, sending(96), "contradicted", 1.0),
        (TRAFFIC, sending(96).query("estimator == 'a' or trial < 9"), "contradicted", 1.0),  # `b` was stopped earlier
    ],
)
def test_every_kind_reaches_its_verdicts(claim, table, expected, value):
    found = verdict(table, **claim)
    assert found["verdict"] == expected
    assert found["value"] == pytest.approx(value, rel=0.05, abs=0.1)
    assert found["low"] <= found["value"] <= found["high"]
    assert (found["p"] <= 0.05) == (expected != "undecided")
    assert (found["needed"] > found["trials"]) == (expected == "undecided")


def test_a_time_is_over_parts_of_the_run_and_of_one_part_only_one_far_below_the_size_decides():
    assert (verdict(timed(1), **SLOPE)["trials"], verdict(timed(1), **COST)["trials"]) == (5, 8)
    one_part = verdict(timed(1).assign(seconds=1e-4), **COST)
    assert (one_part["verdict"], one_part["trials"]) == ("undecided", 1)
    assert "fewer than 5" in one_part["remark"]
    claim = {"id": "1", "says": "x", "kind": "time", "of": "a", "scenarios": ["s/n=3"], "size": 1.0}
    found = judge(read({"paper": "p", "claims": [claim]}, "l"), timed(1, sizes=(3,)).assign(seconds=1e-4))
    assert list(found["verdict"]) == ["supported"]
    assert verdicts.count_verdicts(found)[:3] == (0, 0, 0)  # as no test was made


@pytest.mark.parametrize(
    ("definitions", "size", "expected", "otherwise"),
    [
        (["change", "ratio"], -0.66, "direction only", "as a ratio (-40 %): supported"),
        (["ratio", "change"], 1 / 1.66 - 1, "supported", "as a change (-66 %): direction only"),
        (["change"], -0.66, "direction only", ""),
    ],
)
def test_40_percent_less_error_is_66_percent_better_by_the_ratio_only(definitions, size, expected, otherwise):
    table = two(1 / 1.66, trials=100)
    found = verdict(table, **{**CHANGE, "definitions": definitions, "size": -0.66})
    assert (found["verdict"], found["definition"], found["otherwise"]) == (expected, definitions[0], otherwise)
    assert (found["value"], found["size"]) == (pytest.approx(-0.4, abs=0.05), pytest.approx(size))
    assert (f"Read {otherwise}." in verdict_sentence(found)) == bool(otherwise)


SWEEP = {"kind": "all", "of": "a", "than": ["b", "c"], "scenarios": "s/n={2..9}"}


def sweep(a):
    return errors({f"s/n={k}": {"a": v, "b": 1.0, "c": 1.2} for k, v in zip((1, 2, 5, 9), a, strict=True)}, trials=200)


@pytest.mark.parametrize(
    ("a", "expected", "where"),
    [
        ((2.0, 0.5, 0.7, 0.9), "supported", "s/n=9"),  # n = 1 is outside the range
        ((0.5, 0.5, 1.2, 0.7), "contradicted", "s/n=5"),
        ((0.5, 0.5, 1.0, 0.7), "undecided", "s/n=5"),
    ],
)
def test_all_is_decided_by_its_worst_case(a, expected, where):
    found = verdict(sweep(a), **SWEEP)
    assert (found["verdict"], found["scenario"], found["than"]) == (expected, where, "b")


def test_a_case_that_is_decided_alone_but_not_after_holm_needs_more_trials():
    rng = np.random.default_rng(7)
    pairs = [np.exp(rng.normal([0.0, 0.2 * (k == 0)], 0.5, (40, 2))) for k in range(6)]
    p = [FIXED.p_above(*pair.T, 1.0) for pair in pairs]
    found = decide_all(pairs, [(str(k), "") for k in range(6)], FALLS, p)
    assert FIXED.change(*pairs[0].T).low > 0
    assert found.verdict == "undecided"
    assert 40 < found.needed < 200


@pytest.mark.parametrize(("later", "expected"), [(0.5, "supported"), (0.9, "direction only"), (1.4, "contradicted")])
def test_a_trend_compares_the_first_scenario_with_each_later_one(later, expected):
    claim = {**CHANGE, "kind": "trend", "size": -0.35, "scenarios": ["s/n=1", "s/n=5", "s/n=9"]}
    del claim["than"]
    table = judge(ledger(**claim), sweep((1.0, later, later, later)))
    assert table["verdict"].tolist() == [expected] * 2
    assert table["scenario"].tolist() == ["s/n=1 to s/n=5", "s/n=1 to s/n=9"]


@pytest.mark.parametrize(
    ("claim", "missing"),
    [
        ({**CHANGE, "than": "bb"}, "no rows of bb in s; did you mean 'b'?"),
        ({**CHANGE, "than": "ekf-joint"}, "no rows of ekf-joint in s"),  # there is one, and it was not run
        ({**CHANGE, "scenarios": "t"}, "no rows of scenario t; known are s"),
        ({**CHANGE, "scenarios": "nlos"}, "no rows of scenario nlos"),
        ({**SWEEP, "scenarios": "s/k={2..9}"}, r"no rows of any scenario s/k={2..9}"),
        ({"kind": "growth", "of": "a", "scenarios": "s"}, "growth needs three scenarios, the run has s"),
        ({"kind": "slope", "of": "a", "scenarios": "s", "size": 1}, "five sizes, the run has 1"),
        ({**SAME, "scenarios": "s"}, "only s was run"),
    ],
)
def test_a_claim_that_was_not_run_names_what_is_missing(claim, missing):
    found = verdict(two(1.0), **claim)
    assert found["verdict"] == "not run"
    assert missing in found["remark"]
    assert ("did you mean" in found["remark"]) == ("did you mean" in missing)


def test_what_was_not_run_is_said_of_built_in_names_without_a_look_at_installed_plug_ins(monkeypatch):
    """A paper's ledger has thousands of cases, over all of its readings, and every look takes milliseconds."""
    monkeypatch.setattr(registry, "entry_points", None)
    found = judge(load(), errors({"robots-1-3/n=3": {"arl": 0.5}, "packet-drop/drop=0.7": {"arl": 0.5}}))
    assert set(found["verdict"]) == {"not run"}
    assert found["remark"].str.match("no rows of [^ ]+ in ").any()


def test_over_confidence_failures_and_centralised_estimators_are_remarked():
    table = two(0.5).assign(failure=None)
    table.loc[table["estimator"] == "a", "anees"] = 4.0
    table.loc[(table["estimator"] == "b") & (table["trial"] == 3), "failure"] = "boom"
    table.loc[table["estimator"] == "b", "centralised"] = True
    found = verdict(table, **CHANGE)
    failed = "it would be supported, but b failed"
    assert found["remark"] == f"{failed}; a over-confident; 1 trial of b failed; b is centralised"
    assert (found["verdict"], found["p"], found["trials"]) == ("undecided", 1.0, TRIALS - 1)


@pytest.mark.parametrize(("who", "expected"), [("a", "contradicted"), ("b", "undecided")])
def test_no_estimator_escapes_a_contradiction_by_failing_and_none_earns_one(who, expected):
    table = two(1.5)
    table.loc[(table["estimator"] == who) & (table["trial"] == 3), "mse"] = np.inf
    assert verdict(table, **CHANGE)["verdict"] == expected


REPEATED = [f"s/n={k}" for k in range(200)]  # as many repetitions of one case


@pytest.mark.slow
@pytest.mark.parametrize(
    ("claim", "level", "false"),
    [
        (CHANGE, 1.0, ("supported", "contradicted")),
        ({**CHANGE, "size": -0.3}, 0.75, ("supported", "contradicted")),  # the edge of 0.3 less its margin
        ({**CHANGE, "size": -0.3}, 0.7, ("direction only", "contradicted")),
        ({"kind": "level", "of": "a", "size": np.exp(0.09 / 4)}, 1.0, ("supported", "contradicted")),
    ],
)
def test_a_false_verdict_comes_at_most_once_in_twenty(claim, level, false):
    """Here at the edges, where it is hardest; make prove has all kinds, more trials and other distributions."""
    levels = {label: {"a": level, "b": 1.0} for label in REPEATED}
    table = errors(levels, trials=20, spread=0.01, rng=np.random.default_rng(6))
    wrong = judge(ledger(**{**claim, "scenarios": REPEATED}), table)["verdict"].isin(false).mean()
    assert wrong < 0.05 + 3 * np.sqrt(0.05 * 0.95 / len(REPEATED))


def test_a_level_says_how_the_verdict_moves_with_what_is_asked():
    found = verdict(errors({"s": {"a": 1.4, "b": 1.0}}), kind="level", of="a", scenarios="s", size=1.0, also=[1.2, 2.0])
    assert (found["verdict"], found["otherwise"]) == ("contradicted", "up to 1.2 m: contradicted; up to 2 m: supported")


@pytest.mark.parametrize(("size", "expected"), [(1.0, "supported"), (5e-4, "undecided")])
def test_a_time_far_below_what_is_asked_needs_no_interval(size, expected):
    """One part has no interval; a tenth of the second is far enough, a fifth is not."""
    table = errors({"s": {"a": 1.0, "b": 1.0}}).assign(seconds=1e-4)
    assert verdict(table, kind="time", of="a", scenarios="s", size=size)["verdict"] == expected


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
    assert [[name for name, _ in variants(claim, made)] for claim in made.claims] == [
        ["paper", "other", "world"],
        ["paper"],
    ]
    found = judge(made, errors({"s": {"a": 0.5, "b": 1.0, "b[k=1.0]": 0.2}}))
    assert found["verdict"].tolist() == ["supported", "contradicted", "not run", "not run"]
    assert overview(found).loc["1"].tolist() == ["supported", "contradicted"]


def claim_with(**keys):
    return {"paper": "p", "claims": [{"id": "7", "says": "x", **keys}]}


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"paper": "p", "clams": []}, "l.toml: there is no key 'clams'; did you mean 'claims'?"),
        (claim_with(sais="x"), "claim '7': there is no key 'sais'; did you"),
        (claim_with(kind="levle"), "no kind 'levle'; did you mean 'level'?"),
        (claim_with(), "kind: it is missing"),
        ({"paper": "p", "claims": []}, "claims"),
        (claim_with(kind="level", of="a", scenarios="s"), "'size'"),
        (claim_with(kind="level", of="a", scenarios="s", size=1, than="b"), "does not use 'than'"),
        (claim_with(**CHANGE, size=-0.03), "size -0.03 is not beyond margin"),
        (claim_with(**CHANGE, size=-50), "size -50 is no change of an error: write -0.5 for 50 % less"),
        (claim_with(**CHANGE, size="big"), "size"),
        ({"paper": "p", "claims": [{"id": "7", "says": "x", **CHANGE}] * 2}, "two claims of that id"),
        (claim_with(**{**CHANGE, "scenarios": "s/n={1..3}"}), "takes no range"),
        (claim_with(kind="trend", of="a", scenarios="s/n={1..3}"), "takes no range"),
        (claim_with(kind="trend", of="a", scenarios="s"), "at least 2 scenarios"),
        (claim_with(kind="trend", of="a", scenarios="s/n={1"), "cannot read the braces of 's/n={1'"),
        ({**claim_with(**CHANGE), "variants": {"paper": {}}}, "cannot be called 'paper'"),
        ({**claim_with(**CHANGE), "variants": {"v": {"estimator": {}}}}, "did you mean 'estimators'?"),
    ],
)
def test_a_bad_ledger_is_refused_in_one_line(content, reason):
    with pytest.raises(cl.BadInput, match=r"\Al\.toml: .*\Z") as caught:
        read(content, "l.toml")
    assert reason in str(caught.value)


def test_a_list_in_braces_stands_for_its_values():
    claim = ledger(kind="trend", of="a[k={1,2}]", scenarios=["s[n={1,2}]", "t"]).claims[0]
    assert (claim.of, claim.scenarios) == (("a[k=1]", "a[k=2]"), ("s[n=1]", "s[n=2]", "t"))


def test_a_ledger_that_is_not_there_or_not_toml_is_refused(tmp_path):
    (tmp_path / "bad.toml").write_text("paper = ")
    for name, reason in (("none.toml", "cannot be read"), ("bad.toml", "not a TOML file")):
        with pytest.raises(cl.BadInput, match=reason):
            load(tmp_path / name)


def test_the_papers_ledger_names_what_exists():
    made = load()
    assert {claim.id.rstrip("bc") for claim in made.claims} == {str(k) for k in range(1, 29)}
    for claim in made.claims:
        assert claim.quote
        for _, read_ in variants(claim, made):
            for name in (*read_.of, *read_.than):
                make(name)
            for label in read_.scenarios:
                resolve(re.sub(r"{\d+\.\.(\d+)}", r"\1", label))


def test_a_sentence_says_what_the_numbers_say():
    table = two(1.5, rng=np.random.default_rng(2))
    found = verdict(table, **LESS)
    low, high = (f"{100 * found[end]:+.0f} %" for end in ("low", "high"))
    assert verdict_sentence(found) == (
        f"s: the RMSE of a is {100 * found['value']:.0f} % higher than that of b (95 % interval {low} to {high}, "
        "40 trials). Claimed: -40 %. Contradicted."
    )
    for trials, words in ((1, ", 1 part of the run)"), (2, ", 2 parts of the run)")):
        assert words in verdict_sentence(pd.Series({**found, "kind": "cost", "trials": trials}))
    equal = pd.concat([table[table["estimator"] == "b"].assign(estimator=e) for e in "ab"])
    assert verdict_sentence(verdict(equal, **CHANGE)) == (
        "s: the RMSE of a equals that of b in each of 40 trials. Contradicted."
    )
    assert verdict_sentence(verdict(table, **{**CHANGE, "than": "zz"})).startswith("Not run: no rows of zz in s")
    zero = table.assign(mse=table["mse"].where(table["estimator"] == "a", 0.0))
    assert "an RMSE of 0 leaves no number to give (40 trials)" in verdict_sentence(verdict(zero, **CHANGE))


LOOKED = read(
    {
        "paper": "P",
        "claims": [
            {"id": "1", "says": "better", **CHANGE},
            {"id": "2", "says": "quicker", "kind": "cost", "of": "a", "than": "b", "scenarios": "s"},
            {"id": "3", "says": "elsewhere", **CHANGE, "scenarios": "t"},
        ],
    },
    "here",
)


@pytest.mark.slow
def test_a_verdict_keeps_the_look_that_reached_it_and_what_is_open_keeps_its_cells_going():
    equal = two(1.0, spread=0.3)
    better_at_first = equal.assign(mse=equal["mse"].mask((equal["estimator"] == "a") & (equal["trial"] < 20), 0.2))
    found = verdicts.judge_run(LOOKED, better_at_first, [10, 20, 40])
    assert found["look"].tolist() == [10, 40, 0]
    assert verdicts.verdict_text(found.iloc[0]) == "Supported at n = 10"
    assert verdicts.open_cells(LOOKED, better_at_first, found) == set()  # time never keeps a run going
    found = verdicts.judge_at_look(LOOKED, equal, 10)
    assert found["verdict"][0] == "undecided"
    assert verdicts.open_cells(LOOKED, equal, found) == {("s", "a"), ("s", "b")}
    assert list(verdicts.drop_timed(LOOKED, found)["claim"]) == ["1"]


SCENARIOS = REPEATED[:40]


def family_run(rng, levels):
    """Rows of `a`, whose RMSE is a level in each scenario, and of `b`, whose RMSE is 1."""
    truth = {label: {"a": level, "b": 1.0} for label, level in zip(SCENARIOS, levels, strict=False)}
    table = errors(truth, trials=20, spread=0.3, rng=rng)
    own = np.repeat(rng.lognormal(0, 0.3, len(table) // ROBOTS), ROBOTS)
    return table.assign(anees=1.4 * own, coverage95=0.87 + 0.02 * np.log(own), seconds=1e-4 * own)


def test_a_case_that_a_variant_leaves_as_it_is_counts_once():
    claim = {"id": "1", "says": "x", "kind": "change", "of": "a", "than": ["b", "c"], "scenarios": SCENARIOS[:5]}
    table = family_run(np.random.default_rng(5), [0.9, 0.8, 0.7, 0.95, 1.0])
    others = [table[table["estimator"] == "b"].assign(estimator=name, mse=lambda t: 1.1 * t["mse"]) for name in "cd"]
    made = read({"paper": "p", "claims": [claim], "variants": {"other": {"estimators": {"c": "d"}}}}, "l")
    found = judge(made, pd.concat([table, *others]))
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
        one = decide(FIXED.change(a, b), trials, FALLS, partial(FIXED.p_of_change, a, b))
        found.append({"verdict": one.verdict, "p": one.p})
    labels = SCENARIOS[: len(found)]
    return adjust(pd.DataFrame(found).assign(claim="1", scenario=labels, of="", than="", definition=""))


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

"""Tables over trials: pooling, pairing, flags, refusals, ranks."""

import numpy as np
import pandas as pd
import pytest
from made_errors import BASE, rows
from scipy.stats import wilcoxon
from statsmodels.stats.proportion import proportion_confint

import cooploc as cl
from cooploc.analysis.metrics.compare import (
    SHORT,
    STATISTICS,
    compare,
    outlier_warnings,
    reading_warnings,
    summarize,
    trial_warnings,
)
from cooploc.analysis.metrics.consistency import COLLAPSED
from cooploc.analysis.metrics.errors import trial_means
from cooploc.analysis.metrics.ranking import disqualifications, letters, rank_groups
from cooploc.analysis.metrics.sequential import ANYTIME, looks
from cooploc.analysis.metrics.statistics import FIXED
from cooploc.terminal.tables import records


def test_rmse_pools_robots_by_valid_ticks_then_trials():
    frame = rows("a", [[1.0, 4.0], [9.0, 9.0]])
    frame.loc[0, "ticks"], frame.loc[1, "ticks"] = 30, 10
    np.testing.assert_allclose(trial_means(frame)["s", "a"]["mse"], [(30 * 1 + 10 * 4) / 40, 9])
    assert summarize(frame)["rmse"].item() == pytest.approx(np.sqrt((1.75 + 9) / 2))


def test_differences_are_paired_by_trial_and_not_by_order_or_index():
    both = pd.concat([rows("a", BASE), rows("b", 0.25 * BASE).sample(frac=1, random_state=0)])
    table = compare(both, baseline="a", full=True)
    pd.testing.assert_frame_equal(compare(both.set_index("trial", drop=False), baseline="a", full=True), table)
    row = table[table["estimator"] == "b"].iloc[0]
    assert (row["change"], row["change_low"], row["change_high"]) == pytest.approx((-0.5,) * 3)  # no spread is left
    assert row["effect"] == -1
    assert row["pairs"] == 12
    expected = (np.sqrt(0.25 * BASE.mean(1)) - np.sqrt(BASE.mean(1))).mean()
    assert row["difference"] == pytest.approx(expected)
    base = table[table["estimator"] == "a"].iloc[0]
    assert np.isnan(base["p"])


def test_a_tie_is_shown_by_equivalence_and_not_by_a_large_p(rng):
    better_and_worse = rng.permutation(np.linspace(-1, 1, len(BASE)))[:, None]  # as often, by as much: no luck
    near, far = (rows("b", BASE * np.exp(s * better_and_worse)) for s in (0.01, 1.0))
    for other, tie in ((near, True), (far, False)):
        row = compare(pd.concat([rows("a", BASE), other]), baseline="a", full=True).iloc[1]
        assert row["p"] > 0.05
        assert (row["p_equal_holm"] < 0.05) == tie


def test_p_and_interval_are_one_decision():
    """Where one trial is far worse and all others are a little better, a rank test says better and RMSE says no."""
    base = np.linspace(0.8, 1.2, 20)[:, None]
    spoilt = np.where(np.arange(20)[:, None] == 3, 12.0, 0.85 + 0.1 * np.sin(np.arange(20))[:, None])
    cases = {"spoilt": spoilt, "better": np.minimum(spoilt, 0.9), "worse": 1.2 + spoilt / 100}
    frames = [rows(name, base * factor) for name, factor in cases.items()]
    table = compare(pd.concat([rows("a", base), *frames]), baseline="a", full=True).set_index("estimator").iloc[1:]
    excludes = (table["change_low"] > 0) | (table["change_high"] < 0)
    assert (table["p"] < 0.05).to_dict() == excludes.to_dict() == {"spoilt": False, "better": True, "worse": True}
    assert wilcoxon((base * (spoilt - 1))[:, 0]).pvalue < 0.05
    assert table.loc["spoilt", "effect"] < 0 < table.loc["spoilt", "change"]


GOOD = {"certificate": "", "centralised": False, "bound": False, "consistency": "consistent", "anees": 1.0, "failed": 0}


@pytest.mark.parametrize(
    ("change", "reasons"),
    [
        ({}, []),
        ({"certificate": "passed: 16 checks"}, []),
        ({"consistency": "conservative", "anees": 0.1}, []),
        ({"consistency": "not shown", "anees": 2.9}, []),
        ({"consistency": "not shown", "anees": 3.1}, ["probably over-confident"]),
        ({"consistency": "over-confident", "anees": 2.0}, ["over-confident"]),
        ({"consistency": "over-wide", "anees": 0.001}, ["over-wide"]),
        ({"consistency": "not assessed"}, ["consistency not assessed"]),
        ({"certificate": "failed: causality: it peeks"}, ["failed the check causality"]),
        ({"centralised": True, "bound": True, "failed": 1}, ["a bound", "1 trial failed"]),
        ({"centralised": True}, ["centralised"]),
    ],
)
def test_an_estimator_qualifies_as_best_unless_there_is_a_reason(change, reasons):
    assert disqualifications(GOOD | change) == reasons


@pytest.mark.slow
def test_letters_of_equals_differ_at_any_of_five_looks_in_at_most_5_percent_of_runs():
    rng = np.random.default_rng(4)
    ever = {FIXED: 0, ANYTIME: 0}
    for _ in range(200):
        mse = pd.DataFrame(rng.lognormal(0, 0.3, (160, 2)), columns=["a", "b"])
        for stopping in ever:
            ever[stopping] += any(len(set(letters(mse[:n], stopping).values())) > 1 for n in looks(160))
    assert ever[ANYTIME] < 10 < ever[FIXED]


FRAME = rows("a", BASE)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (("a", FRAME), "errors is of type str; it must be the table that cl.errors returns"),
        ((summarize(FRAME), "a"), "errors has no column 'trial'"),
        ((FRAME[:0], "a"), "errors has no rows"),
        ((FRAME, {"t": "a"}), "baseline names none for scenario 's': add it"),
        ((pd.concat([FRAME, FRAME]), "a"), "s, a, trial 0 stands there twice"),
        ((FRAME.replace({"stream": {"h5": "h2"}}), "a"), "trials 2, 5 are of one stream; keep one of them"),
    ],
)
def test_a_table_that_cannot_be_compared_is_refused(given, reason):
    with pytest.raises(cl.BadInput, match=reason):
        compare(*given)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("anees", "coverage", "flag"),
    [
        (1.0, 0.95, "consistent"),
        (3.0, 0.95, "over-confident"),
        (0.3, 0.95, "conservative"),
        (1.5, 0.95, "not shown"),
        (0.05, 0.95, "over-wide"),
        (np.nan, 0.95, "not assessed"),
        (1e12, 0.27, "over-confident"),  # one trial has it: the interval of ANEES holds all limits
        (1e12, 0.95, "not shown"),
    ],
)
def test_consistency_is_judged_by_the_whole_interval_of_anees_or_of_coverage(anees, coverage, flag):
    spread = np.where(FRAME["trial"] == 3, anees, 0.9) if anees > 100 else anees * np.linspace(0.9, 1.1, len(FRAME))
    frame = FRAME.assign(anees=spread, coverage95=coverage + 0.001 * FRAME["trial"])
    assert compare(frame, baseline="a")["consistency"].item() == flag
    four, five = (compare(frame[frame["trial"] < n], baseline="a")["consistency"].item() for n in (4, 5))
    assert four == "not assessed"
    assert (five == four) == np.isnan(anees)


def test_one_collapsed_trial_decides_the_mean_of_anees_and_not_its_median():
    row = summarize(FRAME.assign(anees=np.where(FRAME["trial"] == 3, 1e12, 0.9))).iloc[0]
    assert (row["anees_median"], row["collapsed"]) == pytest.approx((0.9, 1 / 12))
    assert (row["collapsed_low"], row["collapsed_high"]) == pytest.approx(proportion_confint(1, 12, method="wilson"))
    assert row["anees"] > 1e10
    at_the_limit = FRAME.assign(anees=np.where(FRAME["trial"] < 4, np.inf, COLLAPSED))
    assert summarize(at_the_limit)["collapsed"].item() == pytest.approx(4 / 12)


@pytest.mark.parametrize("lost", [np.nan, np.inf, 1e200])
def test_a_trial_in_which_one_robot_fails_is_counted_and_nothing_else(lost):
    one_robot = (FRAME["trial"] == 3) & (FRAME["robot"] == 1)
    row = summarize(FRAME.assign(mse=FRAME["mse"].mask(one_robot, lost))).iloc[0]
    assert (row["trials"], row["failed"]) == (11, 1)
    assert row["rmse"] == pytest.approx(np.sqrt(np.delete(BASE, 3, 0).mean()))


def test_a_robot_whose_truth_is_unknown_is_not_a_failure():
    frame = FRAME.copy()
    frame.loc[frame["robot"] == 1, ["ticks", "mse", "anees"]] = [0, np.nan, np.nan]
    row = summarize(frame).iloc[0]
    assert (row["trials"], row["failed"], row["anees"]) == (12, 0, 1.0)
    assert row["rmse"] == pytest.approx(np.sqrt(BASE[:, [0, 2]].mean()))
    assert records(summarize(FRAME.assign(failure="boom")))[0]["rmse"] is None


def test_no_estimator_wins_by_failing_where_it_is_bad():
    mine = rows("b", 0.25 * BASE)
    mine.loc[mine["trial"] == 3, "mse"] = np.inf
    for other, baseline, p in ((mine, "a", 1.0), (mine, "b", 1.0), (mine.assign(mse=9 * mine["mse"]), "a", 0.0)):
        table = compare(pd.concat([FRAME, other]), baseline=baseline, full=True)
        row = table[table["estimator"] != baseline].iloc[0]
        assert (row["p"], row["p_equal"]) == pytest.approx((p, 1.0), abs=1e-3)


def test_a_trial_that_diverges_is_warned_of():
    base = np.linspace(0.9, 1.1, 100)[:, None]
    assert outlier_warnings(summarize(rows("a", base))) == []
    base[7] *= 20**2
    table = summarize(rows("a", base))
    assert table["outlying"].item() == pytest.approx(0.01)
    assert table["rmse_median"].item() == pytest.approx(1.0, abs=0.01)
    assert outlier_warnings(table)[0].startswith("s, a: 1 of 100 trials (")


def test_an_estimator_that_lacks_trials_is_named_but_not_one_whose_trials_failed():
    whole = pd.concat([rows("a", BASE), rows("b", BASE)])
    lost = whole.assign(mse=whole["mse"].where((whole["estimator"] == "a") | (whole["trial"] > 0)))
    assert trial_warnings(compare(whole, "a")) == trial_warnings(compare(lost, "a")) == []
    (said,) = trial_warnings(compare(whole[(whole["estimator"] == "a") | (whole["trial"] > 2)], "a"))
    assert said.startswith(f"s, b: {len(BASE) - 3} trials, and others {len(BASE)}: its RMSE is of these")


def test_estimators_that_do_not_differ_share_a_letter(rng):
    hard = rng.lognormal(0, 0.4, 12)
    names, factors = list("abc"), [1.0, 1.0, 30.0]
    mse = pd.DataFrame({n: f * hard * rng.lognormal(0, 0.1, 12) for n, f in zip(names, factors, strict=True)})
    ranks, groups = rank_groups(mse)
    assert (ranks["a"] + ranks["b"], ranks["c"]) == (3, 3)
    assert groups == {"a": "a", "b": "a", "c": "b"}
    assert rank_groups(mse[["a", "b"]])[1] == {"a": "a", "b": "a"}


def test_estimators_without_a_difference_keep_one_letter_in_95_percent_of_families():
    rng, split = np.random.default_rng(3), []
    for _ in range(100):
        mse = rng.lognormal(0, 0.5, (12, 1)) * rng.lognormal(0, 0.3, (12, 4))
        split.append(len(set(rank_groups(pd.DataFrame(mse, columns=list("abcd")))[1].values())) > 1)
    assert np.mean(split) < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 100)


def test_every_statistic_is_in_the_table_and_p_is_adjusted_over_all_rows(rng):
    frames = [rows("b", 0.8 * BASE * rng.lognormal(0, 0.3, BASE.shape), scenario=s) for s in ("t", "s")]
    frame = pd.concat([*frames, FRAME, FRAME.assign(scenario="t")])
    frame["centralised"] = frame["scenario"] + frame["estimator"] == "tb"
    table = compare(frame, "a", full=True)
    assert (table["scenario"] + table["estimator"]).tolist() == ["tb", "sb", "sa", "ta"]
    assert table["centralised"].tolist() == [True, False, False, False]
    pd.testing.assert_frame_equal(table[list(STATISTICS)], summarize(frame)[list(STATISTICS)])
    assert set(SHORT) <= set(table.columns)
    smallest = table["p"].idxmin()
    assert table.loc[smallest, "p_holm"] == pytest.approx(min(1, 2 * table.loc[smallest, "p"]))


def test_what_estimators_read_themselves_is_said_where_it_differs_but_not_what_they_read_of_teammates():
    senses = {"a": "DOA", "b": "DOA, team ranges", "c": "landmarks, sightings", "d": "odometry", "e": "", "f": None}
    table = pd.DataFrame({"scenario": "s", "estimator": senses.keys(), "senses": senses.values()})
    assert reading_warnings(table[table["estimator"] != "c"]) == []
    others = pd.DataFrame({"scenario": "t", "estimator": [f"x=m.py:X[g={i}]" for i in range(5)], "senses": "RSSI"})
    both = pd.concat([table[table["estimator"] != "c"], others, table.assign(scenario="t")])
    (text,) = reading_warnings(both)
    assert text.partition(": ")[2] == "RSSI (x[g=0], x[g=1], x[g=2] and 2 more), DOA (a, b), landmarks (c)"
    apart = table.assign(scenario=table["estimator"])
    assert reading_warnings(apart) == []


@pytest.mark.slow
def test_a_table_made_elsewhere_is_compared_as_that_of_errors(rng):
    errors = pd.concat([rows(name, rng.uniform(1, 2, (9, 1))) for name in "ab"], ignore_index=True)
    own = errors.assign(rmse=np.sqrt(errors["mse"]))[["estimator", "trial", "rmse"]]
    columns = ["estimator", "trials", "rmse", "rmse_low", "rmse_high", "change", "change_low", "change_high", "p_holm"]
    pd.testing.assert_frame_equal(compare(own, "b")[columns], compare(errors, "b")[columns])
    pd.testing.assert_frame_equal(compare(own.set_index(["estimator", "trial"]), "b"), compare(own, "b"))
    numbered = own.assign(estimator=own["estimator"].map({"a": 0, "b": 1}), scenario=3)
    assert compare(numbered, 1)["change"].tolist() == compare(own, "b")["change"].tolist()
    lost = own.assign(rmse=own["rmse"].where(own.index != 3))
    assert compare(lost, "b")["failed"].sum() == 1
    twice = pd.concat([own.assign(robot=robot, scenario=s) for robot in (0, 1) for s in "xy"])
    assert compare(twice, "b", full=True)["robots"].tolist() == [2] * 4
    for change, said in (
        ({"rmse": -1.0}, "negative number"),
        ({"rmse": "0.3 m"}, "rmse has '0.3 m', which is no number"),
        ({"rmse": "nan"}, "or none"),
        ({"trial": 0}, "there twice"),
        ({"estimator": own["estimator"].where(own["trial"] > 2)}, "estimator is empty in some rows"),
    ):
        with pytest.raises(cl.BadInput, match=said):
            compare(own.assign(**change), "b")
    with pytest.raises(
        cl.BadInput, match=r"has no column 'rmse'; it must be .* or one with estimator, trial, rmse \[m\]"
    ):
        compare(own.drop(columns="rmse"), "b")

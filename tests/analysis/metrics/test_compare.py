"""Tables over trials: pooling, pairing, flags, refusals, ranks."""

import numpy as np
import pandas as pd
import pytest
from made_errors import BASE, rows
from scipy.stats import wilcoxon
from statsmodels.stats.proportion import proportion_confint

import cooploc as cl
from cooploc.analysis.metrics.compare import SHORT, STATISTICS, compare, outlier_warnings, summarize
from cooploc.analysis.metrics.consistency import COLLAPSED
from cooploc.analysis.metrics.errors import trial_means
from cooploc.analysis.metrics.ranking import disqualifications, letters, pareto_front, rank_groups
from cooploc.analysis.metrics.sequential import ANYTIME, FIXED, looks
from cooploc.terminal.tables import records


def test_rmse_pools_robots_by_valid_ticks_then_trials():
    frame = rows("a", [[1.0, 4.0], [9.0, 9.0]])
    frame.loc[0, "ticks"], frame.loc[1, "ticks"] = 30, 10
    np.testing.assert_allclose(trial_means(frame)["s", "a"]["mse"], [(30 * 1 + 10 * 4) / 40, 9])
    assert summarize(frame)["rmse"].item() == pytest.approx(np.sqrt((1.75 + 9) / 2))


def test_differences_are_paired_by_trial_and_not_by_order():
    mine = rows("b", 0.25 * BASE)
    table = compare(pd.concat([rows("a", BASE), mine.sample(frac=1, random_state=0)]), baseline="a", full=True)
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
        row = compare(pd.concat([rows("a", BASE), other]), baseline="a", margin=0.05, full=True).iloc[1]
        assert row["p"] > 0.05
        assert (row["p_equal_holm"] < 0.05) == tie
        assert (row["trials_for_margin"] <= row["pairs"]) == tie


def test_what_is_no_table_of_errors_is_refused_with_what_it_should_be():
    frame = rows("a", BASE)
    wrong = {
        "errors is of type str; it must be the table that cl.errors returns": ("a", frame),
        "errors has no column 'trial'": (summarize(frame), "a"),
        "margin is 0; it must lie above 0": (frame, "a", 0),
        "baseline names none for scenario 's': add it": (frame, {"t": "a"}),
    }
    for said, given in wrong.items():
        with pytest.raises(cl.BadInput, match=said):
            compare(*given)


@pytest.mark.parametrize(
    ("anees", "flag"),
    [(1.0, "consistent"), (3.0, "over-confident"), (0.3, "conservative"), (1.5, "not shown"), (0.05, "over-wide")],
)
def test_consistency_is_judged_by_the_whole_interval(anees, flag):
    spread = anees * np.repeat(np.linspace(0.9, 1.1, 12), 3)
    frame = rows("a", BASE)
    frame["anees"] = spread
    assert compare(frame, baseline="a")["consistency"].item() == flag
    assert compare(frame[frame["trial"] < 4], baseline="a")["consistency"].item() == "not assessed"


def test_where_anees_tells_nothing_coverage_does():
    frame = rows("a", BASE)
    frame["anees"] = np.where(frame["trial"] == 3, 1e12, 0.9)  # its interval reaches from 0 to beyond all bounds
    for coverage, flag in ((0.27, "over-confident"), (0.95, "not shown")):
        frame["coverage95"] = coverage + 0.001 * frame["trial"]
        assert compare(frame, baseline="a")["consistency"].item() == flag


def test_one_collapsed_trial_decides_the_mean_of_anees_and_not_its_median():
    frame = rows("a", BASE)
    frame["anees"] = np.where(frame["trial"] == 3, 1e12, 0.9)
    row = compare(frame, baseline="a", full=True).iloc[0]
    assert (row["anees_median"], row["collapsed"]) == (pytest.approx(0.9), pytest.approx(1 / 12))
    low, high = proportion_confint(1, 12, method="wilson")
    assert (row["collapsed_low"], row["collapsed_high"]) == pytest.approx((low, high))
    assert row["anees"] > 1e10
    frame["anees"] = np.where(frame["trial"] < 4, np.inf, COLLAPSED)  # the limit itself is not beyond it
    assert summarize(frame)["collapsed"].item() == pytest.approx(4 / 12)
    assert np.isnan(summarize(frame.assign(anees=np.nan))["collapsed"].item())


def test_failed_trials_are_counted_and_nothing_else():
    frame = rows("a", BASE).assign(failure=None)
    for lost in (np.nan, np.inf, 1e200):  # of one robot: the whole team failed
        frame.loc[(frame["trial"] == 3) & (frame["robot"] == 1), "mse"] = lost
        row = summarize(frame).iloc[0]
        assert (row["trials"], row["failed"]) == (11, 1)
        assert row["rmse"] == pytest.approx(np.sqrt(np.delete(BASE, 3, 0).mean()))
    gone = frame.assign(failure="boom")
    assert records(summarize(gone))[0]["rmse"] is None
    assert summarize(gone)["failed"].item() == 12


def test_a_robot_whose_truth_is_unknown_is_not_a_failure():
    frame = rows("a", BASE)
    frame.loc[frame["robot"] == 1, ["ticks", "mse", "anees"]] = [0, np.nan, np.nan]
    row = summarize(frame).iloc[0]
    assert (row["trials"], row["failed"], row["anees"]) == (12, 0, 1.0)
    assert row["rmse"] == pytest.approx(np.sqrt(BASE[:, [0, 2]].mean()))


def test_no_estimator_wins_by_failing_where_it_is_bad():
    mine = rows("b", 0.25 * BASE)
    worst = mine["trial"] == 3
    mine.loc[worst, "mse"] = np.inf
    table = compare(pd.concat([rows("a", BASE), mine]), baseline="a", full=True)
    assert (table["p"].iloc[1], table["p_equal"].iloc[1]) == (1.0, 1.0)
    other = compare(pd.concat([rows("a", BASE), mine]), baseline="b", full=True).iloc[0]
    assert other["p"] == 1.0  # the baseline is the better one, and failed
    worse = compare(pd.concat([rows("a", BASE), mine.assign(mse=9 * mine["mse"])]), baseline="a", full=True).iloc[1]
    assert worse["p"] < 0.001


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


def test_one_stream_under_several_numbers_of_trials_is_refused():
    frame = rows("a", BASE)
    copied = frame.assign(stream=np.where(frame["trial"] == 5, "h2", frame["stream"]))
    with pytest.raises(cl.BadInput, match="trials 2, 5 are of one stream; keep one of them"):
        compare(copied, baseline="a")
    with pytest.raises(cl.BadInput, match="s, a, trial 0 stands there twice"):
        compare(pd.concat([frame, frame]), baseline="a")


def test_a_trial_that_diverges_is_warned_of_and_stands_beside_the_median():
    base = np.linspace(0.9, 1.1, 100)[:, None]
    calm = summarize(rows("a", base))
    base[7] *= 20**2
    row = summarize(rows("a", base)).iloc[0]
    assert outlier_warnings(calm) == []
    assert (row["outlying"], row["rmse_median"]) == (pytest.approx(0.01), pytest.approx(1.0, abs=0.01))
    assert 0 < row["outlying_low"] < 0.01 < row["outlying_high"] < 0.06
    (said,) = outlier_warnings(summarize(rows("a", base)))
    assert said.startswith("s, a: 1 of 100 trials (")
    assert "median trial, 1.001 m; they decide the RMSE, 2.156 m" in said


HARD = np.random.default_rng(1).lognormal(0, 0.4, 12)
GOOD = {"certificate": "", "centralised": False, "bound": False, "consistency": "consistent", "anees": 1.0, "failed": 0}


def squared_errors(**factors):
    """Squared squared_errors (trial, estimator) around the factors; what is hard in a trial is hard for all."""
    rng = np.random.default_rng(2)
    return pd.DataFrame({name: f * HARD * rng.lognormal(0, 0.1, HARD.shape) for name, f in factors.items()})


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


def test_estimators_that_do_not_differ_share_a_letter():
    letters = rank_groups(squared_errors(a=1.0, b=1.0, c=30.0))[1]
    assert set(letters["a"]) & set(letters["b"])
    assert not set(letters["a"]) & set(letters["c"])
    assert rank_groups(squared_errors(a=1.0, b=1.0))[1] == {"a": "a", "b": "a"}
    assert rank_groups(squared_errors(a=1.0, b=9.0))[1] == {"a": "a", "b": "b"}


def test_estimators_without_a_difference_keep_one_letter_in_95_percent_of_families():
    rng = np.random.default_rng(3)
    split = []
    for _ in range(100):
        mse = rng.lognormal(0, 0.5, (12, 1)) * rng.lognormal(0, 0.3, (12, 4))
        split.append(len(set(rank_groups(pd.DataFrame(mse, columns=list("abcd")))[1].values())) > 1)
    assert np.mean(split) < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 100)


def test_equals_are_ever_given_two_letters_at_five_looks_in_at_most_5_percent_of_runs_until_decided():
    rng = np.random.default_rng(4)
    ever = {FIXED: 0, ANYTIME: 0}
    for _ in range(200):
        mse = pd.DataFrame(rng.lognormal(0, 0.3, (160, 2)), columns=["a", "b"])
        for stopping in ever:
            ever[stopping] += any(len(set(letters(mse[:n], stopping).values())) > 1 for n in looks(160))
    assert ever[ANYTIME] < 10 < ever[FIXED]


def test_the_front_is_what_nothing_beats_in_both():
    error = np.array([3.0, 2.0, 2.5, 1.0, 1.0, 0.5])
    cost = np.array([1.0, 2.0, 3.0, 4.0, 4.0, np.nan])
    assert pareto_front(error, cost).tolist() == [True, True, False, True, True, False]


def test_a_statistic_gets_into_tables_and_p_is_adjusted_over_all_rows(rng):
    frames = [rows("a", BASE, scenario=s) for s in ("s", "t")]
    frames += [rows("b", 0.8 * BASE * rng.lognormal(0, 0.3, BASE.shape), scenario=s) for s in ("s", "t")]
    frame = pd.concat(frames)
    table = compare(frame, "a", full=True)
    for name in STATISTICS:
        np.testing.assert_array_equal(table[name], summarize(frame)[name])
    assert set(SHORT) <= set(table.columns)
    smallest = table["p"].idxmin()
    assert table.loc[smallest, "p_holm"] == pytest.approx(min(1, 2 * table.loc[smallest, "p"]))

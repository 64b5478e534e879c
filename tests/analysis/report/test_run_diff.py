"""What changed between two runs: paired where the streams are the same, and said where they are not."""

import numpy as np
import pytest
from made_runs import kept_from, rows_of

from cooploc.analysis.metrics import statistics
from cooploc.analysis.report.run_diff import changes, sentences, settings, table, unpaired_change, unpaired_p
from cooploc.api import RunChanges
from cooploc.estimators.errors import BadInput


def pair(folder, alter=lambda rows: rows, trials=12):
    before = rows_of("nlos", {"a": (1.0, 1.0), "b": (0.5, 1.0)}, trials=trials)
    return kept_from(before, folder), kept_from(alter(before.copy()), folder)


def test_the_same_run_is_bit_equal(tmp_path):
    found = changes(*pair(tmp_path))
    assert list(found["equal"]) == list(found["trials"]) == [12, 12]
    assert (found["change"] == 0).all()
    assert sentences(found) == ["2 of 2 (scenario, estimator) are bit-equal in every trial that was compared."]
    assert "bit-equal" in table(found).markdown()


@pytest.mark.slow
def test_a_change_is_paired_by_trial(tmp_path):
    def worse(rows):
        mine = rows["estimator"] == "b"
        rows.loc[mine, "mse"] *= 1.44 * np.random.default_rng(2).uniform(0.98, 1.02, mine.sum())
        return rows

    a, b = pair(tmp_path, worse)
    row = changes(a, b).set_index("estimator").loc["b"]
    assert row["pairing"] == "paired"
    x, y = (kept.rows.loc[kept.rows["estimator"] == "b", "mse"].to_numpy() for kept in (a, b))
    assert (row["change"], row["change_low"], row["change_high"]) == statistics.FIXED.change(x, y)
    assert 0.18 < row["change_low"] < 0.2 < row["change_high"] < 0.22
    assert sentences(changes(a, b))[1] == "1 of them: worse."
    assert (row["verdict"], changes(b, a).set_index("estimator").loc["b"]["verdict"]) == ("worse", "better")


def test_only_trials_of_the_same_stream_are_paired_and_it_is_said(tmp_path):
    found = changes(*pair(tmp_path, lambda rows: rows.assign(stream="x" + rows["stream"])))
    assert set(found["pairing"]) == {"unpaired"}
    assert ((found["equal"] == 0) & (found["change_low"] < 0) & (found["change_high"] > 0)).all()
    assert any("Not paired, because the hashes of their streams differ: 2" in line for line in sentences(found))
    some = lambda rows: rows.assign(stream=np.where(rows["trial"] < 4, "x", "") + rows["stream"])  # noqa: E731
    found = changes(*pair(tmp_path, some))
    assert (set(found["pairing"]), list(found["trials"])) == ({"paired"}, [8, 8])


def test_the_unpaired_interval_covers_the_ratio_as_often_as_it_says():
    rng = np.random.default_rng(3)
    found = [unpaired_change(rng.lognormal(0, 0.5, 30), 1.21 * rng.lognormal(0, 0.5, 30)) for _ in range(400)]
    assert 0.92 < np.mean([one.low < 0.1 < one.high for one in found]) < 0.98


def test_two_runs_that_do_not_differ_are_called_different_in_at_most_5_percent():
    """Unpaired; the paired test is that of every change, and `make prove` has it."""
    rng = np.random.default_rng(4)
    found = [unpaired_p(*(rng.lognormal(0, 0.5, (2, 30)))) <= 0.05 for _ in range(1000)]
    assert 0.02 < np.mean(found) < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 1000)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("alter", "failing", "different"),
    [
        (lambda rows: rows, False, False),
        (lambda rows: rows.assign(mse=np.where(rows["estimator"] == "b", 2.0, 1.0) * rows["mse"]), True, True),
        (lambda rows: rows.assign(mse=np.where(rows["estimator"] == "b", 0.5, 1.0) * rows["mse"]), False, True),
        (lambda rows: rows.assign(failure=np.where(rows["trial"] == 2, "it broke", None)), True, True),
        (lambda rows: rows.assign(failure="it broke", mse=np.nan), True, True),
        (lambda rows: rows[rows["estimator"] == "a"], True, True),
    ],
)
def test_a_job_can_fail_where_an_estimator_became_worse(tmp_path, alter, failing, different):
    before, after = pair(tmp_path, alter)
    found = RunChanges(changes(before, after), settings(before, after), sentences(changes(before, after)))
    assert (found.is_any("worse"), found.is_any("different")) == (failing, different)
    assert found.markdown().startswith("## What changed\n\n| scenario | estimator |")
    with pytest.raises(BadInput, match="worse or different"):
        found.is_any("better")


@pytest.mark.slow
def test_what_only_one_of_them_has_is_said(tmp_path):
    a, b = pair(tmp_path, lambda rows: rows[rows["estimator"] == "a"])
    row = changes(a, b).set_index("estimator").loc["b"]
    assert row["pairing"] == "only in the first run"
    assert np.isnan(row["change"])
    assert changes(b, a).set_index("estimator").loc["b", "pairing"] == "only in the second run"
    assert "only in the first run: 1 (scenario, estimator)." in sentences(changes(a, b))


@pytest.mark.parametrize(("trials", "known"), [(4, False), (5, True)])
def test_below_five_trials_there_is_no_interval(tmp_path, trials, known):
    runs = pair(tmp_path, lambda rows: rows.assign(mse=1.1 * rows["mse"]), trials)
    assert changes(*runs)["change_low"].notna().all() == known


def test_settings_that_differ_are_named(tmp_path):
    a, _ = pair(tmp_path)
    a = a._replace(manifest={**a.manifest, "files": {"mine.py": "12ab"}})
    other = {"seed": 9, "versions": {"cooploc": "1", "python": "3"}, "scenarios": {"nlos": {"ticks": 11}}}
    other |= {"files": {"mine.py": "34cd"}}
    assert settings(a, a) == []
    expected = ["seed: 3 before, 9 after", "cooploc: 0 before, 1 after", "nlos: its parameters differ"]
    expected += ["mine.py: its source differs"]
    assert settings(a, a._replace(manifest={**a.manifest, **other})) == expected

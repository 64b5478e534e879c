"""Claims at looks: a verdict stays as it was reached, and what is open keeps the trials coming that may decide it."""

import numpy as np
import pandas as pd
import pytest
from made_runs import rows_of

from cooploc.analysis.claims import ledger, verdicts
from cooploc.analysis.metrics import sequential

CLAIMS = [
    {"id": "1", "says": "better", "kind": "change", "of": "mine", "than": "base", "scenarios": "s"},
    {"id": "2", "says": "quicker", "kind": "cost", "of": "mine", "than": "base", "scenarios": "s"},
    {"id": "3", "says": "elsewhere", "kind": "change", "of": "mine", "than": "base", "scenarios": "t"},
    {"id": "4", "says": "beyond any test", "kind": "untestable", "why": "none"},
]
LEDGER = ledger.read({"paper": "P", "claims": CLAIMS}, "here")


@pytest.fixture
def rows():
    """Forty trials in which `mine` errs half as much at first, and exactly as much later."""
    made = rows_of("s", {"base": (1.0, 1.0), "mine": (1.0, 1.0)}, trials=40)
    noise = np.exp(np.random.default_rng(2).normal(0, 0.2, (2, 40)))
    noise[1, :20] /= 4
    return made.assign(mse=noise.ravel())


def of(found, claim):
    return found[found["claim"] == claim].iloc[0]


def test_a_verdict_keeps_the_look_that_reached_it(rows):
    found = verdicts.judge_run(LEDGER, rows, [10, 20, 40])
    one = of(found, "1")
    assert (one["verdict"], one["look"], one["trials"]) == ("supported", 10, 10)
    assert verdicts.verdict_text(one) == "Supported at n = 10"
    assert of(found, "3")["look"] == of(found, "4")["look"] == 0


def test_looks_one_by_one_say_what_looks_at_once_say(rows):
    step = None
    for n in (10, 20, 40):
        step = verdicts.judge_at_look(LEDGER, rows, n, step)
    pd.testing.assert_frame_equal(step, verdicts.judge_run(LEDGER, rows, [10, 20, 40]))


def test_what_is_open_keeps_its_cells_going_and_time_never_does(rows):
    equal = rows.assign(mse=np.exp(np.random.default_rng(8).normal(0, 0.3, 80)))
    found = verdicts.judge_at_look(LEDGER, equal, 10)
    assert of(found, "1")["verdict"] == "undecided"
    assert verdicts.open_cells(LEDGER, equal, found) == {("s", "mine"), ("s", "base")}
    assert list(verdicts.lasting(LEDGER, found)["claim"]) == ["1"]
    decided = verdicts.judge_at_look(LEDGER, rows, 10)
    assert verdicts.open_cells(LEDGER, rows, decided) == set()


def test_a_case_that_failures_leave_undecided_keeps_nothing_going(rows):
    rows.loc[rows["estimator"].eq("mine") & rows["trial"].eq(3), "failure"] = "RuntimeError: lost"
    found = verdicts.judge_at_look(LEDGER, rows, 10)
    assert of(found, "1")["verdict"] == "undecided"
    assert verdicts.open_cells(LEDGER, rows, found) == set()


def test_a_run_of_a_fixed_number_of_trials_is_judged_as_ever(rows):
    fixed = verdicts.judge_run(LEDGER, rows, [])
    pd.testing.assert_frame_equal(fixed, verdicts.judge(LEDGER, rows))


@pytest.mark.parametrize("kind", ["change", "trend", "all", "same", "growth", "interaction", "level", "consistency"])
def test_every_kind_asks_more_of_a_sequence_than_of_one_look(kind):
    keys = {
        "change": {"than": "base", "scenarios": "s/n=1"},
        "trend": {"scenarios": ["s/n=1", "s/n=2"]},
        "all": {"than": "base", "scenarios": ["s/n=1", "s/n=2"]},
        "same": {"scenarios": ["s/n=1", "s/n=2"], "margin": 0.1},
        "growth": {"scenarios": ["s/n=1", "s/n=2", "s/n=3"]},
        "interaction": {"than": "base", "scenarios": ["s/n=1", "s/n=2"]},
        "level": {"scenarios": "s/n=1", "size": 1.0},
        "consistency": {"scenarios": "s/n=1"},
    }
    rng = np.random.default_rng(5)
    parts = [rows_of(f"s/n={k}", {"base": (1.0, 1.0), "mine": (1.0, 1.0)}, trials=30) for k in (1, 2, 3)]
    made = pd.concat(parts, ignore_index=True)
    made["mse"] = np.exp(rng.normal(0, 0.3, len(made)))
    made["anees"], made["coverage95"] = rng.uniform(0.5, 2.0, len(made)), rng.uniform(0.8, 1.0, len(made))
    claim = {"id": "1", "says": "so", "kind": kind, "of": "mine", **keys[kind]}
    asked = ledger.read({"paper": "P", "claims": [claim]}, "here")
    once, ever = (verdicts.judge(asked, made, how).iloc[0] for how in (sequential.FIXED, sequential.ANYTIME))
    assert ever["value"] == pytest.approx(once["value"])
    assert ever["high"] - ever["low"] > once["high"] - once["low"]

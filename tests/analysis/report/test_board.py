"""A board shows what was reproduced, separates what a test separates, and runs nobody's code."""

import json

import numpy as np
import pandas as pd
import pytest

import cooploc as cl
from cooploc.analysis.metrics.ranking import board_letters

STUDY = """about = "small"
trials = 10
seed = {seed}
scenarios = ["trajectory[ticks=6]", "nlos/n=2[ticks=6]"]
estimators = ["dead-reckoning", "ekf-local"]
"""
PLUGIN = """# SPDX-License-Identifier: BSD-3-Clause
'''Stands still. Source: Nobody (1905), section 2.'''
from pathlib import Path
from cooploc.estimators.dead_reckoning import DeadReckoning as Mine
with Path("imported").open("a") as file: file.write("x")
"""


def run(folder, seed=1, **how):
    (folder / "small.toml").write_text(STUDY.format(seed=seed))
    return cl.run_study(folder / "small.toml", isolate=False, **how)


@pytest.mark.slow
@pytest.mark.parametrize(("trials", "alike"), [(10, 0.95), (100, 0.5)])
def test_of_two_hundred_boards_of_ten_equal_methods_at_most_one_in_twenty_shows_a_separation(trials, alike, rng):
    spread, wrong = np.linspace(0.4, 1.5, 10), 0
    for _ in range(200):
        own, hard = rng.normal(size=(trials, 10)), rng.normal(size=(trials, 1))
        logs = spread * (np.sqrt(alike) * hard + np.sqrt(1 - alike) * own) - spread**2 / 2  # means are 1
        mse = pd.DataFrame(np.exp(logs), columns=list("abcdefghij"))
        wrong += set(board_letters({"one": mse})["one"].values()) != {"a"}
    assert wrong <= 10


def test_letters_begin_with_the_lowest_error_and_need_ten_trials(rng):
    mse = pd.DataFrame(rng.uniform(0.9, 1.1, (20, 3)) * [9.0, 1.0, 1.0], columns=["far", "near", "nearer"])
    assert board_letters({"one": mse})["one"] == {"far": "b", "near": "a", "nearer": "a"}
    assert set(board_letters({"one": mse[:9]})["one"].values()) == {"a"}


def test_the_scenarios_of_a_table_are_one_family(rng):
    noise = rng.lognormal(0, 0.3, (12, 2))
    pairs = (pd.DataFrame(noise * [1, 1 + k / 50], columns=["a", "b"]) for k in range(200))
    just = next(mse for mse in pairs if board_letters({"one": mse})["one"]["b"] == "b")  # p is just below the limit
    equal = {str(k): just[["a", "a"]].set_axis(["a", "b"], axis=1) for k in range(9)}
    assert board_letters({"one": just, **equal})["one"] == {"a": "a", "b": "a"}


@pytest.mark.slow
def test_a_board_needs_a_confirmation_of_the_run_as_it_is_now(tmp_path):
    ran = run(tmp_path, out=tmp_path / "run")
    with pytest.raises(cl.BadInput, match=r"nobody has reproduced .*cooploc reproduce .*run --trials 2"):
        cl.board([ran], tmp_path / "site")
    assert cl.reproduce(ran.folder, trials=2).equal
    page = cl.board([ran.folder], tmp_path / "site")
    assert {file.stem for file in (tmp_path / "site/estimators").iterdir()} == {"dead-reckoning", "ekf-local"}
    assert page.read_text().count("by 1 run<") == 4
    manifest = json.loads((ran.folder / "manifest.json").read_text())
    (ran.folder / "manifest.json").write_text(json.dumps({**manifest, "cpu": "another"}))
    with pytest.raises(cl.BadInput, match="as the run is now"):
        cl.board([ran.folder], tmp_path / "site")
    cl.board(ran.folder, tmp_path / "site", reproduce_first=True)


@pytest.mark.slow
def test_runs_on_the_same_streams_share_a_table_and_reproduce_each_other(tmp_path):
    runs = [run(tmp_path, out=tmp_path / "one"), run(tmp_path, out=tmp_path / "two", estimators="dead-reckoning")]
    runs.append(run(tmp_path, seed=2, out=tmp_path / "other"))
    text = cl.board(runs, tmp_path / "site", reproduce_first=True).read_text()
    assert (text.count('id="table-study-'), text.count("by 3 runs<"), text.count("by 1 run<")) == (2, 2, 6)
    assert sum(file.stat().st_size for file in (tmp_path / "site").rglob("*.html")) < 1e6


@pytest.mark.slow
def test_a_board_of_a_plugin_states_its_licence_and_source_and_not_its_place_and_does_not_run_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(PLUGIN)
    ran = run(tmp_path, out=tmp_path / "run", estimators=f"ekf-local,{tmp_path}/mine.py:Mine")
    with pytest.raises(cl.BadInput, match="--trust"):
        cl.board([ran], reproduce_first=True)
    cl.reproduce(ran.folder, trials=2, trust=True)
    (tmp_path / "imported").unlink()
    (tmp_path / "mine.py").unlink()
    page = cl.board([ran])
    text = page.read_text() + next(page.parent.glob("estimators/mine-py-*.html")).read_text()
    assert "BSD-3-Clause" in text
    assert text.count("Nobody (1905") == 3
    assert str(tmp_path) not in text
    assert not (tmp_path / "imported").exists()
